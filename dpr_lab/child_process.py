"""Child processes: started, talked to, and ended within a bounded time; none outlives this process.

    ChildFunction    a function of ours with a pipe between: work that must not stop a screen, the owner of a device
    ChildProgram     another program, its lines read from pipes: the simulated device
    worker_pool      several processes that share out calls: campaigns

A process that was killed cannot end its children, so each child watches for that itself: a `ChildFunction` by the end
of its pipe (its `recv` raises EOFError), a `ChildProgram` by the end of its stdin, a worker by its parent's death.
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
    """The way to start a process that runs our code, also while a screen is drawn.

    Textual's stand-in for stderr has no file descriptor, yet the tracker that every spawned process needs would be
    given one; so the tracker starts with the real stderr.
    """
    if os.name == "posix":
        from multiprocessing import resource_tracker

        with contextlib.redirect_stderr(sys.__stderr__):
            resource_tracker.ensure_running()
    return get_context("spawn")


class ChildFunction:
    """A function that runs in its own process, connected by a pipe.

    Args:
        function: called there as `function(connection, *arguments)`; importable by name, and to return soon after the
            other end of its pipe is gone
        arguments: picklable
    """

    def __init__(self, function: Callable[..., None], *arguments: Any) -> None:
        context = spawn_context()
        self.pipe: Connection
        """This process's end."""
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(target=function, args=(theirs, *arguments), daemon=True)
        self._process.start()
        theirs.close()

    @property
    def alive(self) -> bool:
        """Whether it still runs."""
        return self._process.is_alive()

    @property
    def exit_code(self) -> int | None:
        """Exit code of the process, negative for a signal; None while it runs."""
        return self._process.exitcode

    def wait(self, patience_s: float) -> bool:
        """Wait for the end of the process at most this long; return whether it ended."""
        self._process.join(patience_s)
        return not self._process.is_alive()

    def terminate(self) -> None:
        """Send the process a signal to end."""
        self._process.terminate()

    def end(self, patience_s: float) -> None:
        """Close the pipe; end it by signals, politely first, where that alone does not; ending twice is harmless.

        Args:
            patience_s: how long to wait for each of these three to have an effect
        """
        _insist((self.pipe.close, self._process.terminate, self._process.kill), lambda: self.wait(patience_s))


class ChildProgram:
    """Another program; its stdin is its life line, which breaks when this process is gone, however it went.

    It hears no Ctrl-C: that is for this process, which ends it in its own time.

    Args:
        command: the program, and its words
    """

    def __init__(self, command: Sequence[str]) -> None:
        self._log: IO[bytes] = tempfile.TemporaryFile()
        self._last_words = ""
        self._process = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log, start_new_session=True
        )

    @property
    def pid(self) -> int:
        """Its number."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Exit code of the process, negative for a signal; None while it runs."""
        return self._process.poll()

    @property
    def last_words(self) -> str:
        """The last line on its stderr; empty when it wrote none."""
        if not self._log.closed:
            self._log.seek(0)
            lines = [line.strip() for line in self._log.read().decode(errors="replace").split("\n")]
            self._last_words = next((line for line in reversed(lines) if line), "")
        return self._last_words

    def line(self, timeout: float) -> str:
        """The next line of its stdout; empty when it ended before, or did not write one within `timeout` s."""
        stdout, lines = self._process.stdout, []
        assert stdout is not None
        reader = threading.Thread(target=lambda: lines.append(stdout.readline()), daemon=True)
        reader.start()
        reader.join(timeout)
        return lines[0].decode(errors="replace") if lines else ""

    def end(self, patience_s: float) -> None:
        """Close its stdin; end it by signals, politely first, where that alone does not; ending twice is harmless.

        Args:
            patience_s: how long to wait for each of these three to have an effect
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


def _insist(ways: Sequence[Callable[[], None]], ended: Callable[[], bool]) -> None:
    """Try one way to end a process after the other, until one had an effect."""
    for way in ways:
        way()
        if ended():
            return


@contextlib.contextmanager
def worker_pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """Processes to submit calls to, each on one thread; they leave Ctrl-C to this process, and end with it.

    Left by an exception, they end at once: nobody waits for what was not asked for yet.
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
    # The libraries read these when they are imported, which the first call makes them do.
    for name in ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[name] = "1"
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=lambda: (parent.join(), os._exit(1)), daemon=True).start()
