"""The process that owns the device: link, driver and capture live here, so that drawing can never cost a sample.

It obeys orders from a pipe and reports what happens. When the other end of the pipe is gone, so is the operator:
nothing is released any more, a recording under way is finished as incomplete, and the process ends.
"""

import contextlib
import os
import queue
import signal
import sys
import threading
import time
import traceback
from collections.abc import Iterable, Mapping
from multiprocessing.connection import Connection
from pathlib import Path

from dpr_lab.capture import Progress, Recorded, Released, capture, check_encoders
from dpr_lab.device import Batch, Device
from dpr_lab.errors import DeviceLost, DprError, SafetyStop
from dpr_lab.holding import raise_faults
from dpr_lab.rig import JOINTS, Rig, load_rig
from dpr_lab.transports import open_transport
from dpr_lab.transports.transport import Transport
from dpr_lab.tui.orders import (
    Asked,
    Cancel,
    Capture,
    Connected,
    Exercise,
    Exercised,
    Failed,
    Finished,
    GoAhead,
    Idle,
    Report,
    Seen,
)
from firmware_protocol.messages import Position

GO_AHEAD_LASTS_S = 2.0  # one that was stuck in a pipe for longer is not what the operator wants now
IDLE_S = 0.1
TRACE_HZ = 100  # a screen has no room for more
UNREAD = 30  # reports of progress kept for a screen that does not read them; about three seconds


def serve(connection: Connection, url: str, rig_name: str, runs: Path, log: Path) -> None:
    """The process, from start to end.

    Args:
        connection: to the screen
        url: the link to open; empty for the rig file's
        rig_name: rig file or built-in name
        runs: folder of the run files
        log: file for what libraries print
    """
    _leave_the_terminal(log)
    orders, reports = Orders(connection), Reports(connection)
    try:
        rig = load_rig(rig_name)
        with contextlib.closing(open_transport(url or rig.link.url, rig_file=rig.path)) as transport:
            with Device(transport) as device:
                _obey(device, transport, rig, runs, orders, reports)
    except (DprError, KeyboardInterrupt) as error:
        reports.add(Failed(None, str(error) or "stopped", alive=False))
    except Exception as error:  # whatever it is, it must reach the screen and not end with the process
        traceback.print_exc()
        reports.add(Failed(None, f"unexpected: {type(error).__name__}: {error}; details are in {log}", alive=False))
    reports.close()


def _obey(device: Device, transport: Transport, rig: Rig, runs: Path, orders: "Orders", reports: "Reports") -> None:
    device.connect()
    reports.add(_connected(device, transport, rig))
    idle = IdleWatch(device, rig, reports)
    while not orders.gone:
        order = orders.next()
        if order is None:
            idle.look()
            continue
        report = _carry_out(order, device, rig, runs, orders, reports)
        reports.add(report)
        if isinstance(report, Failed) and not report.alive:
            return


def _carry_out(
    order: Exercise | Capture, device: Device, rig: Rig, runs: Path, orders: "Orders", reports: "Reports"
) -> Report:
    try:
        if isinstance(order, Exercise):
            return _exercise(device, order)
        attempt = Attempt(order, device, orders, reports)
        captured = capture(device, rig, order.pose, order.options, runs, attempt.on_progress, attempt.confirm)
        return Finished(order.attempt, captured, device.clock_fit())
    except DprError as error:
        attempt_number = order.attempt if isinstance(order, Capture) else None
        return Failed(attempt_number, str(error), alive=not isinstance(error, DeviceLost))


def _connected(device: Device, transport: Transport, rig: Rig) -> Connected:
    rate_hz = rig.link.rate_hz
    problem = ""
    try:
        device.check_rate(rate_hz)
        check_encoders(device, rig)
    except DprError as error:
        problem = str(error)
    loads = tuple(capacity.load(rate_hz) for capacity in transport.capacities)
    return Connected(device.url, device.info, rate_hz, loads, problem)


def _exercise(device: Device, order: Exercise) -> Exercised:
    before = device.losses
    device.hold()
    device.stream(order.rate_hz)
    until, samples = time.monotonic() + order.seconds, 0
    try:
        while time.monotonic() < until:
            batches = device.poll(IDLE_S)
            raise_faults(device.url, batches)
            samples += sum(len(batch.rows) for batch in batches)
        clock = device.clock_fit()
    finally:
        with contextlib.suppress(DprError):
            device.stop()
    return Exercised(samples, _lost_since(before, device), clock)


def _lost_since(before: Mapping[str, int], device: Device) -> dict[str, int]:
    return {cause: count - before[cause] for cause, count in device.losses.items()}


class Attempt:
    """One capture as the operator sees it: reports go out, the go-ahead and the cancel come in."""

    def __init__(self, order: Capture, device: Device, orders: "Orders", reports: "Reports") -> None:
        self._order, self._device, self._orders, self._reports = order, device, orders, reports
        self._lost_before = device.losses
        self._asked_at: float | None = None
        self._released = False

    def on_progress(self, progress: Progress) -> None:
        """Report; ends the capture by raising when the operator wants that or is gone."""
        self._released = self._released or isinstance(progress, Released)
        self._end_if_wanted()
        if isinstance(progress, Recorded):
            progress = _thinned(progress)
        status = self._device.status
        latched = None if status is None else status.latched
        lost = _lost_since(self._lost_before, self._device)
        self._reports.add_if_read(Seen(self._order.attempt, progress, latched, lost))

    def confirm(self) -> bool | None:
        """Whether to release: only on an order given for this attempt and pose, after it was asked for, just now."""
        self._end_if_wanted()
        if self._asked_at is None:
            self._asked_at = time.monotonic()
            self._reports.add(Asked(self._order.attempt))
        order = self._orders.take_go_ahead()
        if order is None or (order.attempt, order.pose) != (self._order.attempt, self._order.pose):
            return None
        fresh = max(self._asked_at, time.monotonic() - GO_AHEAD_LASTS_S) <= order.given_at
        return True if fresh else None

    def _end_if_wanted(self) -> None:
        why = self._orders.why_to_end(self._order.attempt)
        if why:
            raise SafetyStop(why if self._released else f"{why}: nothing was released, the rods stay held")


def _thinned(recorded: Recorded) -> Recorded:
    t, theta = recorded.fresh
    step = max(1, round(1 / (TRACE_HZ * (t[1] - t[0])))) if len(t) > 1 else 1
    return Recorded(recorded.t, recorded.theta, recorded.samples, (t[::step], theta[::step]))


class IdleWatch:
    """Shows where the rods are between captures, and notices when the device goes away."""

    def __init__(self, device: Device, rig: Rig, reports: "Reports") -> None:
        self._device, self._rig, self._reports = device, rig, reports
        self._counts: dict[int, int] = {}

    def look(self) -> None:
        """Take in what the device says, for a moment."""
        batches = self._device.poll(IDLE_S)
        self._note(batches)
        status = self._device.status
        if len(self._counts) == JOINTS and status is not None:
            theta0, theta1, theta2 = self._rig.theta([self._counts[joint] for joint in range(JOINTS)]).tolist()
            self._reports.add_if_read(Idle((theta0, theta1, theta2), status.latched))

    def _note(self, batches: Iterable[Batch]) -> None:
        for batch in batches:
            self._counts |= {m.joint: m.position for m in batch.messages if isinstance(m, Position)}


class Orders:
    """What the screen wants, read by a thread of its own so that a cancel is heard at any time."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._waiting: queue.SimpleQueue[Exercise | Capture] = queue.SimpleQueue()
        self._go_ahead: queue.SimpleQueue[GoAhead] = queue.SimpleQueue()
        self._cancelled: set[int] = set()
        self.gone = False
        """Whether the screen is gone."""
        threading.Thread(target=self._listen, name="orders", daemon=True).start()

    def next(self) -> Exercise | Capture | None:
        """The next thing to do, if there is one."""
        with contextlib.suppress(queue.Empty):
            return self._waiting.get_nowait()
        return None

    def take_go_ahead(self) -> GoAhead | None:
        """The latest go-ahead, once."""
        latest = None
        with contextlib.suppress(queue.Empty):
            while True:
                latest = self._go_ahead.get_nowait()
        return latest

    def why_to_end(self, attempt: int) -> str:
        """Why an attempt is to end; empty when it is not."""
        if self.gone:
            return "the screen is gone"
        return "stopped by the operator" if attempt in self._cancelled else ""

    def _listen(self) -> None:
        with contextlib.suppress(EOFError, OSError):
            while True:
                match self._connection.recv():
                    case GoAhead() as order:
                        self._go_ahead.put(order)
                    case Cancel(attempt=attempt):
                        self._cancelled.add(attempt)
                    case order:
                        self._waiting.put(order)
        self.gone = True


class Reports:
    """What the screen is told, sent by a thread of its own: a screen that does not read must not stop a recording."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._waiting: queue.Queue[Report | None] = queue.Queue()
        self._sender = threading.Thread(target=self._send, name="reports", daemon=True)
        self._sender.start()

    def add(self, report: Report) -> None:
        """Something the screen must hear."""
        self._waiting.put(report)

    def add_if_read(self, report: Report) -> None:
        """Something that is soon out of date."""
        if self._waiting.qsize() < UNREAD:
            self._waiting.put(report)

    def close(self) -> None:
        """Send what is left, for as long as the screen reads."""
        self._waiting.put(None)
        self._sender.join(GO_AHEAD_LASTS_S)

    def _send(self) -> None:
        with contextlib.suppress(OSError):  # the screen is gone
            for report in iter(self._waiting.get, None):
                self._connection.send(report)


def _leave_the_terminal(log: Path) -> None:
    """Keys and screen belong to the other process; a terminal that closes ends that one, and we finish our file."""
    if hasattr(os, "setsid"):
        os.setsid()
    signal.signal(signal.SIGTERM, _interrupt)
    log.parent.mkdir(parents=True, exist_ok=True)
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    sys.stdout.flush()
    for number in (1, 2):
        os.dup2(descriptor, number)


def _interrupt(signum: int, frame: object) -> None:
    raise KeyboardInterrupt
