"""The loop that runs a device on a link until it is stopped, or until a fault takes one of them away."""

import logging
import time
from collections.abc import Callable

from sim_device.device import Device
from sim_device.faults import Faults
from sim_device.links import Link

log = logging.getLogger(__name__)

STREAMING_PAUSE = 0.002
"""Longest wait while streaming, s: samples go out in twos at 1 kHz, which halves the cost of sending each alone."""

IDLE_PAUSE = 0.02


def serve(
    device: Device, link: Link, faults: Faults, stopped: Callable[[], bool], wall: Callable[[], float] = time.monotonic
) -> None:
    """Run until `stopped()`, or until the link is cut on request; closes the link."""
    cut_after, reset_after = faults.value("cut_after_s"), faults.value("reset_after_s")
    while not stopped():
        # Read before looking at the lease: keepalives that waited while this process slept were sent in time.
        frames = [answer for frame in link.receive() for answer in device.receive(frame, wall())]
        frames += device.service(wall(), link.blocked)
        device.note_dropped(link.send(frames))
        if cut_after is not None and device.streamed >= cut_after:
            log.info("the link is cut, as asked for")
            break
        if reset_after is not None and device.streamed >= reset_after:
            log.info("the device restarts, as asked for")
            device.reset()
            reset_after = None
        link.wait(STREAMING_PAUSE if device.streams else IDLE_PAUSE)
    link.close()
