"""Handling of errors in widgets: an error is shown and logged, and the widget continues."""

import traceback
from dataclasses import dataclass
from pathlib import Path

from textual.message import Message
from textual.message_pump import MessagePump

from dpr_lab.tui.notices import append


class Guarded(MessagePump):
    """Mixin for widgets of this package that continue after an error.

    Textual ends a widget if one of its handlers raises an exception.
    """

    async def _dispatch_message(self, message: Message) -> None:
        try:
            await super()._dispatch_message(message)
        except Exception as error:  # every error is shown by the app and logged with its traceback
            self.app._handle_exception(error)


@dataclass(frozen=True, slots=True)
class ErrorLogSettings:
    """Limits of the error log."""

    largest: int = 1_000_000
    """Maximum size of `errors.log`, bytes. A larger file is renamed to `errors.log.1` and replaces the previous one."""


ERROR_LOG = ErrorLogSettings()


def log(error: Exception, folder: Path) -> str:
    """Append an error with its traceback to `errors.log`.

    Returns:
        sentence that states the path of the log or, if the log could not be written, the reason
    """
    file = folder / "errors.log"
    try:
        append(file, f"\n{''.join(traceback.format_exception(error))}", ERROR_LOG.largest)
    except OSError as why:
        return f"details cannot be written to {file}: {why.strerror}"
    return f"details are in {file}"
