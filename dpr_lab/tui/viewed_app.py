"""App that can be read-only, and then allows only actions and screens that do not change anything."""

from typing import Any

from textual.app import App
from textual.dom import DOMNode
from textual.screen import Screen

from dpr_lab.errors import SafetyStop
from dpr_lab.tui.read_only import READ_ONLY, SCREENS, changes


class ViewedApp(App[None]):
    """Application in a read-only page; it refuses actions with one sentence."""

    read_only = False
    """Whether it is read-only: no command to a device, no file written."""

    async def _dispatch_action(self, namespace: DOMNode, action_name: str, params: Any) -> bool:
        if self.read_only and changes(namespace, action_name):
            self._handle_exception(SafetyStop(READ_ONLY))
            return True
        return await super()._dispatch_action(namespace, action_name, params)

    def push_screen(self, screen: Screen[Any] | str, *arguments: Any, **options: Any) -> Any:
        """Show a screen on top of this one.

        Raises:
            SafetyStop: in a read-only page, a screen that does more than show something.
        """
        if self.read_only and type(screen).__name__ not in SCREENS:
            raise SafetyStop(READ_ONLY)
        return super().push_screen(screen, *arguments, **options)

    def deliver_screenshot(
        self, filename: str | None = None, path: str | None = None, time_format: str | None = None
    ) -> str | None:
        """Save a screenshot; on a read-only page, report that none is saved."""
        if self.read_only:
            self._handle_exception(SafetyStop(READ_ONLY))
            return None
        return self.save_picture(filename, path, time_format)

    def save_picture(self, filename: str | None, path: str | None, time_format: str | None) -> str | None:
        """Save a screenshot and return its path."""
        return super().deliver_screenshot(filename, path, time_format)
