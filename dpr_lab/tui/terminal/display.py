"""Output of frames to the terminal, and their confirmation.

After each frame the cursor is set to a cell that encodes the number of the frame, and the terminal is queried for the
cursor position (`ESC [ 6 n`; ECMA-48, DSR). The terminal replies (`ESC [ row ; column R`) when it has drawn all
previous output. The reply therefore confirms this frame, and cannot be confused with a key or with the reply to another
frame.
"""

import asyncio
import os
import time
from collections.abc import Callable

from rich.color import ColorSystem
from textual._compositor import CompositorUpdate
from textual.driver import Driver
from textual.geometry import Size

from dpr_lab.errors import SafetyStop
from dpr_lab.tui.read_only import READ_ONLY
from dpr_lab.tui.terminal.frame import CellFrame
from dpr_lab.tui.terminal.multiplexer import from_environment
from dpr_lab.tui.terminal.pace import Pace

BEGIN, END = "\x1b[?2026h", "\x1b[?2026l"
"""Start and end of synchronized output: a terminal that supports it shows the enclosed output at once."""
WHY_UNSEEN = "use a terminal on this computer, a faster line or a smaller window, or release with dpr-lab capture"


class Display:
    """Output of Textual to a terminal, at the rate at which the terminal confirms it.

    Args:
        driver: driver of the terminal; None if there is no terminal
        colours: colours of the terminal
        allow_release: whether display in a browser counts as seen by the operator
    """

    def __init__(
        self, driver: Callable[[], Driver | None], colours: ColorSystem | None, allow_release: bool = False
    ) -> None:
        self._driver, self._colours, self._allow_release = driver, colours, allow_release
        self._frame = CellFrame(0, 0, colours)
        self._pace = Pace(1, time.monotonic())
        self._number = 0
        self._later: asyncio.TimerHandle | None = None
        self._waiting: dict[int, asyncio.Future[float]] = {}
        self.together = False
        """Whether the terminal supports synchronized output."""

    def show(self, update: CompositorUpdate, size: Size) -> None:
        """Draw an update as soon as a frame may be sent; updates until then are drawn in the same frame."""
        if (self._frame.width, self._frame.height) != size:
            self._frame = CellFrame(size.width, size.height, self._colours)
            self._pace = Pace(max(size.width * size.height, 1), time.monotonic())
        self._frame.paint(update)
        self._send_soon()

    def forget(self) -> None:
        """Send everything again, because the content of the terminal is unknown."""
        self._frame.forget()
        self._send_soon()

    def hurry(self) -> None:
        """Draw the next update without delay, because a key was pressed."""
        self._pace.refill()
        self._send_soon()

    def confirmed(self, column: int, row: int) -> None:
        """Register a reported cursor position, from 0, as confirmation of a frame."""
        now = time.monotonic()
        for number in [n for n in range(max(self._number - 64, 0), self._number + 1) if self._cell(n) == (column, row)]:
            round_trip = self._pace.confirmed(number, now)
            waiting = self._waiting.pop(number, None)
            if waiting is not None and not waiting.done() and round_trip is not None:
                waiting.set_result(round_trip)
        self._send_soon()

    @property
    def multiplexer(self) -> str:
        """Name of the terminal multiplexer as in `Sight.multiplexer`; the text is empty in a browser."""
        driver = self._driver()
        if driver is None or driver.is_web:
            return ""
        return from_environment(os.environ) or getattr(driver, "multiplexer", "")

    async def seen(self, patience_s: float) -> float:
        """Send the current frame and wait for its confirmation; see `Sight.seen`."""
        driver = self._driver()
        if driver is None or driver.is_headless:
            raise SafetyStop(f"this screen is not drawn on a terminal, so nobody can see the countdown: {WHY_UNSEEN}")
        if driver.is_web and not self._allow_release:
            raise SafetyStop(READ_ONLY)
        number = self._send()
        waiting = self._waiting[number] = asyncio.get_running_loop().create_future()
        try:
            return await asyncio.wait_for(waiting, patience_s)
        except TimeoutError:
            raise SafetyStop(
                f"the terminal did not confirm the countdown within {patience_s:g} s: {WHY_UNSEEN}"
            ) from None
        finally:
            self._waiting.pop(number, None)

    def close(self) -> None:
        """Stop drawing."""
        if self._later is not None:
            self._later.cancel()

    def _send_soon(self) -> None:
        if self._later is not None:
            self._later.cancel()
            self._later = None
        driver = self._driver()
        if driver is None or not self._frame.changed:
            return
        wait = max(self._pace.wait(time.monotonic()), 0.0 if getattr(driver, "idle", True) else 0.05)
        if wait > 0:
            self._later = asyncio.get_running_loop().call_later(wait, self._send_soon)
        else:
            self._send()

    def _send(self) -> int:
        """Send the changes and request their confirmation; return the number of the frame."""
        driver = self._driver()
        assert driver is not None
        self._number += 1
        column, row = self._cell(self._number)
        changes = self._frame.changes()
        shown = f"{BEGIN}{changes}{END}" if self.together and changes else changes
        text = f"{shown}\x1b[{row + 1};{column + 1}H\x1b[6n"
        self._pace.sent(self._number, len(text.encode()), time.monotonic())
        driver.write(text)
        return self._number

    def _cell(self, number: int) -> tuple[int, int]:
        """Return the cell that encodes the number of a frame.

        The cell is in the right half of the screen, because a key also sends `ESC [ 1 ; 2 R`.
        """
        right = max(self._frame.width // 2, 1)
        return self._frame.width - 1 - number % right, number // right % max(self._frame.height, 1)
