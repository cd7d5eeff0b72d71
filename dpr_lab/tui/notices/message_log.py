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
        line = f"{message.when:%Y-%m-%dT%H:%M:%SZ} {severity}: {printable(' '.join(text.split()))}\n"
        with suppress(OSError):
            self._make_room()
            with self.file.open("a", encoding="utf-8") as lines:
                lines.write(line)

    def _make_room(self) -> None:
        self.file.parent.mkdir(parents=True, exist_ok=True)
        if self.file.exists() and self.file.stat().st_size > SETTINGS.file_bytes:
            self.file.replace(self.file.with_name(f"{self.file.name}.1"))
