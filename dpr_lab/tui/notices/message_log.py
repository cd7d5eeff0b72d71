"""Messages of a session in a list and in a file of limited size."""

from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from dpr_lab.errors import printable


@dataclass(frozen=True, slots=True)
class MessageLogSettings:
    """Limits of the message log."""

    shown: int = 500
    """Maximum number of messages in the list."""
    file_bytes: int = 250_000
    """Maximum size of the log file, bytes: about two thousand messages. A larger file is renamed to `.1`."""


SETTINGS = MessageLogSettings()
FILE = "messages.log"


@dataclass(frozen=True, slots=True)
class LoggedMessage:
    """A message with its time."""

    when: datetime
    """Time in UTC."""
    severity: str
    """`information`, `warning` or `error`."""
    text: str


@dataclass(slots=True)
class MessageLog:
    """Log of messages in memory and in a file.

    If the file cannot be written, the messages are still stored in memory.
    """

    file: Path
    messages: deque[LoggedMessage] = field(default_factory=lambda: deque(maxlen=SETTINGS.shown))
    """Messages, oldest first."""

    def add(self, severity: str, text: str) -> None:
        """Store a message, in one line of the file."""
        message = LoggedMessage(datetime.now(UTC), severity, text)
        self.messages.append(message)
        with suppress(OSError):
            append(self.file, f" {severity}: {printable(' '.join(text.split()))}", SETTINGS.file_bytes)


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
