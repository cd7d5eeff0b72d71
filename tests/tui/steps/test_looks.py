"""Snapshots of steps from fixed data; `tests/tui/test_themes.py` checks the colours of the other themes."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from textual.pilot import Pilot
from textual.widgets import Input

from dpr_lab.acquisition.capture import Captured, Released, SwingReading
from dpr_lab.acquisition.gate import Check, QualityReport
from dpr_lab.acquisition.holding import PoseReading, RestReading
from dpr_lab.transports.discover import Links, SerialPortFound
from dpr_lab.tui.app import DprApp
from dpr_lab.tui.recorder.attempt import Attempt
from dpr_lab.tui.recorder.messages import (
    AttemptFinished,
    AttemptSeen,
    Connected,
    Exercised,
    GoAheadAsked,
    Idle,
    RecorderFailed,
    RecorderReport,
)
from dpr_lab.tui.recorder.sighting import Sighting
from dpr_lab.tui.steps import connect
from dpr_lab.tui.steps.capture import CaptureStep
from dpr_lab.tui.steps.connect import ConnectStep
from dpr_lab.tui.steps.rig import RigStep
from firmware_protocol.clock import ClockFit
from firmware_protocol.identity import DeviceInfo

INFO = DeviceInfo("1.0.0", "000051d000000001", (16384, 16384, 16384), 4000, 1000)
LOAD = "1000 Hz needs 140,000 bit/s, 15 % of 921600 baud (at most 80 % may be used)"
CONNECTED = Connected("serial:///dev/ttyACM0?baud=921600", INFO, 1000, (LOAD,), "")
CLOCK = ClockFit(0.0, 54e-6, 1.2, 11.4, 185e-6, 5, 1e-3)
NONE_LOST = {"device_overrun": 0, "crc": 0, "framing": 0, "tick_gap": 0}
PORT = SerialPortFound("/dev/ttyACM0", "DPR board", "51D0", "")

OFF = PoseReading((0.0, 3.13, 0.35), (-0.0116, 0.25), 0.05, ok=False)
STILL = RestReading((0.0, 3.13, 0.12), (-0.0116, 0.02), 0.05, 0.001, 0.0003, ok=True, restless="")


def recorded() -> SwingReading:
    t = np.linspace(-1.0, 6.0, 701)
    swing = np.where(t < 0, 0.0, 1.0) * np.exp(-0.2 * t)
    theta = np.stack([0 * t, np.pi + 0.8 * swing * np.sin(6 * t), np.pi - 2.9 * swing * np.cos(4 * t)], axis=1)
    theta[t < 0, 2] = 0.12
    angles = (0.0, float(theta[-1, 1]), float(theta[-1, 2]))
    return SwingReading(6.0, angles, (1.25, -3.5), 7001, (t, theta))


def judged(ok: bool) -> AttemptFinished:
    reason = "lost samples: crc 12, 0.12 % of the samples (limit 0.1 %): check cable and rate"
    checks = (Check("pose", True, 0.02, 0.05, "rad", "fine"), Check("lost", ok, 0.0012, 1e-3, "1", reason))
    lost = NONE_LOST if ok else NONE_LOST | {"crc": 12}
    file = Path("20261121T101500Z_X1_00000001.mcap")
    return AttemptFinished(1, Captured(file, QualityReport(checks), 1000, 10.0, lost, (0.0, 3.13, 0.12)), CLOCK)


NOW = 0.0
"""Time of all readings. In these snapshots no reading becomes outdated."""
PLACING = (AttemptSeen(1, OFF, True, NOW, NONE_LOST),)
READY = (*PLACING, AttemptSeen(1, STILL, True, NOW, NONE_LOST), GoAheadAsked(1))
SWINGING = (
    *READY,
    AttemptSeen(1, Released(1000, Path("a.mcap")), False, NOW),
    AttemptSeen(1, recorded(), False, NOW, NONE_LOST),
)
WRONG = "serial:///dev/ttyACM0: 412 bytes arrived, but no valid frame"

SCENES: dict[str, tuple[str, tuple[RecorderReport, ...]]] = {
    "connect-none": ("1", ()),
    "connect-wrong": ("1", (RecorderFailed(None, WRONG, False),)),
    "connect-done": ("1", (Idle((0.0, np.pi, np.pi), False, NOW), Exercised(1999, NONE_LOST, CLOCK))),
    "rig": ("2", ()),
    "capture-idle": ("3", (Idle((0.0, np.pi, np.pi), False, NOW),)),
    "capture-placing": ("3", PLACING),
    "capture-ready": ("3", READY),
    "capture-recording": ("3", SWINGING),
    "capture-good": ("3", (*SWINGING, judged(True))),
    "capture-degraded": ("3", (*SWINGING, judged(False))),
}


async def show(app: DprApp, scene: str, pilot: Pilot[None], until) -> None:
    key, reports = SCENES[scene]
    step = app.query_one(CaptureStep)
    if scene not in ("connect-none", "connect-wrong"):
        app.device.connected = CONNECTED
    await until(pilot, lambda: app.query_one("#links").option_count)
    await pilot.press(key)
    if scene.startswith("capture") and scene != "capture-idle":
        step.attempt = Attempt(1, "X1", app.query_one(CaptureStep)._rig.poses["X1"])
    for report in reports:
        app.device.note(report)
        for each in app.steps:
            each.hear(report)
    app.clear_notifications()


@pytest.fixture
def looks(app: DprApp, monkeypatch: pytest.MonkeyPatch) -> Callable[[], DprApp]:
    monkeypatch.setattr(Sighting, "fresh", lambda sighting, now: sighting.at == NOW)
    monkeypatch.setattr(connect, "discover", lambda: Links((PORT,), ("can0",), ()))
    Input.cursor_blink = False

    return lambda: DprApp(app.workspace, app.folder, steps=(ConnectStep, RigStep, CaptureStep))


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
async def test_scene(looks, until, snapshot, scene: str) -> None:
    app = looks()
    async with app.run_test(size=(80, 24)) as pilot:
        await show(app, scene, pilot, until)
        await snapshot(pilot, scene)
