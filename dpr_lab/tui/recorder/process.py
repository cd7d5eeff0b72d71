"""Recorder process, which controls the device.

Link, driver and capture run in this process, so that no samples are lost while the screen is drawn. The process
executes commands from a pipe and sends reports. If the other end of the pipe is closed, no operator is present. The
process then releases nothing, closes a recording in progress as incomplete, and ends.
"""

import contextlib
import os
import signal
import sys
import threading
import time
import traceback
from multiprocessing.connection import Connection
from pathlib import Path

from dpr_lab.acquisition.capture import check_encoders
from dpr_lab.acquisition.device import Device
from dpr_lab.acquisition.holding import raise_faults
from dpr_lab.acquisition.live_speed import LiveSpeed
from dpr_lab.errors import DeviceLost, DprError, RunError
from dpr_lab.rig import JOINTS, Rig, load_rig
from dpr_lab.transports import open_transport
from dpr_lab.transports.transport import Transport
from dpr_lab.tui.recorder.guided_capture import carry_out, lost_since
from dpr_lab.tui.recorder.mailbox import Inbox, Outbox
from dpr_lab.tui.recorder.messages import (
    Connected,
    Exercise,
    Exercised,
    Idle,
    RecorderFailed,
)
from dpr_lab.tui.recorder.settings import SETTINGS
from firmware_protocol.messages import Position


def serve(connection: Connection, url: str, rig_name: str, runs: Path, log: Path) -> None:
    """Run the recorder in this process until the pipe is closed.

    Args:
        connection: pipe to the screen
        url: link to open; empty for the link of the rig file
        rig_name: rig file or built-in name
        runs: folder of the run files
        log: file for the output of libraries
    """
    _leave_the_terminal(log)
    inbox, outbox = Inbox(connection), Outbox(connection)
    try:
        rig = load_rig(rig_name)
        # Import in advance: the imports take seconds on a slow computer, and the device would seem to be silent during
        # the first capture.
        threading.Thread(target=LiveSpeed, args=(rig, rig.link.rate_hz), daemon=True).start()
        with contextlib.closing(open_transport(url or rig.link.url, rig_file=rig.path)) as transport:
            with Device(transport) as device:
                device.connect()
                outbox.add(_connected(device, transport, rig))
                _obey(device, rig, runs, inbox, outbox)
    except (DprError, KeyboardInterrupt) as error:
        outbox.add(RecorderFailed(None, str(error) or "stopped", alive=False))
    except Exception as error:  # every error must be reported to the screen, not only end the process
        traceback.print_exc()
        message = f"unexpected: {type(error).__name__}: {error}; details are in {log}"
        outbox.add(RecorderFailed(None, message, alive=False))
    outbox.close()


def _obey(device: Device, rig: Rig, runs: Path, inbox: Inbox, outbox: Outbox) -> None:
    idle = _IdleWatch(device, rig, outbox)
    while not inbox.gone:
        order = inbox.next()
        if order is None:
            idle.look()
            continue
        try:
            if isinstance(order, Exercise):
                outbox.add(_exercise(device, order))
            else:
                outbox.add(carry_out(order, device, rig, runs, inbox, outbox))
        except DprError as error:
            attempt, lost = None if isinstance(order, Exercise) else order.attempt, isinstance(error, DeviceLost)
            unwritten = isinstance(error, RunError)
            outbox.add(RecorderFailed(attempt, str(error), alive=not lost, unwritten=unwritten))
            if lost:
                return


def _connected(device: Device, transport: Transport, rig: Rig) -> Connected:
    rate_hz = rig.link.rate_hz
    problem = ""
    try:
        device.check_rate(rate_hz)
        check_encoders(device, rig)
    except DprError as error:
        problem = str(error)
    loads = tuple(capacity.with_frames(device.info.frames).load(rate_hz) for capacity in transport.capacities)
    return Connected(device.url, device.info, rate_hz, loads, problem, rig.rods.number)


def _exercise(device: Device, order: Exercise) -> Exercised:
    before = device.losses
    device.hold()
    device.stream(order.rate_hz)
    until, samples = time.monotonic() + order.seconds, 0
    try:
        while time.monotonic() < until:
            batches = device.poll(SETTINGS.look_s)
            raise_faults(device.url, batches)
            samples += sum(len(batch.rows) for batch in batches)
        clock, _ = device.clock()
    finally:
        with contextlib.suppress(DprError):
            device.stop()
    return Exercised(samples, lost_since(before, device), clock)


class _IdleWatch:
    """Monitor that reads the rods between captures and detects the loss of the device."""

    def __init__(self, device: Device, rig: Rig, outbox: Outbox) -> None:
        self._device, self._rig, self._outbox = device, rig, outbox
        self._counts: dict[int, int] = {}
        self._last_reported: dict[int, int] = {}
        self._last: Idle | None = None

    def look(self) -> None:
        """Receive messages of the device for a short time."""
        for batch in self._device.poll(SETTINGS.look_s):
            self._counts |= {m.joint: m.position for m in batch.messages if isinstance(m, Position)}
        status = self._device.status
        if len(self._counts) == JOINTS and status is not None:
            self._tell(status.latched, self._device.heard_at)

    def _tell(self, latched: bool, time_s: float) -> None:
        """Send the angles of the rods to the screen.

        While the rods are at rest, reports are rare, because each report redraws the screen.
        """
        last, still = self._last, self._still()
        if last is not None and still and latched == last.latched and time_s - last.at < SETTINGS.idle_s:
            return
        if not still:
            self._last_reported = dict(self._counts)
        theta0, theta1, theta2 = self._rig.mounted_theta(
            [self._last_reported[joint] for joint in range(JOINTS)]
        ).tolist()
        self._last = Idle((theta0, theta1, theta2), latched, time_s)
        self._outbox.add_if_read(self._last)

    def _still(self) -> bool:
        """Return whether all encoder readings equal their last reported values, within the noise."""
        noise = 1 + SETTINGS.noises * self._rig.encoders.noise_counts
        return all(
            joint in self._last_reported and abs(n - self._last_reported[joint]) <= noise
            for joint, n in self._counts.items()
        )


def _leave_the_terminal(log: Path) -> None:
    """Detach from the terminal: ignore Ctrl-C, and redirect output to a log.

    The screen handles Ctrl-C. On SIGTERM, the run file is finished.
    """
    if hasattr(os, "setsid"):
        os.setsid()
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        log.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    except OSError:  # the recording is more important than the output of libraries
        descriptor = os.open(os.devnull, os.O_WRONLY)
    sys.stdout.flush()
    for number in (1, 2):
        os.dup2(descriptor, number)


def _interrupt(signum: int, frame: object) -> None:
    raise KeyboardInterrupt
