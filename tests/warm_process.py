"""`dpr_lab` and `sim_device` as processes that are forked from one with the libraries loaded (`tests/warm.py`)."""

import atexit
import json
import os
import select
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any

DEVICE = [sys.executable, "-m", "sim_device"]
SERVER = "DPR_LAB_TESTS_SERVER"
"""Variable with the socket of the server and the variables with which it was started."""
SET_BY_DPR_LAB = ("OMP_WAIT_POLICY", "PYTHONPYCACHEPREFIX")
"""Variables that dpr-lab sets for itself and what it starts, when it is imported or a command runs."""


def start_server() -> None:
    """Start the server for this process and its children. The libraries are loaded at the first request."""
    if SERVER in os.environ:
        return
    place = Path(tempfile.mkdtemp(prefix="dpr-lab-tests-")) / "server"
    command = [sys.executable, str(Path(__file__).with_name("warm.py")), str(place)]
    server = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert server.stdout is not None
    assert server.stdout.readline() == b"listening\n"
    atexit.register(server.communicate)  # it ends with its stdin
    os.environ[SERVER] = json.dumps([str(place), _of_loading()])


def _of_loading(environment: Mapping[str, str] = os.environ) -> dict[str, str]:
    """Variables that Python or a library reads when it is loaded."""
    names = ("NUMBA", "PYTHON", "OMP", "OPENBLAS", "XDG", "HOME", "MPL")
    return {name: value for name, value in environment.items() if name.startswith(names) and name not in SET_BY_DPR_LAB}


class WarmProcess(subprocess.Popen[Any]):
    """Replacement for `Popen` of `python -m PROGRAM WORDS`.

    The process is a child of the server, which reports its status.
    """

    def __init__(self, place: str, program: str, words: Sequence[object], **options: Any) -> None:
        environment = options.pop("env", None) or os.environ
        self._place, self._line = place, socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._asked = {
            "program": program,
            "words": list(map(str, words)),
            "folder": str(options.pop("cwd", None) or Path.cwd()),
            "environment": dict(environment),
            "session": options.pop("start_new_session", False),
        }
        super().__init__([program], **options)

    def _execute_child(self, *details: Any) -> None:
        pipes = details[10:16]  # p2cread, p2cwrite, c2pread, c2pwrite, errread, errwrite
        ends = [end if end >= 0 else number for number, end in enumerate((pipes[0], pipes[3], pipes[5]))]
        self._line.connect(self._place)
        message = json.dumps(self._asked).encode() + b"\n"
        self._line.sendall(message[socket.send_fds(self._line, [message], ends) :])
        self.pid = self._answer()
        self._child_created = True
        self._close_pipe_fds(*pipes)  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType]

    def _try_wait(self, wait_flags: int) -> tuple[int, int]:
        if wait_flags & os.WNOHANG and not select.select([self._line], [], [], 0)[0]:
            return 0, 0
        status = self._answer()
        self._line.close()
        return self.pid, status

    def _answer(self) -> int:
        if len(answer := self._line.recv(4, socket.MSG_WAITALL)) < 4:
            raise ChildProcessError("the process that commands are forked from has ended")
        return int.from_bytes(answer)

    def _internal_poll(self, *_: Any, **__: Any) -> int | None:
        if self.returncode is None:
            pid, status = self._try_wait(os.WNOHANG)
            if pid:
                self._handle_exitstatus(status)  # pyright: ignore[reportAttributeAccessIssue, reportUnknownMemberType]
        return self.returncode


def started(program: str, words: Sequence[object], **options: Any) -> "subprocess.Popen[Any]":
    """Start a process of a program; a new process if variables differ that are read when the libraries are loaded."""
    start_server()
    place, loaded = json.loads(os.environ[SERVER])
    if _of_loading(options.get("env") or os.environ) != loaded:
        return subprocess.Popen([sys.executable, "-m", program, *map(str, words)], **options)
    return WarmProcess(place, program, words, **options)


def starts_device(start: "Callable[..., subprocess.Popen[Any]]") -> SimpleNamespace:
    """In place of `subprocess` in a module that starts the simulated device: `start(words, **options)` does it."""

    def popen(command: Sequence[str], **options: Any) -> "subprocess.Popen[Any]":
        if list(command[:3]) == DEVICE:
            return start(command[3:], **options)
        return subprocess.Popen(command, **options)

    def run(command: Sequence[str], *, capture_output: bool, check: bool, **options: Any) -> Any:
        assert capture_output
        assert not check
        with popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options) as process:
            out, err = process.communicate()
        return subprocess.CompletedProcess(command, process.returncode, out, err)

    return SimpleNamespace(
        Popen=popen,
        run=run,
        PIPE=subprocess.PIPE,
        DEVNULL=subprocess.DEVNULL,
        TimeoutExpired=subprocess.TimeoutExpired,
    )


if __name__ == "__main__":
    sys.exit(started(sys.argv[1], sys.argv[2:]).wait())
