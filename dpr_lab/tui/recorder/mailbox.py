"""Both ends of the recorder's pipe, each on a thread of its own: neither hears late because the other is busy."""

import contextlib
import queue
import threading
from multiprocessing.connection import Connection

from dpr_lab.tui.recorder.messages import CancelAttempt, CaptureAttempt, Exercise, GoAhead, RecorderReport
from dpr_lab.tui.recorder.settings import SETTINGS


class Inbox:
    """Orders of the screen; a cancel is received at any time."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._waiting: queue.SimpleQueue[Exercise | CaptureAttempt] = queue.SimpleQueue()
        self._go_ahead: queue.SimpleQueue[GoAhead] = queue.SimpleQueue()
        self._cancelled: set[int] = set()
        self.gone = False
        """Whether the screen is gone."""
        threading.Thread(target=self._listen, name="orders", daemon=True).start()

    def next(self) -> Exercise | CaptureAttempt | None:
        """Next order, if any."""
        with contextlib.suppress(queue.Empty):
            return self._waiting.get_nowait()
        return None

    def take_go_ahead(self) -> GoAhead | None:
        """Return the latest go-ahead and remove it."""
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
                    case CancelAttempt(attempt=attempt):
                        self._cancelled.add(attempt)
                    case order:
                        self._waiting.put(order)
        self.gone = True


class Outbox:
    """Messages to the screen; a screen that does not read must not stop a recording."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._waiting: queue.Queue[RecorderReport | None] = queue.Queue()
        self._sender = threading.Thread(target=self._send, name="reports", daemon=True)
        self._sender.start()

    def add(self, report: RecorderReport) -> None:
        """Something the screen must hear."""
        self._waiting.put(report)

    def add_if_read(self, report: RecorderReport) -> bool:
        """Send something that is soon out of date, unless reports wait unread; returns whether it is sent."""
        room = self._waiting.qsize() < SETTINGS.unread
        if room:
            self._waiting.put(report)
        return room

    def close(self) -> None:
        """Send what is left, for as long as the screen reads."""
        self._waiting.put(None)
        self._sender.join(SETTINGS.go_ahead_lasts_s)

    def _send(self) -> None:
        with contextlib.suppress(OSError):  # the screen is gone
            for report in iter(self._waiting.get, None):
                self._connection.send(report)
