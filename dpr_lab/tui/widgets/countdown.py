"""Countdown before a release, during which the operator can still cancel."""

import asyncio
import random
import time
from typing import ClassVar

from textual import events
from textual.app import ComposeResult
from textual.containers import Vertical
from textual.content import Content
from textual.screen import ModalScreen
from textual.widgets import Digits, Static

from dpr_lab.errors import SafetyStop
from dpr_lab.tui.terminal.sight import SIGHT, Sight

LETTERS = "acdefhjkmnpqrtuvwxyz"
"""Letters of the codes, without letters that are easily confused."""


def new_code(chance: random.Random, without: frozenset[str]) -> str:
    """Draw a code of different letters, none of which is in `without`."""
    return "".join(chance.sample([letter for letter in LETTERS if letter not in without], SIGHT.code_length))


class Countdown(ModalScreen[bool]):
    """Dialog with a countdown; it returns True after all numbers were displayed.

    The countdown starts when the terminal has confirmed that the dialog is drawn. The result is False if a number is
    not confirmed in time, or after any other key, a click or a loss of focus. A multiplexer confirms frames even if no
    operator is attached. With a multiplexer the operator must therefore first type a displayed code.

    Args:
        pose: pose of the release
        keys: release keys, by their names in Textual; pressing one again has no effect
        sight: confirms that the screen was seen
        code: code to type if a multiplexer confirms the frames, see `new_code`
    """

    SECONDS: ClassVar[int] = 3
    SECOND_S: ClassVar[float] = 1.0

    def __init__(self, pose: str, keys: frozenset[str], sight: Sight, code: str) -> None:
        super().__init__()
        self._pose, self._keys, self._sight = pose, keys, sight
        self._multiplexer = sight.multiplexer
        self._code = code if self._multiplexer else ""
        self._to_type = self._code
        self._typed = asyncio.Event()
        self._over = self._covered = False
        self.why = ""
        """Reason why the release was cancelled; empty before a cancellation."""

    @property
    def waits_for_code(self) -> bool:
        """Whether the operator must type the code first."""
        return bool(self._to_type)

    def compose(self) -> ComposeResult:
        """Build the announcement, the number, and the instruction for cancelling."""
        with Vertical(classes="dialog small"):
            yield Static(id="asked", markup=False)
            yield Digits(str(self.SECONDS))
            yield Static("Any other key stops the countdown; the rods stay held.")

    def on_mount(self) -> None:
        """Start the countdown, or request the code."""
        self._show()
        self.run_worker(self._count())
        self.watch(self.app, "app_focus", self._watch_focus, init=False)

    def on_key(self, event: events.Key) -> None:
        """Check a letter of the code, or cancel on any other key."""
        event.stop()
        event.prevent_default()
        if event.key in self._keys:
            return
        if self._to_type and event.character == self._to_type[0]:
            self._to_type = self._to_type[1:]
            self._show()
            if not self._to_type:
                self._typed.set()
            return
        pressed = f"the key {event.key} was pressed"
        self.stop(f"{pressed}, which is not the next letter of the code" if self._to_type else pressed)

    def on_click(self) -> None:
        """Cancel on a click."""
        self.stop("the mouse was clicked")

    def on_resize(self, event: events.Resize) -> None:
        """Cancel if the dialog no longer fits."""
        if event.size.width < SIGHT.least_columns or event.size.height < SIGHT.least_rows:
            self.stop("the window became too small to show the countdown")

    def on_screen_suspend(self) -> None:
        """Cancel if another screen covers this one."""
        if not self._over:
            self._over = self._covered = True
            self.why = "another dialog opened"

    def on_screen_resume(self) -> None:
        """Close when the screen that covered the countdown is closed."""
        if self._covered:
            self._covered = False
            self.dismiss(False)

    def stop(self, why: str) -> None:
        """Cancel with a reason."""
        if not self._over:
            self._over, self.why = True, why
            self._covered = not self.is_current
            if self.is_current:
                self.dismiss(False)

    def _watch_focus(self, focused: bool) -> None:
        if not focused:
            self.stop("the terminal lost the focus")

    def _show(self) -> None:
        """Show the number of the countdown, or the code that the operator must first type."""
        self.query_one(Digits).display = not self._to_type
        heading = Content(f"RELEASING {self._pose} in")
        if self._to_type:
            typed, left = self._code[: -len(self._to_type)], self._to_type
            heading = Content.assemble(
                f"RELEASE {self._pose}: type ",
                (typed, "dim"),
                (left, "bold reverse"),
                f"\n\nThe latch opens {self.SECONDS} s after the last letter. {self._multiplexer} confirms"
                " frames even if nobody is attached, so the code shows that you see this screen.\n",
            )
        self.query_one("#asked", Static).update(heading)

    async def _count(self) -> None:
        try:
            await self._be_typed()
            await self._come_into_sight()
            for left in range(self.SECONDS, 0, -1):
                self.query_one(Digits).update(str(left))
                started = time.monotonic()
                await self._be_seen()
                await asyncio.sleep(max(started + self.SECOND_S - time.monotonic(), 0.0))
            await self._be_seen()
            if self._sight.multiplexer != self._multiplexer:
                raise SafetyStop(
                    f"{self._sight.multiplexer} has confirmed the countdown instead of the terminal: try again"
                )
        except SafetyStop as unseen:
            self.stop(str(unseen))
            return
        if not self._over and self.is_current:
            self._over = True
            self.dismiss(True)

    async def _be_typed(self) -> None:
        """Wait for the code if one is required."""
        if not self._code:
            return
        try:
            await asyncio.wait_for(self._typed.wait(), SIGHT.code_s)
        except TimeoutError:
            raise SafetyStop(f"the code was not typed within {SIGHT.code_s:g} s") from None

    async def _come_into_sight(self) -> None:
        """Wait until the dialog is drawn and the round trip time is short."""
        give_up = time.monotonic() + SIGHT.patience_s
        while (round_trip := await self._drawn()) > SIGHT.round_trip_s:
            if time.monotonic() > give_up:
                raise _too_slow(round_trip)

    async def _be_seen(self) -> None:
        if (round_trip := await self._drawn()) > SIGHT.round_trip_s:
            raise _too_slow(round_trip)

    async def _drawn(self) -> float:
        """Wait until the current content is drawn and return the round trip time, s."""
        painted = asyncio.Event()
        self.call_after_refresh(painted.set)
        await painted.wait()
        return await self._sight.seen(SIGHT.patience_s)


def _too_slow(round_trip_s: float) -> SafetyStop:
    return SafetyStop(
        f"the terminal took {round_trip_s:.2f} s to draw the countdown (limit {SIGHT.round_trip_s:g} s), so the latch"
        " could open before you see it: use a faster line or a smaller window, or release with dpr-lab capture"
    )
