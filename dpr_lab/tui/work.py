"""Long work in a process of its own: progress over a pipe, pause, stop and cancel, so that the screen never waits."""

import contextlib
import os
import signal
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext
from queue import SimpleQueue
from typing import Any

from dpr_lab.errors import DprError

PATIENCE_S = 5.0
"""How long an ended process may take to go before it is killed."""

NICER = 5  # the screen, and a recording beside it, come first


@dataclass(frozen=True, slots=True)
class Progress:
    """Something the work reported."""

    value: Any


@dataclass(frozen=True, slots=True)
class Finished:
    """The work is done."""

    result: Any


@dataclass(frozen=True, slots=True)
class Failed:
    """The work ended without a result."""

    message: str
    """What happened and what to do."""
    details: str = ""
    """Traceback of what should not have happened; empty for an error that the operator can act on."""

    @property
    def error(self) -> Exception:
        """The same as an exception, with the traceback as a note."""
        if not self.details:
            return DprError(self.message)
        error = RuntimeError(self.message)
        error.add_note(self.details)
        return error


@dataclass(frozen=True, slots=True)
class Cancelled:
    """The work was ended on request; nothing of it is kept."""


Event = Progress | Finished | Failed | Cancelled


class Control:
    """What the work sees of whoever started it."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._going = threading.Event()
        self._going.set()
        self._stop = threading.Event()
        self._asked: SimpleQueue[Any] = SimpleQueue()

    def report(self, value: Any) -> None:
        """Tell how far it is; the value must be picklable."""
        self._connection.send(Progress(value))

    def proceed(self) -> bool:
        """Wait while paused; false once asked to stop and keep what there is."""
        self._going.wait()
        return not self._stop.is_set()

    def questions(self) -> Iterator[Any]:
        """What is asked from now on, without end; of questions that piled up meanwhile only the newest."""
        while True:
            question = self._asked.get()
            while not self._asked.empty():
                question = self._asked.get()
            yield question

    def listen(self) -> None:
        """Obey until the other end is gone; then there is nobody left to work for."""
        with contextlib.suppress(EOFError, OSError):
            while True:
                match self._connection.recv():
                    case "pause":
                        self._going.clear()
                    case "resume":
                        self._going.set()
                    case "stop":
                        self._stop.set()
                        self._going.set()
                    case ("ask", question):
                        self._asked.put(question)
        os._exit(1)


class Job:
    """A function at work in its own process, from the moment it is made.

    Args:
        function: called there as `function(control, **arguments)`; importable by name
        arguments: picklable
    """

    def __init__(self, function: Callable[..., Any], **arguments: Any) -> None:
        context = spawning()
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_work, args=(theirs, function, arguments), daemon=True)
        self._process.start()
        theirs.close()
        self.paused = False
        self.stopping = False
        self._cancelled = False

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._process.is_alive()

    def events(self) -> Iterator[Event]:
        """What it reports, ending with its end; waits for each, so read it in a thread."""
        event: Event = Progress(None)
        while isinstance(event, Progress):
            try:
                event = self._pipe.recv()
            except (EOFError, OSError):
                event = self._gone()
            yield event
        self._process.join(PATIENCE_S)
        self._process.kill()

    def pause(self) -> None:
        """Hold it at the next point where it can wait."""
        self._tell("pause")
        self.paused = True

    def resume(self) -> None:
        """Let it go on."""
        self._tell("resume")
        self.paused = False

    def stop(self) -> None:
        """Ask it to end early and keep the best so far."""
        self._tell("stop")
        self.stopping, self.paused = True, False

    def ask(self, question: Any) -> None:
        """Ask work that takes questions; the answer comes as progress."""
        self._tell(("ask", question))

    def cancel(self) -> None:
        """End it at once; nothing is kept."""
        self._cancelled = True
        self._process.terminate()

    def _tell(self, command: Any) -> None:
        with contextlib.suppress(OSError):  # it may just have ended
            self._pipe.send(command)

    def _gone(self) -> Event:
        self._process.join(PATIENCE_S)
        if self._cancelled:
            return Cancelled()
        return Failed(
            f"the work's process ended unexpectedly (exit code {self._process.exitcode}); nothing was lost but its"
            " result: start it again, with less beside it if memory was short"
        )


def spawning() -> SpawnContext:
    """The way to start a process while the screen runs.

    Textual's stand-in for stderr has no file descriptor, yet the tracker that every spawned process needs would be
    given one; so the tracker starts with the real stderr.
    """
    if os.name == "posix":
        from multiprocessing import resource_tracker

        with contextlib.redirect_stderr(sys.__stderr__):
            resource_tracker.ensure_running()
    return get_context("spawn")


def _work(connection: Connection, function: Callable[..., Any], arguments: dict[str, Any]) -> None:
    _leave_the_terminal_alone()
    control = Control(connection)
    threading.Thread(target=control.listen, daemon=True).start()
    try:
        event: Event = Finished(function(control, **arguments))
    except DprError as error:
        event = Failed(str(error))
    except Exception as error:  # whatever it is, it must reach the screen and not end with the process
        event = Failed(f"{type(error).__name__}: {error}", traceback.format_exc())
    connection.send(event)


def _leave_the_terminal_alone() -> None:
    """Keys and screen belong to whoever started this process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for descriptor in (1, 2):
        os.dup2(nowhere, descriptor)
    if hasattr(os, "nice"):
        os.nice(NICER)
