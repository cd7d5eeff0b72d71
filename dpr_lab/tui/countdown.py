"""Three, two, one: the last moment to change one's mind before the rods are let go."""

from typing import ClassVar

from textual import events
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Digits, Static


class Countdown(ModalScreen[bool]):
    """Answers true once it has run out; any key but the release key, a click, or leaving the terminal answers false.

    Args:
        pose: what is about to be released
        keys: the release keys, by Textual's names; pressing one again changes nothing
    """

    SECONDS: ClassVar[int] = 3
    SECOND_S: ClassVar[float] = 1.0

    def __init__(self, pose: str, keys: frozenset[str]) -> None:
        super().__init__()
        self._pose, self._keys = pose, keys
        self._left = self.SECONDS
        self._over = self._covered = False

    def compose(self) -> ComposeResult:
        """The number and how to stop it."""
        with Vertical(classes="dialog small"):
            yield Static(f"RELEASING {self._pose} in", markup=False)
            yield Digits(str(self._left))
            yield Static("Any other key stops this; the rods stay held.")

    def on_mount(self) -> None:
        """Start counting."""
        self.set_interval(self.SECOND_S, self._count)
        self.watch(self.app, "app_focus", self._watch_focus, init=False)

    def on_key(self, event: events.Key) -> None:
        """Stop at any other key."""
        event.stop()
        event.prevent_default()
        if event.key not in self._keys:
            self.stop()

    def on_click(self) -> None:
        """Stop at a click."""
        self.stop()

    def on_screen_suspend(self) -> None:
        """Stop when something else comes on top."""
        if not self._over:
            self._over = self._covered = True

    def on_screen_resume(self) -> None:
        """Go once what was on top is gone."""
        if self._covered:
            self._covered = False
            self.dismiss(False)

    def stop(self) -> None:
        """Answer that the rods are not to be released."""
        if not self._over:
            self._over = True
            self._covered = not self.is_current
            if self.is_current:
                self.dismiss(False)

    def _watch_focus(self, focused: bool) -> None:
        if not focused:
            self.stop()

    def _count(self) -> None:
        self._left -= 1
        self.query_one(Digits).update(str(self._left))
        if self._left == 0 and not self._over and self.is_current:
            self._over = True
            self.dismiss(True)
