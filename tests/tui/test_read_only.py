"""Read-only page: every action with an effect is refused with a message."""

import subprocess
import sys
from pathlib import Path

import pytest
from textual.widgets import Input

from dpr_lab.rig import load_rig
from dpr_lab.tui.app import KEYED, DprApp
from dpr_lab.tui.read_only import ACTIONS, READ_ONLY, SCREENS, changes
from dpr_lab.tui.widgets.run_browser import RunBrowser
from dpr_lab.tui.workspace import Workspace


@pytest.fixture
def bench(recorded: list[Path], tmp_path: Path) -> Workspace:
    """Folder with runs, a rig file and a table."""
    runs = tmp_path / "bench" / "runs"
    runs.mkdir(parents=True)
    for run in recorded:
        (runs / run.name).write_bytes(run.read_bytes())
    rig = tmp_path / "rig.toml"
    source = load_rig("paper").path
    assert source is not None
    rig.write_text(source.read_text())
    (tmp_path / "swing.csv").write_text("t_s,theta1,theta2\n0,1,2\n")
    return Workspace(rig=str(rig), link="sim://?seed=1", out=tmp_path / "bench", runs=sorted(runs.glob("*.mcap")))


def contents(folder: Path) -> dict[str, bytes]:
    """Content of every file except the log of messages, which a read-only process may not write either."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else b""
        for path in sorted(folder.rglob("*"))
        if "state" not in path.parts
    }


KEYS = {
    "1": ("c", "m", "l", "z", "i", "f2", "f5"),
    "2": ("f3", "i"),
    "3": ("s", "c"),
    "4": ("s",),
    "5": ("s",),
    "6": ("s", "h"),
}
"""Keys of the actions of each step that do more than display."""


@pytest.mark.slow
async def test_every_action_that_does_more_than_show_answers_with_one_sentence(
    bench: Workspace, tmp_path: Path
) -> None:
    app = DprApp(bench, tmp_path / "state", read_only=True)
    before = contents(tmp_path)
    async with app.run_test(size=(100, 32)) as pilot:
        for step, key in ((step, key) for step, keys in KEYS.items() for key in keys):
            await pilot.press(step, "escape")
            app.messages.messages.clear()
            await pilot.press(key)
            await pilot.pause()
            assert [message.message for message in app.messages.messages] == [READ_ONLY], (step, key)
            assert len(app.screen_stack) == 1
        assert app.device.opening is None
    assert contents(tmp_path) == before
    assert not (tmp_path / "state" / "bench.json").exists()


@pytest.mark.slow
async def test_no_link_is_chosen_no_table_imported_and_no_run_exported_noted_or_recovered(
    bench: Workspace, tmp_path: Path
) -> None:
    app = DprApp(bench, tmp_path / "state", read_only=True)
    before = contents(tmp_path)
    async with app.run_test(size=(100, 32)) as pilot:
        await pilot.press("1")
        app.query_one("#links").focus()
        await pilot.press("enter")
        await pilot.pause()
        assert [message.message for message in app.messages.messages] == [READ_ONLY]
        assert app.device.opening is None
        await pilot.press("2")
        app.messages.messages.clear()
        app.query_one("#rig_file", Input).value = str(tmp_path / "swing.csv")
        app.query_one("#rig_file", Input).focus()
        await pilot.press("enter")
        await pilot.pause()
        assert [message.message for message in app.messages.messages] == [READ_ONLY]
        await pilot.press("escape", "b")
        await pilot.pause()
        assert isinstance(app.screen, RunBrowser)
        for key in ("e", "i", "ctrl+r"):
            app.clear_notifications()
            app.messages.messages.clear()
            await pilot.press(key)
            await pilot.pause()
            assert [message.message for message in app.messages.messages] == [READ_ONLY], key
        app.clear_notifications()
        app.deliver_screenshot()
        await pilot.pause()
        assert app.messages.messages[-1].message == READ_ONLY
    assert contents(tmp_path) == before


@pytest.mark.slow
async def test_what_only_shows_something_works(bench: Workspace, tmp_path: Path) -> None:
    app = DprApp(bench, tmp_path / "state", read_only=True)
    async with app.run_test(size=(100, 32)) as pilot:
        await pilot.press("2", "n", "p", "t", "g", "f1")
        await pilot.pause()
        assert type(app.screen).__name__ in SCREENS
        await pilot.press("escape", "4", "v", "b", "space", "enter")
        await pilot.pause()
        assert [message.message for message in app.messages.messages if message.message == READ_ONLY] == []


def test_every_action_that_is_free_exists() -> None:
    owners = (DprApp, *KEYED)
    assert not any(changes(owner, "cursor_down") for owner in owners)  # of Textual's widgets
    from dpr_lab.tui.widgets.dialogs import Question

    known = {name.removeprefix("action_") for owner in (*owners, Question) for name in dir(owner)}
    assert ACTIONS <= known


FORBIDDEN = """
import os, subprocess, sys
from dpr_lab.tui.read_only import forbid_writing
forbid_writing()
open(sys.argv[1]).read()
open(os.devnull, "w").close()
tried = [
    lambda: open(sys.argv[1], "a"),
    lambda: os.open(sys.argv[1] + ".new", os.O_WRONLY | os.O_CREAT),
    lambda: os.mkdir(sys.argv[1] + ".d"),
    lambda: os.rename(sys.argv[1], sys.argv[1] + ".moved"),
    lambda: os.remove(sys.argv[1]),
    lambda: subprocess.Popen(["true"]),
]
for act in tried:
    try:
        act()
    except PermissionError as error:
        assert "read-only" in error.strerror
    else:
        sys.exit("not refused")
"""


def test_the_process_of_a_read_only_page_writes_nothing_on_any_request(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("kept")
    done = subprocess.run([sys.executable, "-c", FORBIDDEN, str(file)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir() if path.is_file()] == [("file", "kept")]
