"""State of the device for the screen: recorder process, last report and current attempt."""

import asyncio
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from dpr_lab.errors import SafetyStop
from dpr_lab.tui.read_only import READ_ONLY
from dpr_lab.tui.recorder.messages import (
    AttemptFinished,
    AttemptSeen,
    CaptureAttempt,
    Connected,
    GoAhead,
    Idle,
    RecorderFailed,
    RecorderOrder,
    RecorderReport,
)
from dpr_lab.tui.recorder.recorder import Recorder
from dpr_lab.tui.recorder.sighting import Sighting, seen_in


@dataclass(slots=True)
class DeviceConnection:
    """Connection to the device: at most one process, its last report, and current attempt."""

    log: Path
    """File for the output of the recorder process."""
    connected: Connected | None = None
    """Handshake with the device; None while no device is connected."""
    opening: float | None = None
    """Start of the pending handshake, `time.monotonic()`, s; None if no handshake is pending."""
    message: str = ""
    """Reason why the device was lost or did not answer."""
    lost: Connected | None = None
    """The last device, if it was lost; None otherwise."""
    attempt: int | None = None
    """Number of the current attempt; None if there is no attempt."""
    seen: Sighting = field(default_factory=Sighting)
    """Last known angles of the rods and state of the latch; kept after the device is lost."""
    ordered: float | None = None
    """Time of a release command whose result is unknown, `time.monotonic()`, s; None if there is no such command."""
    read_only: bool = False
    """Whether this page may neither open devices nor send commands."""
    _recorder: Recorder | None = None

    async def open(self, url: str, rig: str, runs: Path) -> None:
        """Start the handshake with a device; the current device is disconnected first.

        A later report contains the result.
        """
        self._refuse()
        await self.close()
        self.opening = time.monotonic()
        self._recorder = await asyncio.to_thread(Recorder, url, rig, runs, self.log)

    async def close(self) -> None:
        """Disconnect from the device; a recording in progress is closed as incomplete."""
        recorder, self._recorder = self._recorder, None
        self.connected = self.lost = self.opening = self.attempt = self.ordered = None
        self.message, self.seen = "", Sighting()
        if recorder is not None:
            await asyncio.to_thread(recorder.close)

    def fresh(self, now: float) -> bool:
        """Return whether the device is connected and has reported recently."""
        return self.connected is not None and self.seen.fresh(now)

    def tell(self, order: RecorderOrder) -> None:
        """Send a command to the recorder; without a recorder, the command is ignored."""
        self._refuse()
        if self._recorder is not None:
            self.attempt = order.attempt if isinstance(order, CaptureAttempt) else self.attempt
            self.ordered = order.given_at if isinstance(order, GoAhead) else self.ordered
            self._recorder.tell(order)

    def _refuse(self) -> None:
        if self.read_only:
            raise SafetyStop(READ_ONLY)

    def reports(self) -> Iterator[RecorderReport]:
        """Yield the messages of the recorder since the last call."""
        if self._recorder is None:
            return
        for report in self._recorder.reports():
            self.note(report)
            yield report

    def note(self, report: RecorderReport) -> None:
        """Update the state with a report about the device."""
        match report:
            case Connected():
                self.connected, self.opening, self.lost = report, None, None
            case Idle() | AttemptSeen():
                self.seen = seen_in(report, self.seen)
                if self.ordered is not None and self.seen.settles(self.ordered):
                    self.ordered = None
            case RecorderFailed():
                self.attempt = None
                if not report.alive:
                    self.lost, self.connected, self.opening = self.connected, None, None
                    self.message = report.message
            case AttemptFinished():
                self.attempt = None
            case _:
                pass
