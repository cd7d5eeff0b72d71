"""Start child processes, communicate with them, and end them within a bounded time.

    ChildFunction   runs a function in another process and connects it by a pipe
    ChildProgram    runs another program, such as the simulated device, and reads the lines of its output
    worker_pool     distributes calls over several processes

No child process outlives this process. A process that was killed cannot end its children, so each child detects this
itself. A `ChildFunction` detects that its pipe is closed (its `recv` raises EOFError), a `ChildProgram` that its stdin
is closed, and a worker that its parent has ended.
"""

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import active_children, get_context, parent_process
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext
from typing import IO, Any


def spawn_context() -> SpawnContext:
    """Return a multiprocessing context that also works while a Textual screen is shown.

    Textual replaces stderr by an object without a file descriptor. Every spawned process needs the resource tracker,
    which requires a file descriptor. The tracker is therefore started with the real stderr.
    """
    if os.name == "posix":
        from multiprocessing import resource_tracker

        with contextlib.redirect_stderr(sys.__stderr__):
            resource_tracker.ensure_running()
    return get_context("spawn")


class ChildFunction:
    """Function that runs in a separate process, connected by a pipe.

    Args:
        function: called in the process as `function(connection, *arguments)`; importable by name; it must return soon
            after the other end of its pipe is closed
        arguments: picklable
    """

    def __init__(self, function: Callable[..., None], *arguments: Any) -> None:
        context = spawn_context()
        self.pipe: Connection
        """This end of the pipe."""
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(target=function, args=(theirs, *arguments), daemon=True)
        self._process.start()
        theirs.close()

    @property
    def alive(self) -> bool:
        """Whether the process still runs."""
        return self._process.is_alive()

    @property
    def exit_code(self) -> int | None:
        """Exit code of the process, negative for a signal; None while it runs."""
        return self._process.exitcode

    def wait(self, patience_s: float) -> bool:
        """Wait at most `patience_s` for the end of the process; return whether it ended."""
        self._process.join(patience_s)
        return not self._process.is_alive()

    def terminate(self) -> None:
        """Send the process a termination signal."""
        self._process.terminate()

    def end(self, patience_s: float = 2.0) -> None:
        """Close the pipe; if the process does not end, send it SIGTERM, then SIGKILL.

        Args:
            patience_s: maximum waiting time after closing the pipe, after SIGTERM and after SIGKILL, s
        """
        _insist((self.pipe.close, self._process.terminate, self._process.kill), lambda: self.wait(patience_s))


class ChildProgram:
    """Child process that runs another program.

    The program ends when its stdin is closed, which also happens when this process is killed. Ctrl-C is not forwarded:
    this process receives it and ends the program.

    Args:
        command: the program and its arguments
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._log: IO[bytes] = tempfile.TemporaryFile()
        self._last_words = ""
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, start_new_session=True
        )

    @property
    def pid(self) -> int:
        """Process identifier (PID)."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Exit code of the process, negative for a signal; None while it runs."""
        return self._process.poll()

    @property
    def last_words(self) -> str:
        """Last non-empty line that the program wrote to stderr; empty if there is none."""
        if not self._log.closed:
            self._log.seek(0)
            lines = [line.strip() for line in self._log.read().decode(errors="replace").split("\n")]
            self._last_words = next((line for line in reversed(lines) if line), "")
        return self._last_words

    def line(self, timeout: float) -> str:
        """Return the next line from the program's stdout.

        The result is empty if the program has ended or writes no line within `timeout` s.
        """
        stdout, lines = self._process.stdout, []
        assert stdout is not None
        reader = threading.Thread(target=lambda: lines.append(stdout.readline()), daemon=True)
        reader.start()
        reader.join(timeout)
        return lines[0].decode(errors="replace") if lines else ""

    def end(self, patience_s: float) -> None:
        """Close stdin; if the program does not end, send it SIGTERM, then SIGKILL.

        Args:
            patience_s: maximum waiting time after closing stdin, after SIGTERM and after SIGKILL, s
        """
        stdin, stdout = self._process.stdin, self._process.stdout
        assert stdin is not None
        assert stdout is not None
        _insist((stdin.close, self._process.terminate, self._process.kill), lambda: self._wait(patience_s))
        self._last_words = self.last_words
        stdout.close()
        self._log.close()

    def _wait(self, patience_s: float) -> bool:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(patience_s)
        return self._process.returncode is not None


def _insist(methods: Sequence[Callable[[], None]], ended: Callable[[], bool]) -> None:
    """End a process by successively stronger methods, until one succeeds."""
    for method in methods:
        method()
        if ended():
            return


@contextlib.contextmanager
def worker_pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """Provide a pool of worker processes with one thread each (context manager).

    The workers ignore Ctrl-C and end with this process. If an exception leaves the context, they end at once, and
    pending calls are discarded.
    """
    others = active_children()
    with ProcessPoolExecutor(processes, spawn_context(), initializer=_begin_worker) as pool:
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in active_children():
                if worker not in others:
                    worker.terminate()
            raise


def _begin_worker() -> None:
    # The libraries read these variables when they are first imported. Numba raises an error if they change later.
    names = ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", *(["NUMBA_NUM_THREADS"] if "numba" not in sys.modules else [])]
    os.environ.update(dict.fromkeys(names, "1"))
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()
