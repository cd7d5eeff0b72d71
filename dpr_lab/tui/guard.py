"""Errors inside a widget become a notice; the widget lives on."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from textual.message import Message
from textual.message_pump import MessagePump

if TYPE_CHECKING:
    from dpr_lab.tui.app import DprApp


class Guarded(MessagePump):
    """Mixin for widgets of ours: Textual ends the app when a handler raises, and the bench must not end."""

    @property
    def lab(self) -> DprApp:
        """The app."""
        return cast("DprApp", self.app)

    async def _dispatch_message(self, message: Message) -> None:
        try:
            await super()._dispatch_message(message)
        except Exception as error:  # whatever it is: it is told, and kept with its traceback
            self.lab.mishap(error)
