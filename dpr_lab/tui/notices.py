"""Messages to the operator: their display, their list, and their log file."""

from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from textual.app import App, ComposeResult
from textual.containers import VerticalScroll
from textual.content import Content
from textual.notifications import Notification, Notify, SeverityLevel
from textual.screen import ModalScreen
from textual.widgets import Static

from dpr_lab.errors import printable
from dpr_lab.tui.keys import bindings
from dpr_lab.tui.texts import NOTICES


@dataclass(frozen=True, slots=True)
class MessageLogSettings:
    """Limits of the message log."""

    shown: int = 500
    """Maximum number of messages in the list."""
    file_bytes: int = 250_000
    """Maximum size of the log file, bytes: about two thousand messages. A larger file is renamed to `.1`."""
    error_file_bytes: int = 1_000_000
    """Maximum size of `errors.log`, bytes. A larger file is renamed to `errors.log.1` and replaces the previous one."""


SETTINGS = MessageLogSettings()
FILE = "messages.log"
TONES = {"error": "bold $error", "warning": "$warning"}


@dataclass(slots=True)
class MessageLog:
    """Log of messages in memory and in a file.

    If the file cannot be written, the messages are still stored in memory.
    """

    file: Path
    messages: deque[Notification] = field(default_factory=lambda: deque(maxlen=SETTINGS.shown))
    """Messages, oldest first."""

    def add(self, message: Notification) -> None:
        """Store a message, in one line of the file."""
        self.messages.append(message)
        with suppress(OSError):
            text = printable(" ".join(message.message.split()))
            append(self.file, f" {message.severity}: {text}", SETTINGS.file_bytes)


def append(file: Path, text: str, largest: int) -> None:
    """Append a text after the current time to a log file.

    A file larger than `largest` bytes is first renamed to `.1` and replaces the previous one.

    Raises:
        OSError: the file cannot be written.
    """
    file.parent.mkdir(parents=True, exist_ok=True)
    if file.exists() and file.stat().st_size > largest:
        file.replace(file.with_name(f"{file.name}.1"))
    with file.open("a", encoding="utf-8") as lines:
        lines.write(f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}{text}\n")


class MessageScreen(ModalScreen[None]):
    """Page with a scrollable list of messages.

    Args:
        log: the displayed messages
    """

    BINDINGS = bindings("messages")

    def __init__(self, log: MessageLog) -> None:
        super().__init__()
        self._log = log

    def compose(self) -> ComposeResult:
        """Build the list: one message per line with its time."""
        with VerticalScroll(classes="dialog") as page:
            page.border_title = "Messages, newest first"
            page.border_subtitle = "esc: close · up, down: scroll"
            lines = [_line(message) for message in reversed(self._log.messages)]
            yield Static(Content("\n").join(lines or [Content("no messages yet")]), markup=False)
            yield Static(f"\nstored in {self._log.file}", markup=False)


def _line(message: Notification) -> Content:
    when = f"{datetime.fromtimestamp(message.raised_at):%H:%M:%S}"
    return Content.assemble(
        (f"{when} ", "dim"), (f"{message.severity}: {message.message}", TONES.get(message.severity, ""))
    )


class NoticeApp(App[None]):
    """Mixin of the app that shows and logs messages."""

    messages: MessageLog
    error_title: str = "Error"

    @property
    def notices(self) -> list[Notification]:
        """The messages that are currently shown, oldest first."""
        return [*self._notifications]

    def notify(self, message: str, *, severity: SeverityLevel = "information", **options: Any) -> None:
        """Show a plain text.

        An error stays visible until Escape is pressed or another step is shown.
        """
        options["markup"] = False
        if severity == "error":
            options |= {"timeout": NOTICES.stays_s, "title": self.error_title}
        super().notify(message, severity=severity, **options)

    def on_notify(self, event: Notify) -> None:
        """Log and show a message, unless it is shown already.

        If space is short, errors are the last to be removed.
        """
        new, standing = event.notification, self.notices
        if any(notice.message == new.message for notice in standing):
            event.prevent_default()
            return
        standing.sort(key=lambda notice: (notice.severity == "error", notice.raised_at))
        for old in standing[: max(len(standing) + 1 - NOTICES.most, 0)]:
            self._unnotify(old, refresh=False)
        self.messages.add(new)

    def action_messages(self) -> None:
        """Show all messages of this session."""
        self.push_screen(MessageScreen(self.messages))
