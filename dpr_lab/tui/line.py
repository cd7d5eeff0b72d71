"""The device as the screen knows it: the process that owns it, and what it said last."""

import asyncio
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from dpr_lab.errors import DprError
from dpr_lab.tui.orders import Capture, Connected, Failed, Finished, Order, Report
from dpr_lab.tui.recorder import Recorder


@dataclass(slots=True)
class Line:
    """At most one recorder at a time."""

    log: Path
    """File for what the recorder's process prints."""
    connected: Connected | None = None
    """The device's greeting; None while there is none."""
    opening: bool = False
    """Whether a device was called and has not answered."""
    said: str = ""
    """Why there is no device any more, or why none answered."""
    attempt: int | None = None
    """The attempt under way."""
    _recorder: Recorder | None = None

    async def open(self, url: str, rig: str, runs: Path) -> None:
        """Call a device; a report tells whether it answers. One that was connected is let go first.

        Raises:
            DprError: an attempt is under way.
        """
        self.require_free()
        await self.close()
        self.opening = True
        self._recorder = await asyncio.to_thread(Recorder, url, rig, runs, self.log)

    async def close(self) -> None:
        """Let the device go; a recording under way is finished as incomplete."""
        recorder, self._recorder = self._recorder, None
        self.connected, self.opening, self.said, self.attempt = None, False, "", None
        if recorder is not None:
            await asyncio.to_thread(recorder.close)

    def require_free(self) -> None:
        """Raise DprError while an attempt is under way."""
        if self.attempt is not None:
            raise DprError("A capture is under way: end it first (press 3, then x)")

    def tell(self, order: Order) -> None:
        """Give the recorder an order; without one it is dropped."""
        if self._recorder is not None:
            self.attempt = order.attempt if isinstance(order, Capture) else self.attempt
            self._recorder.tell(order)

    def reports(self) -> Iterator[Report]:
        """What the recorder said since the last call."""
        if self._recorder is None:
            return
        for report in self._recorder.reports():
            self._note(report)
            yield report

    def _note(self, report: Report) -> None:
        if isinstance(report, Connected):
            self.connected, self.opening = report, False
        elif isinstance(report, Finished | Failed):
            self.attempt = None
        if isinstance(report, Failed) and not report.alive:
            self.connected, self.opening, self.said = None, False, report.said
