"""Handling of errors in widgets: an error is shown and logged, and the widget continues."""

import traceback
from pathlib import Path

from textual.message import Message
from textual.message_pump import MessagePump

from dpr_lab.tui.notices import SETTINGS, append


class Guarded(MessagePump):
    """Mixin for widgets of this package that continue after an error.

    Textual ends a widget if one of its handlers raises an exception.
    """

    async def _dispatch_message(self, message: Message) -> None:
        try:
            await super()._dispatch_message(message)
        except Exception as error:  # every error is shown by the app and logged with its traceback
            self.app._handle_exception(error)


def log(error: Exception, folder: Path) -> str:
    """Append an error with its traceback to `errors.log`.

    Returns:
        sentence that states the path of the log or, if the log could not be written, the reason
    """
    file = folder / "errors.log"
    try:
        append(file, f"\n{''.join(traceback.format_exception(error))}", SETTINGS.error_file_bytes)
    except OSError as why:
        return f"details cannot be written to {file}: {why.strerror}"
    return f"details are in {file}"
