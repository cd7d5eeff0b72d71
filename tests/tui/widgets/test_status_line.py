"""Status line: recording and running jobs with elapsed and remaining time."""

import math
from pathlib import Path

import pytest
from textual.widgets import ContentSwitcher

from dpr_lab.tui.app import STEPS, DprApp
from dpr_lab.tui.recorder.messages import Connected
from dpr_lab.tui.recorder.sighting import Sighting
from dpr_lab.tui.steps.capture import CaptureStep
from dpr_lab.tui.widgets.status_line import StatusLine
from dpr_lab.tui.workspace import Workspace
from firmware_protocol.identity import DeviceInfo

INFO = DeviceInfo("1.0.0", "000051d000000001", (16384, 16384, 16384), 4000, 1000)
SIMULATED = Connected("sim://", INFO, 1000, (), "")


@pytest.mark.slow
async def test_every_step_shows_that_a_recording_runs_and_how_long_work_takes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, until
) -> None:
    app = DprApp(Workspace(out=tmp_path), tmp_path / "state")
    monkeypatch.setattr(CaptureStep, "urgent", "● REC X1 3 of 10 s")
    monkeypatch.setattr(STEPS[5], "work", "Diagnose 35 s, about 20 s left")
    async with app.run_test(size=(80, 24)) as pilot:
        line = app.query_one(StatusLine)
        for number, step in enumerate(STEPS, 1):
            await pilot.press(str(number))
            assert app.query_one(ContentSwitcher).current == step.NAME.lower()
            await until(pilot, lambda: "● REC X1 3 of 10 s" in str(line.render()))
            assert "Diagnose 35 s, about 20 s left" in str(line.render())
            assert len("  ".join(str(line.render()).split("  ")[:2])) < 78
        monkeypatch.setattr(STEPS[3], "work", "Identify 40 s, search at most 30 s more")
        app.device.connected, app.device.seen = SIMULATED, Sighting(latched=True, at=math.inf)
        words = ("SIMULATED", "latch", "● REC X1 3 of 10 s", "Identify, Diagnose")
        await until(pilot, lambda: all(word in str(line.render()) for word in words))
        shown = str(line.render())
        assert "Identify 40 s" not in shown
        assert len(shown) <= 78
