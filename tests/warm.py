"""Server that forks processes from a process with the libraries loaded, shared by all test processes.

    python tests/warm.py SOCKET

Each connection asks for one process: a program (`dpr_lab` or `sim_device`), its words, folder, environment and session
as a line of JSON, with the descriptors of its three streams. The answers are the number of the process, and its status
when it has ended. The server ends with its stdin. `tests/warm_process.py` is the other end.
"""

import atexit
import fcntl
import json
import os
import runpy
import select
import shutil
import socket
import sys
import termios
import threading
import traceback
from contextlib import suppress
from importlib import import_module
from pathlib import Path


def main() -> None:
    """Answer every connection by a separate process. The libraries are loaded for the first connection."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.bind(sys.argv[1])
    listener.listen(64)
    print("listening", flush=True)
    while listener in select.select([sys.stdin, listener], [], [])[0]:
        line, _ = listener.accept()
        import_module("tests.loaded")
        if os.fork() == 0:
            answer(line)
        line.close()
        count_ended()
    count_ended()
    shutil.rmtree(Path(sys.argv[1]).parent)


def count_ended() -> None:
    """Add the CPU time of ended processes to that of the tests."""
    with suppress(ChildProcessError):
        while os.waitpid(-1, os.WNOHANG)[0]:
            pass


def answer(line: socket.socket) -> None:
    """Fork the requested process and wait for its end."""
    message, streams, _, _ = socket.recv_fds(line, 1 << 16, 3)
    while not message.endswith(b"\n"):
        if not (more := line.recv(1 << 16)):  # who asked has ended
            os._exit(1)
        message += more
    if (child := os.fork()) == 0:
        become(streams, **json.loads(message))
    for stream in streams:
        os.close(stream)
    with suppress(OSError):  # who asked has ended
        line.send(child.to_bytes(4))
    _, status = os.waitpid(child, 0)
    with suppress(OSError):
        line.send(status.to_bytes(4))
    os._exit(0)


def become(
    streams: list[int], program: str, words: list[str], folder: str, environment: dict[str, str], session: bool
) -> None:
    """Take the place of a new process."""
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)
    if session:
        os.setsid()
    for number, (name, stream) in enumerate(zip(("stdin", "stdout", "stderr"), streams, strict=True)):
        os.dup2(stream, number)
        setattr(sys, name, open(number, "w" if number else "r", closefd=False))
        setattr(sys, f"__{name}__", getattr(sys, name))
    os.closerange(3, 1 << 16)
    if session and os.isatty(0):
        fcntl.ioctl(0, termios.TIOCSCTTY, 0)
    sys.argv = [program, *words]
    os._exit(ended(program))


def ended(program: str) -> int:
    """Run a program to its end, as the interpreter does, but for taking down all that is loaded; its exit code."""
    code: object = 0
    try:
        runpy.run_module(program, run_name="__main__", alter_sys=True)
    except SystemExit as end:
        code = end.code or 0
    except BaseException:
        traceback.print_exc()
        code = 1
    for thread in threading.enumerate():
        if thread is not threading.current_thread() and not thread.daemon:
            thread.join()
    atexit._run_exitfuncs()
    sys.stdout.flush()
    sys.stderr.flush()
    return code if isinstance(code, int) else 1


if __name__ == "__main__":
    main()
