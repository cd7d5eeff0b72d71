"""App that can be read-only: it then refuses all actions, screens and jobs that change more than the display."""

from typing import Any

from textual.app import App
from textual.dom import DOMNode
from textual.screen import Screen

from dpr_lab.errors import SafetyStop
from dpr_lab.tui.read_only import READ_ONLY, SCREENS, changes


class ViewedApp(App[None]):
    """Base class of the app, which refuses actions with an effect beyond the display on a read-only page."""

    read_only = False
    """Whether the page is read-only: no command is sent to a device and no file is written."""

    async def _dispatch_action(self, namespace: DOMNode, action_name: str, params: Any) -> bool:
        if self.read_only and changes(namespace, action_name):
            self._handle_exception(SafetyStop(READ_ONLY))
            return True
        return await super()._dispatch_action(namespace, action_name, params)

    def push_screen(self, screen: Screen[Any] | str, *arguments: Any, **options: Any) -> Any:
        """Show a screen above the current one.

        Raises:
            SafetyStop: the page is read-only and the screen is not in `SCREENS`.
        """
        if self.read_only and type(screen).__name__ not in SCREENS:
            raise SafetyStop(READ_ONLY)
        return super().push_screen(screen, *arguments, **options)
