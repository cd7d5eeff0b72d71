"""Three, two, one: the last moment to change one's mind before the rods are let go."""

import asyncio
import time
from typing import ClassVar

from textual import events
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.screen import ModalScreen
from textual.widgets import Digits, Static

from dpr_lab.errors import SafetyStop
from dpr_lab.tui.terminal.sight import SIGHT, Sight


class Countdown(ModalScreen[bool]):
    """Answers true once it has run out and every number of it was seen.

    It begins when the terminal has confirmed that it drew it; a number that is not confirmed in time, any key but the
    release key, a click, or leaving the terminal answer false.

    Args:
        pose: what is about to be released
        keys: the release keys, by Textual's names; pressing one again changes nothing
        sight: confirms what was seen
    """

    SECONDS: ClassVar[int] = 3
    SECOND_S: ClassVar[float] = 1.0

    def __init__(self, pose: str, keys: frozenset[str], sight: Sight) -> None:
        super().__init__()
        self._pose, self._keys, self._sight = pose, keys, sight
        self._over = self._covered = False
        self.why = ""
        """Why it was refused; empty where the operator stopped it."""

    def compose(self) -> ComposeResult:
        """The number and how to stop it."""
        with Vertical(classes="dialog small"):
            yield Static(f"RELEASING {self._pose} in", markup=False)
            yield Digits(str(self.SECONDS))
            yield Static("Any other key stops this; the rods stay held.")

    def on_mount(self) -> None:
        """Start counting."""
        self.run_worker(self._count())
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

    def stop(self, why: str = "") -> None:
        """Answer that the rods are not to be released."""
        if not self._over:
            self._over, self.why = True, why
            self._covered = not self.is_current
            if self.is_current:
                self.dismiss(False)

    def _watch_focus(self, focused: bool) -> None:
        if not focused:
            self.stop()

    async def _count(self) -> None:
        try:
            await self._come_into_sight()
            for left in range(self.SECONDS, 0, -1):
                self.query_one(Digits).update(str(left))
                begun = time.monotonic()
                await self._be_seen()
                await asyncio.sleep(max(begun + self.SECOND_S - time.monotonic(), 0.0))
            await self._be_seen()
        except SafetyStop as unseen:
            self.stop(str(unseen))
            return
        if not self._over and self.is_current:
            self._over = True
            self.dismiss(True)

    async def _come_into_sight(self) -> None:
        """Wait until a slow line has drawn the dialog and then answers at once."""
        give_up = time.monotonic() + SIGHT.patience_s
        while (round_trip := await self._drawn()) > SIGHT.round_trip_s:
            if time.monotonic() > give_up:
                raise _too_slow(round_trip)

    async def _be_seen(self) -> None:
        if (round_trip := await self._drawn()) > SIGHT.round_trip_s:
            raise _too_slow(round_trip)

    async def _drawn(self) -> float:
        """Until what is shown is painted and drawn; the terminal's round trip, s."""
        painted = asyncio.Event()
        self.call_after_refresh(painted.set)
        await painted.wait()
        return await self._sight.seen(SIGHT.patience_s)


def _too_slow(round_trip_s: float) -> SafetyStop:
    return SafetyStop(
        f"the terminal took {round_trip_s:.2f} s to draw the countdown (limit {SIGHT.round_trip_s:g} s), so the latch"
        " could open before you see it: use a faster line or a smaller window, or release with dpr-lab capture"
    )
