"""Capture of a rig whose arm is driven: the arm from above, its angle, and its input."""

from dataclasses import replace

import numpy as np
import pytest
from textual.widgets import Input

from dpr_lab.acquisition.capture import Released
from dpr_lab.transports.discover import Links
from dpr_lab.tui.app import DprApp
from dpr_lab.tui.recorder.attempt import Attempt
from dpr_lab.tui.recorder.messages import AttemptSeen, Idle
from dpr_lab.tui.recorder.sighting import Sighting
from dpr_lab.tui.steps import connect
from dpr_lab.tui.steps.capture import CaptureStep
from dpr_lab.tui.steps.connect import ConnectStep
from dpr_lab.tui.steps.rig import RigStep
from dpr_lab.tui.widgets.chart import Chart
from dpr_lab.tui.widgets.pendulum import ArmAbove, Pendulum
from tests.tui.steps.test_looks import CONNECTED, NONE_LOST, NOW, READY, recorded


@pytest.fixture
def driven(app: DprApp, monkeypatch: pytest.MonkeyPatch) -> DprApp:
    monkeypatch.setattr(Sighting, "fresh", lambda sighting, now: sighting.at == NOW)
    monkeypatch.setattr(connect, "discover", lambda: Links((), (), ()))
    Input.cursor_blink = False
    app.workspace.rig = "furuta"
    return DprApp(app.workspace, app.folder, steps=(ConnectStep, RigStep, CaptureStep))


def swinging():
    swing = recorded()
    t, theta = swing.fresh
    theta = theta.copy()
    theta[:, 0] = np.where(t < 0, 0.0, 0.6 * np.sin(3 * t))
    volts = np.where(t < 0, 0.0, 2.0 * np.sin(3 * t + 0.5))
    angles = (float(theta[-1, 0]), swing.theta[1], swing.theta[1])
    return replace(swing, theta=angles, fresh=(t, theta), inputs=volts)


async def shown(app: DprApp, pilot, until, reports) -> CaptureStep:
    step = app.query_one(CaptureStep)
    app.device.connected = CONNECTED
    await pilot.press("3")
    await until(pilot, lambda: step._rig is not None)
    step.attempt = Attempt(1, "X1", step._rig.poses["X1"])
    for report in reports:
        app.device.note(report)
        for each in app.steps:
            each.hear(report)
    app.clear_notifications()
    return step


@pytest.mark.slow
async def test_a_driven_swing_shows_the_arm_and_its_input(driven, until, snapshot):
    from pathlib import Path

    reports = (
        *READY,
        AttemptSeen(1, Released(1000, Path("a.mcap")), False, NOW),
        AttemptSeen(1, swinging(), False, NOW, NONE_LOST),
    )
    async with driven.run_test(size=(100, 30)) as pilot:
        await shown(driven, pilot, until, reports)
        assert driven.query_one(ArmAbove).display
        assert driven.query_one("#input", Chart).display
        await snapshot(pilot, "capture-driven-arm")


async def test_the_rod_is_drawn_at_once_next_to_its_arm(driven, until):
    async with driven.run_test(size=(80, 24)) as pilot:
        driven.device.connected = CONNECTED
        driven.device.note(Idle((0.0, 3.1, 3.1), False, NOW))
        await pilot.press("2")
        await pilot.pause()
        await pilot.press("pagedown")
        await pilot.pause()
        await pilot.press("3")
        pendulum = driven.query_one(Pendulum)
        await until(pilot, lambda: pendulum.size.width > 1)
        await until(pilot, lambda: pendulum._canvas_size == pendulum.size)


async def test_a_clamped_arm_is_not_drawn_from_above(app, until, monkeypatch):
    monkeypatch.setattr(Sighting, "fresh", lambda sighting, now: sighting.at == NOW)
    async with app.run_test(size=(80, 24)) as pilot:
        await shown(app, pilot, until, READY)
        assert not app.query_one(ArmAbove).display
        assert not app.query_one("#input", Chart).display


def test_inputs_are_kept_with_the_samples_they_belong_to():
    from dpr_lab.rig_tables import Pose

    attempt = Attempt(1, "X1", Pose(theta1=2.0, theta2=2.0))
    swing = swinging()
    attempt.hear(AttemptSeen(1, swing, False, NOW))
    assert np.array_equal(attempt.inputs, swing.inputs)
    attempt.hear(AttemptSeen(1, replace(swing, inputs=None), False, NOW))
    assert not len(attempt.inputs)
