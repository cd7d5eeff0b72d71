"""Connection of a job process to the screen: sends progress, and receives commands."""

import contextlib
import os
import signal
import threading
import traceback
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import Any

from dpr_lab.errors import DprError
from dpr_lab.progress import watch_compiling
from dpr_lab.tui.jobs.job_events import JobCompiling, JobEvent, JobFailed, JobFinished, JobProgress


class JobControl:
    """Connection of a job process to the process that started it."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._sending = threading.Lock()
        self._stop = threading.Event()

    def report(self, value: Any) -> None:
        """Report progress; the value must be picklable."""
        self.send(JobProgress(value))

    def proceed(self) -> bool:
        """Return False if the job must end early with its best result so far."""
        return not self._stop.is_set()

    def listen(self) -> None:
        """Wait for the command to stop the job; end the process when the connection closes."""
        with contextlib.suppress(EOFError, OSError):
            while self._connection.recv() == "stop":
                self._stop.set()
        os._exit(1)

    def send(self, event: JobEvent) -> None:
        """Send an event; this method may be called from any thread."""
        with self._sending:
            self._connection.send(event)


def work(connection: Connection, function: Callable[..., Any], arguments: dict[str, Any]) -> None:
    """Run a job in this process: call `function(control, **arguments)` and report its result or error."""
    _leave_the_terminal_alone()
    control = JobControl(connection)
    threading.Thread(target=control.listen, daemon=True).start()
    try:
        with watch_compiling(lambda: control.send(JobCompiling())):
            event: JobEvent = JobFinished(function(control, **arguments))
    except DprError as error:
        event = JobFailed(str(error))
    except Exception as error:  # every error must be reported to the screen, not only end the process
        event = JobFailed(f"{type(error).__name__}: {error}", traceback.format_exc())
    control.send(event)


def _leave_the_terminal_alone() -> None:
    """Ignore Ctrl-C, which the parent process handles, discard all output, and lower the priority."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (1, 2):
        os.dup2(nowhere, descriptor)
    if hasattr(os, "nice"):
        os.nice(5)
