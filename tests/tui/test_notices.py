"""Messages stay: errors on the screen until they are dismissed, all messages in a list and in a file."""

from pathlib import Path

import pytest
from textual.notifications import Notification
from textual.widgets import Static

from dpr_lab.errors import DprError
from dpr_lab.tui import notices
from dpr_lab.tui.app import DprApp
from dpr_lab.tui.notices import MessageLog, MessageLogSettings, MessageScreen
from dpr_lab.tui.texts import NOTICES
from dpr_lab.tui.workspace import Workspace


def test_a_message_is_one_line_of_the_file_with_its_time(tmp_path: Path) -> None:
    log = MessageLog(tmp_path / "state" / "messages.log")
    log.add(Notification("the rods\nmay be free\x1b[2J", severity="warning"))
    (line,) = log.file.read_text().splitlines()
    assert line.endswith("Z warning: the rods may be free\\x1b[2J")
    assert line.startswith("20")


def test_the_file_has_a_bounded_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notices, "SETTINGS", MessageLogSettings(file_bytes=1000))
    log = MessageLog(tmp_path / "messages.log")
    for number in range(200):
        log.add(Notification(f"message {number}", severity="warning"))
    sizes = {file.name: file.stat().st_size for file in tmp_path.iterdir()}
    assert sizes.keys() == {"messages.log", "messages.log.1"}
    assert max(sizes.values()) < 1100
    assert "message 199" in log.file.read_text()


def test_a_folder_that_cannot_be_written_costs_the_file_alone(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    log = MessageLog(tmp_path / "file" / "messages.log")
    log.add(Notification("no cable", severity="error"))
    assert [message.message for message in log.messages] == ["no cable"]


async def test_errors_stay_until_escape_and_are_listed_by_key(tmp_path: Path, notices_text) -> None:
    app = DprApp(Workspace(out=tmp_path), tmp_path / "state")
    async with app.run_test(size=(80, 24)) as pilot:
        app.mishap(DprError("RELEASE was sent, so the rods may be free"))
        for number in range(5):
            app.notify(f"hint {number}")
        await pilot.pause()
        assert notices_text(app).splitlines() == ["RELEASE was sent, so the rods may be free", "hint 4"]
        (error, hint) = app.notices
        assert error.timeout == NOTICES.stays_s
        assert "f4: all messages" in error.title
        assert hint.timeout < 60
        await pilot.press("escape")
        assert notices_text(app) == ""
        await pilot.press("f4")
        assert isinstance(app.screen, MessageScreen)
        shown = str(app.screen.query(Static).first().render())
        assert shown.splitlines()[0].endswith("information: hint 4")
        assert shown.splitlines()[-1].endswith("error: RELEASE was sent, so the rods may be free")
        await pilot.press("f4")
        assert not isinstance(app.screen, MessageScreen)
    assert "error: RELEASE was sent" in (tmp_path / "state" / "messages.log").read_text()
