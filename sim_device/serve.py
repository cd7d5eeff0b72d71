"""Main loop of a device on a link."""

import logging
import time
from collections.abc import Callable

from firmware_protocol.messages import NUMBERS, Event, EventKind, Frame
from sim_device.faults import Faults
from sim_device.firmware.board import Board
from sim_device.links.link import DeviceLink

log = logging.getLogger(__name__)

STREAMING_PAUSE = 0.002
"""Maximum wait while streaming, s. At 1 kHz, samples are then sent in pairs, at half the cost of single ones."""

IDLE_PAUSE = 0.02
"""Maximum wait while nothing is streamed, s."""

STALL_EVERY_S = 1.0
"""Time from the start of one requested stall to the start of the next, s."""


def serve(
    device: Board,
    link: DeviceLink,
    faults: Faults,
    stopped: Callable[[], bool],
    wall: Callable[[], float] = time.monotonic,
) -> None:
    """Run the device until `stopped()` is true or a requested fault cuts the link, then close the link."""
    reset_after = faults.value("reset_after_s")
    line = _Line(link, faults)
    while not stopped():
        # The lease is checked after reading, with the time before reading. Keepalives that arrived while this process
        # was suspended were sent in time, whether the suspension was before or after the reading.
        now = wall()
        frames = [answer for frame in line.receive(device, now) for answer in device.receive(frame, now)]
        if faults.value("cut_at_release") and any(map(_is_release, frames)):
            log.info("the link is cut at the release, as requested")
            break
        frames += device.service(now, link.blocked)
        device.note_dropped(line.send(frames))
        if _reached(device, faults.value("cut_after_s")):
            log.info("the link is cut, as requested")
            break
        if _reached(device, reset_after):
            log.info("the device restarts, as requested")
            device.reset()
            reset_after = None
        link.wait(STREAMING_PAUSE if device.streams else IDLE_PAUSE)
    link.close()


def _is_release(frame: Frame) -> bool:
    return frame.number == NUMBERS[Event] and frame.data[0] == EventKind.RELEASED


def _reached(device: Board, seconds: float | None) -> bool:
    return seconds is not None and device.streamed >= seconds


class _Line:
    """Link that stalls or stops transmitting on request."""

    def __init__(self, link: DeviceLink, faults: Faults) -> None:
        self._link = link
        self._stall = (faults.value("stall_ms") or 0.0) / 1000
        self._bus_off_after = faults.value("bus_off_after_s")
        self._stalls_from: float | None = None
        self._open = self._on_bus = True
        self._held: list[Frame] = []

    def receive(self, device: Board, now: float) -> list[Frame]:
        """Return the frames that have arrived; none while the link is stalled or silent."""
        if self._on_bus and _reached(device, self._bus_off_after):
            log.info("the link transmits nothing from now on, as requested")
            self._link.bus_off()
            self._on_bus = False
        self._open = not (device.streams and self._stalled(now))
        return self._link.receive() if self._open and self._on_bus else []

    def send(self, frames: list[Frame]) -> list[Frame]:
        """Send frames, or keep them until a stall ends, and return the frames that were dropped."""
        if not self._on_bus:
            return []
        self._held += frames
        if not self._open:
            return []
        waiting, self._held = self._held, []
        return self._link.send(waiting)

    def _stalled(self, now: float) -> bool:
        if not self._stall:
            return False
        if self._stalls_from is None or now >= self._stalls_from + self._stall:
            self._stalls_from = now + STALL_EVERY_S
        return now >= self._stalls_from
