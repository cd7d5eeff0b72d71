"""The countdown before a release: what starts it, and what stops it."""

# pyright: reportOptionalMemberAccess=false, reportOptionalSubscript=false

import random
import time
from dataclasses import replace

import pytest
from textual import events
from textual.pilot import Pilot
from textual.widgets import Digits, Static

from dpr_lab.acquisition.device import Device
from dpr_lab.transports import open_transport
from dpr_lab.tui.app import DprApp
from dpr_lab.tui.recorder.attempt import Phase
from dpr_lab.tui.recorder.messages import AttemptSeen
from dpr_lab.tui.steps.capture import CaptureStep
from dpr_lab.tui.terminal.sight import SightSettings
from dpr_lab.tui.widgets import countdown
from dpr_lab.tui.widgets.countdown import Countdown, new_code
from dpr_lab.tui.widgets.status_line import StatusLine
from firmware_protocol.messages import State
from tests.tui.conftest import Watched
from tests.tui.steps.releases import SIM, connect, headline, in_phase, recorded, to_ready

pytestmark = pytest.mark.usefixtures("quick_countdown")


@pytest.mark.slow
async def test_off_the_pose_the_release_key_does_nothing(app: DprApp, until, notices_text) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM + "&hand_error=0.3")
        await pilot.press("r")
        await until(pilot, lambda: "press s to be guided" in notices_text(app))
        await pilot.press("s")
        await until(pilot, lambda: step.attempt is not None and step.attempt.error is not None)
        await until(pilot, lambda: "turn -1" in str(app.query_one("#readout", Static).render()))
        await pilot.press("r")
        await until(pilot, lambda: "Not released: bring every rod to the pose" in notices_text(app))
        assert not isinstance(app.screen, Countdown)
        assert step.device.seen.latched
        await pilot.press("x")
        await until(pilot, lambda: step.attempt is None)
        await until(pilot, lambda: "stopped by the operator: nothing was released" in notices_text(app))
    assert recorded(app) == []


@pytest.mark.slow
async def test_any_other_key_and_rods_that_move_stop_the_countdown(
    app: DprApp, until, notices_text, monkeypatch: pytest.MonkeyPatch
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
            await until(pilot, lambda: "nothing was released, the rods stay held" in notices_text(app))
            assert not isinstance(app.screen, Countdown)
            seen = step.attempt.rest
            await until(pilot, lambda seen=seen: step.attempt.rest is not seen)
            assert step.attempt.phase is Phase.READY
            assert step.device.seen.latched
        await pilot.press("r")
        assert isinstance(app.screen, Countdown)
        rest = step.attempt.rest
        assert rest is not None
        moving = replace(rest, speed=0.5, ok=False, restless="the rods still moved")
        app.clear_notifications()
        step.hear(AttemptSeen(step.attempt.number, moving, True, time.monotonic()))
        await until(pilot, lambda: "nothing was released" in notices_text(app))
        assert not isinstance(app.screen, Countdown)
        step.hear(AttemptSeen(step.attempt.number, rest, True, time.monotonic()))
        await what_stops_the_countdown_is_named(pilot, app, until, notices_text)
    assert recorded(app) == []


async def what_stops_the_countdown_is_named(pilot: Pilot[None], app: DprApp, until, notices_text) -> None:
    async def shrink(pilot: Pilot[None]) -> None:
        await pilot.resize_terminal(30, 10)

    async def leave(pilot: Pilot[None]) -> None:
        app.post_message(events.AppBlur())

    ways = {
        "the mouse was clicked": lambda pilot: pilot.click("#asked"),
        "the terminal lost the focus": leave,
        "the window became too small to show the countdown": shrink,
    }
    step = app.query_one(CaptureStep)
    for why, way in ways.items():
        await until(pilot, in_phase(step, Phase.READY))
        await pilot.press("r")
        assert isinstance(app.screen, Countdown)
        assert step.urgent == "RELEASING"
        await until(pilot, lambda: "RELEASING" in str(app.query_one(StatusLine).render()))
        assert "Any key but r stops it" in headline(app)
        await way(pilot)
        await until(pilot, lambda why=why: f"Not released: {why}; nothing was released" in notices_text(app))
        await until(pilot, lambda: "RELEASING" not in str(app.query_one(StatusLine).render()))


@pytest.mark.slow
async def test_in_a_multiplexer_the_code_that_is_shown_is_typed_before_the_countdown(
    app: DprApp, until, notices_text, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Watched, "multiplexer", "tmux")
    async with app.run_test(size=(80, 24)) as pilot:
        step = await connect(pilot, until, SIM)
        await to_ready(pilot, until, step)
        with monkeypatch.context() as impatient:
            impatient.setattr(countdown, "SIGHT", SightSettings(code_s=0.2))
            await pilot.press("r")
            await until(pilot, lambda: "Not released: the code was not typed within 0.2 s" in notices_text(app))
        await pilot.press("r")
        first = code(app)
        assert "Any other key stops it" in headline(app)
        await pilot.press("r", first[0], "r", "1")
        assert "the key 1 was pressed, which is not the next letter of the code" in notices_text(app)
        await pilot.press("r")
        assert code(app) != first
        assert not app.screen.query_one(Digits).display
        await pilot.pause(1.0)  # the countdown of these tests takes 0.15 s
        assert step.attempt.phase is Phase.READY
        await pilot.press(*code(app))
        await until(pilot, in_phase(step, Phase.JUDGED))
    assert len(recorded(app)) == 1


def code(app: DprApp) -> str:
    return str(app.screen.query_one("#asked", Static).render()).split()[3]


def test_a_code_has_different_letters_none_of_them_a_release_key() -> None:
    codes = [new_code(random.Random(seed), frozenset({"r", "space"})) for seed in range(200)]
    assert all(len(set(each)) == 3 and "r" not in each for each in codes)
    assert len(set(codes)) > 150


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


def state_of(url: str) -> tuple[State, bool]:
    with Device(open_transport(url)) as device:
        device.connect()
        while device.status is None:
            device.poll(0.1)
        return device.status.state, device.status.latched
