"""Page of the step Capture without a device: texts on rods, latch and recordings."""

# pyright: reportOptionalMemberAccess=false, reportOptionalSubscript=false

import math
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from textual.widgets import Static

from dpr_lab.acquisition.capture import Released, SwingReading
from dpr_lab.acquisition.holding import RestReading
from dpr_lab.report.angles import UNITS
from dpr_lab.tui.app import DprApp
from dpr_lab.tui.recorder.attempt import Attempt
from dpr_lab.tui.recorder.messages import AttemptSeen, Connected, Idle, RecorderFailed
from dpr_lab.tui.recorder.sighting import Sighting
from dpr_lab.tui.steps.capture import CaptureStep
from dpr_lab.tui.widgets.chart import Chart
from dpr_lab.tui.widgets.key_line import KeyLine
from dpr_lab.tui.widgets.readout import angles_text, rest_text
from dpr_lab.tui.widgets.status_line import StatusLine
from firmware_protocol.identity import DeviceInfo
from tests.tui.steps.releases import SIM, headline


async def test_from_the_command_to_the_open_latch_nothing_shows_it_as_closed(app: DprApp) -> None:
    # For 0.24 s after the latch opened, headline and status row said CLOSED.
    async with app.run_test(size=(80, 24)) as pilot:
        device = app.device
        device.connected = Connected(SIM, DeviceInfo("1.0.0", "1", (16384, 16384, 16384), 4000, 1000), 1000, (), "")
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


async def test_a_release_whose_outcome_is_unknown_stays_in_sight(app: DprApp, notices_text) -> None:
    # "RELEASE was sent, the rods may be free" vanished within 34 s and "CLOSED when last seen" remained.
    async with app.run_test(size=(80, 24)) as pilot:
        device = app.device
        device.connected = Connected(SIM, DeviceInfo("1.0.0", "1", (16384, 16384, 16384), 4000, 1000), 1000, (), "")
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
        assert [notice.severity for notice in app.notices] == ["error"]
        device.connected, device.lost = device.lost, None
        early = hear(Idle((0.0, 3.1, 0.1), True, now + 1.0))
        assert "the rods may be free: keep clear until the state of the latch is known again" in early
        assert "CLOSED" not in early
        assert device.ordered is not None
        hear(Idle((0.0, 3.1, 0.1), False, now + 1.1))
        assert device.ordered is None
        device.ordered = now
        hear(Idle((0.0, 3.1, 0.1), True, now + 10.0))
        assert device.ordered is None


@pytest.mark.parametrize(("unwritten", "severity"), [(True, "error"), (False, "warning")])
async def test_a_full_disk_stays_in_sight_until_the_operator_acts(app: DprApp, unwritten: bool, severity: str) -> None:
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.press("3")
        message = "a.mcap: cannot be written: No space left on device"
        failed = RecorderFailed(1, message, alive=True, unwritten=unwritten)
        for step in app.steps:
            step.hear(failed)
        await pilot.pause()
        (notice,) = app.notices
        assert (notice.severity, notice.message) == (severity, message)


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
    # The screen once closed a latch that was closed, and its arrows pointed beyond the pose.
    monkeypatch.setattr(Sighting, "fresh", lambda *_: True)
    async with app.run_test(size=(80, 24)) as pilot:
        app.device.connected = Connected(SIM, DeviceInfo("1.0.0", "1", (16384, 16384, 16384), 4000, 1000), 1000, (), "")
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
        assert chart._content.y_label.startswith("ended early: angle")
        assert chart._legend().cell_len <= 78
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
