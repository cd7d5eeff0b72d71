"""The guided release with a Pilot at the keys and a simulated device at the end of a real link."""

import math
import random
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from textual import events
from textual.content import Content
from textual.pilot import Pilot
from textual.style import Style
from textual.visual import RenderOptions
from textual.widgets import Digits, Static

from dpr_lab.acquisition.capture import CaptureOptions, Released, SwingReading
from dpr_lab.acquisition.device import Device
from dpr_lab.acquisition.holding import RestReading
from dpr_lab.report.angles import UNITS
from dpr_lab.report.tables import run_name
from dpr_lab.storage.inspect import info, recover, verify
from dpr_lab.storage.reader import load_run
from dpr_lab.transports import open_transport
from dpr_lab.tui.app import DprApp
from dpr_lab.tui.line_breaks import Hanging, keep_units_whole
from dpr_lab.tui.recorder.attempt import Attempt, Phase
from dpr_lab.tui.recorder.messages import AttemptSeen, Connected, Idle, RecorderFailed
from dpr_lab.tui.recorder.sighting import Sighting
from dpr_lab.tui.steps.capture import CaptureStep
from dpr_lab.tui.terminal.sight import SightSettings
from dpr_lab.tui.widgets import countdown
from dpr_lab.tui.widgets.chart import Chart
from dpr_lab.tui.widgets.countdown import Countdown, new_code
from dpr_lab.tui.widgets.dialogs import Question
from dpr_lab.tui.widgets.key_line import KeyLine
from dpr_lab.tui.widgets.readout import angles_text, rest_text
from dpr_lab.tui.widgets.status_line import StatusLine
from dpr_lab.tui.workspace import load
from firmware_protocol.identity import DeviceInfo
from firmware_protocol.messages import State
from tests.tui.conftest import Watched

SIM = "sim://?seed=1"
SECOND = CaptureOptions(duration=1.0, pose_timeout=600.0, rest_timeout=60.0)

pytestmark = pytest.mark.usefixtures("quick_countdown")


async def connect(pilot: Pilot[None], until, url: str, options: CaptureOptions = SECOND) -> CaptureStep:
    app = pilot.app
    app.workspace.link = url
    await app.services.connect()
    await until(pilot, lambda: app.device.connected)
    await pilot.press("3")
    step = app.query_one(CaptureStep)
    step.options = options
    return step


def in_phase(step: CaptureStep, phase: Phase) -> Callable[[], bool]:
    return lambda: step.attempt is not None and step.attempt.phase is phase


async def to_ready(pilot: Pilot[None], until, step: CaptureStep) -> None:
    await pilot.press("s")
    await until(pilot, in_phase(step, Phase.READY))


async def to_judged(pilot: Pilot[None], until, step: CaptureStep) -> Path:
    await to_ready(pilot, until, step)
    await pilot.press("r")
    await until(pilot, in_phase(step, Phase.JUDGED))
    return step.attempt.captured.run_file


def headline(app: DprApp) -> str:
    return str(app.query_one("#headline", Static).render())


def recorded(app: DprApp) -> list[Path]:
    return sorted((app.workspace.out / "runs").glob("*.mcap"))


@pytest.mark.slow
async def test_three_releases_are_kept_one_for_each_pose(app: DprApp, until, monkeypatch: pytest.MonkeyPatch) -> None:
    rung: list[bool] = []
    monkeypatch.setattr(app, "bell", lambda: rung.append(True))
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM)
        for done in range(1, 4):
            await to_judged(pilot, until, step)
            assert "good" in headline(app)
            await pilot.press("k")
            await until(pilot, lambda done=done: step.outcome() == f"{done} run{'s' if done > 1 else ''}")
        assert app.workspace.runs == recorded(app)
        assert headline(app).startswith("X3: all poses are recorded: n shows the next step.")
    runs = [load_run(file) for file in app.workspace.runs]
    assert [run.pose for run in runs] == ["X1", "X2", "X3"]
    assert len(rung) == 6, "at each go-ahead and at each release, since eyes are on the rods"
    assert all(run.complete and run.t[-1] == 1.0 and not sum(run.lost.values()) for run in runs)
    assert all(verify(file).ok for file in app.workspace.runs)


@pytest.mark.long
async def test_repeat_keeps_the_recording_aside_and_begins_again(app: DprApp, until) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM)
        first = await to_judged(pilot, until, step)
        await pilot.press("a")
        await until(pilot, in_phase(step, Phase.READY))
        assert step.attempt.name == "X1"
        await pilot.press("r")
        await until(pilot, in_phase(step, Phase.JUDGED))
        await pilot.press("k")
        await pilot.pause()
        assert first not in app.workspace.runs
        assert len(app.workspace.runs) == 1
    assert not first.exists()
    assert verify(first.parent / "aside" / first.name).ok


@pytest.mark.slow
async def test_a_degraded_recording_says_why(app: DprApp, until) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM + "&fault=drop=0.02")
        await to_judged(pilot, until, step)
        assert "degraded" in headline(app)
        assert "lost by cause" in str(app.query_one("#readout", Static).render())
        await pilot.press("k")
        await until(pilot, lambda: app.workspace.runs)


@pytest.mark.long
async def test_what_no_check_fails_by_is_said_too(app: DprApp, until) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM, replace(SECOND, until_rest=True, max_duration=1.0))
        await to_judged(pilot, until, step)
        assert "good" in headline(app)
        assert "the rods were still moving" in str(app.query_one("#readout", Static).render())


async def test_off_the_pose_the_release_key_does_nothing(app: DprApp, until, said) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM + "&hand_error=0.3")
        await pilot.press("r")
        await until(pilot, lambda: "press s to be guided" in said(app))
        await pilot.press("s")
        await until(pilot, lambda: step.attempt is not None and step.attempt.error is not None)
        await until(pilot, lambda: "turn -1" in str(app.query_one("#readout", Static).render()))
        await pilot.press("r")
        await until(pilot, lambda: "Not released: bring both rods to the pose" in said(app))
        assert not isinstance(app.screen, Countdown)
        assert step.attempt.latched
        await pilot.press("x")
        await until(pilot, lambda: step.attempt is None)
        await until(pilot, lambda: "stopped by the operator: nothing was released" in said(app))
    assert recorded(app) == []


@pytest.mark.slow
async def test_any_other_key_and_rods_that_move_stop_the_countdown(
    app: DprApp, until, said, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Countdown, "SECOND_S", 600.0)
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM)
        await to_ready(pilot, until, step)
        for key in ("x", "escape", "ctrl+p", "ctrl+c", "1"):
            app.clear_notifications()
            await pilot.press("r", "r")  # the release key itself does not stop it
            assert isinstance(app.screen, Countdown)
            await pilot.press(key)
            if key == "ctrl+p":
                await pilot.press("escape")
            await until(pilot, lambda: "nothing was released, the rods stay held" in said(app))
            assert not isinstance(app.screen, Countdown)
            seen = step.attempt.rest
            await until(pilot, lambda seen=seen: step.attempt.rest is not seen)
            assert step.attempt.phase is Phase.READY
            assert step.attempt.latched
        await pilot.press("r")
        assert isinstance(app.screen, Countdown)
        rest = step.attempt.rest
        moving = type(rest)(rest.theta, rest.error, rest.tolerance, 0.5, rest.spread, False, "the rods still moved")
        app.clear_notifications()
        step.hear(AttemptSeen(step.attempt.number, moving, True, time.monotonic()))
        await until(pilot, lambda: "nothing was released" in said(app))
        assert not isinstance(app.screen, Countdown)
    assert recorded(app) == []


@pytest.mark.slow
async def test_what_stops_the_countdown_is_named(app: DprApp, until, said, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Countdown, "SECOND_S", 600.0)

    async def shrink(pilot: Pilot[None]) -> None:
        await pilot.resize_terminal(30, 10)

    async def leave(pilot: Pilot[None]) -> None:
        app.post_message(events.AppBlur())

    ways = {
        "the mouse was clicked": lambda pilot: pilot.click("#asked"),
        "the terminal lost the focus": leave,
        "the window became too small to show the countdown": shrink,
    }
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM)
        await to_ready(pilot, until, step)
        for why, way in ways.items():
            await pilot.press("r")
            assert isinstance(app.screen, Countdown)
            assert step.counting_down
            await until(pilot, lambda: "RELEASING" in str(app.query_one(StatusLine).render()))
            assert "Any key but r stops it" in headline(app)
            await way(pilot)
            await until(pilot, lambda why=why: f"Not released: {why}; nothing was released" in said(app))
            await until(pilot, lambda: "RELEASING" not in str(app.query_one(StatusLine).render()))
    assert recorded(app) == []


@pytest.mark.slow
async def test_in_a_multiplexer_the_code_that_is_shown_is_typed_before_the_countdown(
    app: DprApp, until, said, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Watched, "multiplexer", "tmux")
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM)
        await to_ready(pilot, until, step)
        await pilot.press("r")
        first = code(app)
        assert "Any other key stops it" in headline(app)
        await pilot.press("r", first[0], "r", "1")
        assert "the key 1 was pressed, which is not the next letter of the code" in said(app)
        await pilot.press("r")
        assert code(app) != first
        assert not app.screen.query_one(Digits).display
        await pilot.pause(1.0)  # the countdown of these tests takes 0.15 s
        assert step.attempt.phase is Phase.READY
        await pilot.press(*code(app))
        await until(pilot, in_phase(step, Phase.JUDGED))
    assert len(recorded(app)) == 1


@pytest.mark.slow
async def test_a_code_that_nobody_types_ends_the_countdown(
    app: DprApp, until, said, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Watched, "multiplexer", "tmux")
    monkeypatch.setattr(countdown, "SIGHT", SightSettings(code_s=0.2))
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM)
        await to_ready(pilot, until, step)
        await pilot.press("r")
        await until(pilot, lambda: "Not released: the code was not typed within 0.2 s" in said(app))
    assert recorded(app) == []


def code(app: DprApp) -> str:
    return str(app.screen.query_one("#asked", Static).render()).split()[3]


def test_a_code_has_different_letters_none_of_them_a_release_key() -> None:
    codes = [new_code(random.Random(seed), frozenset({"r", "space"})) for seed in range(200)]
    assert all(len(set(each)) == 3 and "r" not in each for each in codes)
    assert len(set(codes)) > 150


async def test_from_the_order_to_the_open_latch_nothing_says_closed(app: DprApp) -> None:
    # For 0.24 s after the latch opened, headline and status row said CLOSED.
    async with app.run_test(size=(80, 24)) as pilot:
        device = app.device
        device.connected = Connected(SIM, DeviceInfo("1.0.0", "1", (16384,) * 3, 4000, 1000), 1000, (), "")
        await pilot.press("3")
        step = app.query_one(CaptureStep)
        step.attempt = Attempt(1, "X1", step._rig.poses["X1"])
        status = app.query_one(StatusLine)

        def shown(report: AttemptSeen) -> str:
            device.note(report)
            for each in app.steps:
                each.hear(report)
            texts = (headline(app), app.query_one("#readout", Static).render(), status.render())
            return " | ".join(map(str, texts))

        theta, now = (0.0, math.pi, 0.1), time.monotonic()
        rest = RestReading(theta, (0.0, 0.0), 0.1, 0.0, 0.0, ok=True, restless="")
        assert "CLOSED" in shown(AttemptSeen(1, rest, latched=True, at=now))
        device.ordered = now
        for seconds in (0.01, 0.1, 0.2, 0.3):
            between = shown(AttemptSeen(1, rest, latched=True, at=now + seconds))
            assert "CLOSED" not in between
            assert "RELEASE" in between
        opened = shown(AttemptSeen(1, Released(1000, Path("run.mcap")), latched=False, at=now + 0.4))
        assert "CLOSED" not in opened
        assert "OPEN" in opened
        assert device.ordered is None


async def test_a_release_whose_outcome_is_unknown_stays_in_sight(app: DprApp, said) -> None:
    # "RELEASE was sent, the rods may be free" vanished within 34 s and "CLOSED when last seen" remained.
    async with app.run_test(size=(80, 24)) as pilot:
        device = app.device
        device.connected = Connected(SIM, DeviceInfo("1.0.0", "1", (16384,) * 3, 4000, 1000), 1000, (), "")
        await pilot.press("3")
        step = app.query_one(CaptureStep)
        step.attempt = Attempt(1, "X1", step._rig.poses["X1"])

        def hear(report) -> str:
            device.note(report)
            for each in app.steps:
                each.hear(report)
            return f"{headline(app)} | {app.query_one('#readout', Static).render()}"

        now = time.monotonic()
        hear(Idle((0.0, 3.1, 0.1), True, now))
        device.ordered = now
        lost = hear(RecorderFailed(1, "no answer to RELEASE; RELEASE was sent, so the rods may be free", alive=False))
        assert "DEVICE LOST: RELEASE was sent, the rods may be free" in lost
        assert "latch  ? UNKNOWN" in lost
        assert "CLOSED" not in lost
        await pilot.pause()
        assert [notice.severity for notice in app._notifications] == ["error"]
        device.connected, device.lost = device.lost, None
        early = hear(Idle((0.0, 3.1, 0.1), True, now + 1.0))
        assert "the rods may be free: keep clear until the latch is seen again" in early
        assert "CLOSED" not in early
        assert device.ordered is not None
        hear(Idle((0.0, 3.1, 0.1), False, now + 1.1))
        assert device.ordered is None
        device.ordered = now
        hear(Idle((0.0, 3.1, 0.1), True, now + 10.0))
        assert device.ordered is None


@pytest.mark.slow
async def test_quitting_during_the_countdown_releases_nothing(app: DprApp, until, cable) -> None:
    port = cable()
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, port.url)
        await to_ready(pilot, until, step)
        Countdown.SECOND_S = 600.0
        await pilot.press("r")
        await pilot.press("ctrl+q")
    assert recorded(app) == []
    assert state_of(port.url) == (State.HOLDING, True)


@pytest.mark.long
async def test_a_cable_pulled_while_recording_costs_the_rest_of_the_swing_only(app: DprApp, until, said, cable) -> None:
    port = cable()
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, port.url, CaptureOptions(duration=60.0, pose_timeout=600, rest_timeout=60))
        await to_ready(pilot, until, step)
        await pilot.press("r")
        await until(pilot, lambda: step.attempt.recorded is not None and step.attempt.recorded.t > 0.5)
        assert step.at_stake() == "The current recording ends now; the data recorded so far are kept."
        await pilot.press("1", "z")
        await until(pilot, lambda: "A capture is under way: end it first" in said(app))
        await pilot.press("3")
        seen = step.attempt.recorded.samples
        port.pull()
        await until(pilot, lambda: step.attempt is None)
        await until(pilot, lambda: "the data recorded so far are kept in" in said(app))
        assert step.missing().startswith("Capture needs a device")
        (partial,) = recorded(app)
        assert not info(partial).complete
        assert info(partial).samples >= seen
        whole = partial.with_name("whole.mcap")
        assert recover(partial, whole) >= seen
        assert load_run(whole).pose == "X1"

        port.plug()
        step.options = SECOND
        await pilot.press("c")
        await until(pilot, lambda: app.device.connected)
        await to_judged(pilot, until, step)
        await pilot.press("k")
        await until(pilot, lambda: len(app.workspace.runs) == 1)
    assert partial.exists()


async def test_length_and_repeats_are_chosen_by_keys(app: DprApp, until) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("3")
        step = app.query_one(CaptureStep)
        await pilot.press("d", "d", "d", "d")
        assert step.options.until_rest
        await pilot.press("d")
        assert (step.options.until_rest, step.options.duration) == (False, 5.0)
        await pilot.press("f", "down")
        plan = str(app.query_one("#checklist", Static).render())
        assert "▶ X2 ○○ 0 of 2" in plan
        assert "record for 5 s" in plan
        await pilot.press("s")
        assert step.attempt is None


async def test_the_page_asks_for_what_is_left_to_do(app: DprApp, monkeypatch: pytest.MonkeyPatch) -> None:
    # The latch was told to close that was closed, and red arrows turned rods that had nowhere to go any more.
    monkeypatch.setattr(Sighting, "fresh", lambda *_: True)
    async with app.run_test(size=(80, 24)) as pilot:
        app.device.connected = Connected(SIM, DeviceInfo("1.0.0", "1", (16384,) * 3, 4000, 1000), 1000, (), "")
        await pilot.press("3")
        step, readout = app.query_one(CaptureStep), app.query_one("#readout", Static)

        def seen(latched: bool) -> str:
            app.device.note(idle := Idle((0.0, 1.0, 1.0), latched, time.monotonic()))
            step.hear(idle)
            return headline(app)

        assert seen(False) == "X1: press s: the latch closes and you are guided to the pose"
        assert seen(True) == "X1: the latch is closed; press s to be guided to the pose"
        assert "turn" in str(readout.render())
        app.workspace.runs = [Path(f"20261121T101500Z_X{n}_1.mcap") for n in (1, 2, 3)]
        assert "all poses are recorded" in seen(False)
        assert "turn" not in str(readout.render())
        assert "θ1 +57.3°" in str(readout.render())
        await pilot.press("f")
        assert "turn" in str(readout.render())


async def test_keep_and_again_are_offered_only_for_a_recording_that_waits(app: DprApp, tmp_path: Path) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("3")

        def offered() -> set[str]:
            return {active.binding.id or "" for active in app.screen.active_bindings.values()}

        assert not {"capture.keep", "capture.again"} & offered()
        app.workspace.undecided = tmp_path / "20261121T101500Z_X1_1.mcap"
        app.query_one(CaptureStep).enter()
        await pilot.pause()
        assert {"capture.keep", "capture.again"} <= offered()
        assert "k Keep a Again" in str(app.query_one(KeyLine).render())


async def test_a_swing_that_ended_early_is_named_so_and_angles_have_no_whole_turns(app: DprApp) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("3")
        step = app.query_one(CaptureStep)
        attempt = Attempt(1, "X1", step._rig.poses["X1"])
        t = np.linspace(0.0, 1.0, 101)
        theta = np.stack([0 * t, np.pi - 8 * np.pi + 0 * t, 0.1 + 8 * np.pi * (t - 1)], axis=1)
        attempt.hear(AttemptSeen(1, SwingReading(1.0, (0.0, 0.0, 0.0), (0.0, 0.0), 101, (t, theta)), False, 0.0))
        step._ended = attempt
        step.enter()
        chart = app.query_one("#swing", Chart)
        assert chart._content.y_label.startswith("last swing, ended early: angle")
        inner, outer = (series.y for series in chart._content.series)
        assert inner[0] == pytest.approx(180.0)
        assert (outer[0], outer[-1]) == pytest.approx((5.73, 5.73 + 4 * 360), abs=0.01)
    assert angles_text((-0.1, math.radians(-1615.0), math.radians(179.9 + 360)), UNITS["degrees"]) == (
        "θ0 -5.7°  θ1 +185.0°  θ2 +179.9°"
    )
    assert angles_text((6.2, math.radians(359.0), math.radians(-89.0)), UNITS["degrees"]) == (
        "θ0 -4.8°  θ1 -1.0°  θ2 -89.0°"
    )


def test_the_limit_that_failed_is_named(paper) -> None:
    # "moving (limit 0.02 rad/s), 0.014 rad/s": the limit that was shown had been kept.
    shaking = RestReading((0.0, 3.1, 0.1), (0.0, 0.0), 0.05, 0.014, 0.01, False, "")
    drifting = replace(shaking, speed=0.03, spread=0.0)
    assert "vibration 0.01 rad (limit 0.0" in str(rest_text(shaking, paper, UNITS["radians"]))
    assert "rad/s" not in str(rest_text(shaking, paper, UNITS["radians"]))
    assert "drift 0.0300 rad/s (limit 0.0200 rad/s)" in str(rest_text(drifting, paper, UNITS["radians"]))
    assert "shaking" not in str(rest_text(drifting, paper, UNITS["radians"]))


def test_what_follows_a_label_or_a_mark_stays_below_the_text(paper) -> None:
    keep_units_whole()
    reading = rest_text(RestReading((0.0, 3.1, 0.1), (0.0, 0.0), 0.05, 0.03, 0.0, False, ""), paper, UNITS["radians"])
    reason = Content("✘ lost by cause: crc 12, 0.12 % of the samples")
    shown = Hanging(Content("\n").join([reading, Content.styled("plain words that are long", "bold"), reason]))
    style, options = Style(), RenderOptions(lambda _: Style(), {})
    assert [strip.text.rstrip() for strip in shown.render_strips(30, None, style, options)] == [
        "rest   ✘ drift 0.0300 rad/s",
        "         (limit 0.0200 rad/s)",
        "plain words that are long",
        "✘ lost by cause: crc 12,",
        "  0.12 % of the samples",
    ]
    assert shown.get_height({}, 30) == 5


@pytest.mark.slow
async def test_quitting_before_a_swing_is_kept_asks_and_the_next_start_offers_it(app: DprApp, until, tmp_path) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM)
        run = await to_judged(pilot, until, step)
        await pilot.press("ctrl+q")
        assert isinstance(app.screen, Question)
        assert f"the file of {run_name(run)} is kept, and the next session asks again (k in Capture keeps it)" in str(
            app.screen.query_one(Static).render()
        )
        await pilot.press("y")
    workspace, notices = load(tmp_path / "state")
    assert workspace.runs == []
    again = DprApp(workspace, tmp_path / "state", notices=notices)
    async with again.run_test(size=(80, 24)) as pilot:
        await until(pilot, lambda: again.current.NAME == "Capture")
        assert f"{run_name(run)}: not decided yet. k: keep it" in headline(again)
        await pilot.press("k")
        await pilot.pause()
        assert again.workspace.runs == [run]
        assert again.workspace.undecided is None


def state_of(url: str) -> tuple[State, bool]:
    with Device(open_transport(url)) as device:
        device.connect()
        while device.status is None:
            device.poll(0.1)
        return device.status.state, device.status.latched
