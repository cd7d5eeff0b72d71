"""Errors inside a widget are told and kept; the widget lives on."""

import traceback
from datetime import UTC, datetime
from pathlib import Path

from textual.message import Message
from textual.message_pump import MessagePump


class Guarded(MessagePump):
    """Mixin for widgets of ours: Textual ends a widget whose handler raises, and the bench must not end."""

    async def _dispatch_message(self, message: Message) -> None:
        try:
            await super()._dispatch_message(message)
        except Exception as error:  # whatever it is: the app tells it, and keeps it with its traceback
            self.app._handle_exception(error)


def log(error: Exception, folder: Path) -> str:
    """Keep an error with its traceback in `errors.log`; says where, or why not."""
    file = folder / "errors.log"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with file.open("a", encoding="utf-8") as lines:
            lines.write(f"{datetime.now(UTC):%Y-%m-%dT%H:%M:%SZ}\n{''.join(traceback.format_exception(error))}\n")
    except OSError as why:
        return f"details cannot be written to {file}: {why.strerror}"
    return f"details are in {file}"
