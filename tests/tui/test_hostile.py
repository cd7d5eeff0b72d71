"""Texts of files and devices that would control the terminal, and a state folder that is not a folder."""

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from textual.app import App
from textual.widgets import Static

from dpr_lab.errors import DprError
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.writer import RunWriter
from dpr_lab.transports.discover import Links, SerialPortFound
from dpr_lab.tui.app import STEPS, DprApp
from dpr_lab.tui.recorder.messages import Connected, RecorderFailed
from dpr_lab.tui.steps import connect
from dpr_lab.tui.steps.identify import IdentifyStep
from dpr_lab.tui.widgets.run_browser import RunBrowser
from dpr_lab.tui.workspace import Workspace, load
from firmware_protocol.identity import DeviceInfo

EVIL = "\x1b[2J\x1b]0;owned\x07\x9b31m\u202egnirts\r\x08[red]"
CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")


def strips(app: App[None]) -> Iterator[str]:
    """Every line as it is sent to the terminal, segment by segment."""
    for strip in app.screen._compositor.render_strips():
        yield from (segment.text for segment in strip)


def drawn(app: App[None]) -> str:
    text = "".join(strips(app))
    assert CONTROLS.findall(text) == []
    return text


@pytest.fixture
def hostile(paper, tmp_path: Path) -> Path:
    """Valid run whose file name, note and device contain control characters."""
    path = tmp_path / f"bench{EVIL}" / "runs" / f"20261121T101500Z_{EVIL}_1.mcap"
    path.parent.mkdir(parents=True)
    meta = RunMetadata(paper, "X1", 1000, note=EVIL, url=EVIL, uid=EVIL, firmware=EVIL)
    with RunWriter(path, meta) as writer:
        writer.finish(RunSummary(0, notes=(EVIL,)))
    return path


@pytest.mark.slow
async def test_names_notes_and_devices_cannot_steer_the_terminal(
    hostile: Path, tmp_path: Path, until, monkeypatch: pytest.MonkeyPatch
) -> None:
    port = SerialPortFound("/dev/ttyACM0", EVIL, EVIL, EVIL)
    monkeypatch.setattr(connect, "discover", lambda: Links((port,), (EVIL,), ()))
    info = DeviceInfo(EVIL, EVIL, (16384, 16384, 16384), 4000, 1000)
    workspace = Workspace(rig=EVIL, link=EVIL, out=hostile.parents[1], runs=[hostile], held_out=[hostile])
    app = DprApp(workspace, tmp_path / "state", notices=[EVIL])
    async with app.run_test(size=(120, 40)) as pilot:
        app.device.connected = Connected(EVIL, info, 1000, (EVIL,), EVIL)
        for number in range(1, len(STEPS) + 1):
            await pilot.press(str(number))
            await pilot.pause()
            drawn(app)
        app.device.note(RecorderFailed(None, EVIL, alive=False))
        app.query_one(IdentifyStep).say(EVIL)
        app.mishap(DprError(EVIL))
        app.mishap(RuntimeError(EVIL))
        await pilot.press("1")
        await pilot.pause()
        assert "\\x1b[2J" in drawn(app)  # it is spelled out, not hidden
        await pilot.press("b")
        await until(pilot, lambda: isinstance(app.screen, RunBrowser) and app.screen.query("#about"))
        await until(pilot, lambda: "samples at" in str(app.screen.query_one("#about", Static).content))
        assert "X1" in drawn(app)


@pytest.mark.slow
async def test_a_state_folder_that_cannot_be_written_is_a_sentence(tmp_path: Path, notices_text) -> None:
    (tmp_path / "file").write_text("")
    state = tmp_path / "file" / "state"
    workspace, notices = load(state)
    assert notices == [] or "cannot be read" in notices[0]
    app = DprApp(workspace, state, notices=notices, steps=STEPS[:3])
    async with app.run_test(size=(80, 24)) as pilot:
        await pilot.pause()
        assert f"{state}: Not a directory: the next session will not remember the current rig" in notices_text(app)
        await pilot.press("escape", "2", "3", "t")
        await pilot.pause()
        assert "will not remember" not in notices_text(app)  # once is enough
        app.mishap(RuntimeError("sums"))
        await pilot.pause()
        assert (
            f"Unexpected: RuntimeError: sums. Your work is kept; details cannot be written to {state}"
            in notices_text(app)
        )
        assert app.current.NAME == "Capture"
