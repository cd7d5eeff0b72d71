"""Threads for both directions of the recorder's pipe, so that neither delays the other."""

import contextlib
import queue
import threading
from multiprocessing.connection import Connection

from dpr_lab.tui.recorder.messages import CancelAttempt, CaptureAttempt, Exercise, GoAhead, RecorderReport
from dpr_lab.tui.recorder.settings import SETTINGS


class Inbox:
    """Queue of commands that the screen sent to the recorder.

    Cancel requests are received at any time, also during a capture.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._waiting: queue.SimpleQueue[Exercise | CaptureAttempt] = queue.SimpleQueue()
        self._go_ahead: queue.SimpleQueue[GoAhead] = queue.SimpleQueue()
        self._cancelled: set[int] = set()
        self.gone = False
        """Whether the screen has closed its end of the pipe."""
        threading.Thread(target=self._listen, name="orders", daemon=True).start()

    def next(self) -> Exercise | CaptureAttempt | None:
        """Return the next command, or None if no command waits."""
        with contextlib.suppress(queue.Empty):
            return self._waiting.get_nowait()
        return None

    def take_go_ahead(self) -> GoAhead | None:
        """Return the latest release command, and remove all release commands from the queue."""
        latest = None
        with contextlib.suppress(queue.Empty):
            while True:
                latest = self._go_ahead.get_nowait()
        return latest

    def why_to_end(self, attempt: int) -> str:
        """Return the reason to end an attempt, or an empty text."""
        if self.gone:
            return "the screen has ended"
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
    """Queue of reports to the screen.

    A recording is not blocked if the screen does not read the reports.
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._waiting: queue.Queue[RecorderReport | None] = queue.Queue()
        self._sender = threading.Thread(target=self._send, name="reports", daemon=True)
        self._sender.start()

    def add(self, report: RecorderReport) -> None:
        """Send a report that must not be lost."""
        self._waiting.put(report)

    def add_if_read(self, report: RecorderReport) -> bool:
        """Send a report unless too many reports are waiting; return whether the report was sent."""
        room = self._waiting.qsize() < SETTINGS.unread
        if room:
            self._waiting.put(report)
        return room

    def close(self) -> None:
        """Send the remaining reports if the screen reads them in time."""
        self._waiting.put(None)
        self._sender.join(SETTINGS.go_ahead_lasts_s)

    def _send(self) -> None:
        with contextlib.suppress(OSError):  # the screen is lost
            for report in iter(self._waiting.get, None):
                self._connection.send(report)
