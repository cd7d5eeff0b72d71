"""Child processes: communication, limited time to end, and no survival of the parent process."""

import os
import signal
import subprocess
import sys
import time
from multiprocessing.connection import Connection

import pytest

from dpr_lab.child_process import ChildFunction, ChildProgram, worker_pool

LISTENER = "import sys; print('ready', flush=True); print('so far\\nso good', file=sys.stderr, flush=True);"
DEAF = "import signal; signal.signal(signal.SIGTERM, signal.SIG_IGN);"


def echo(connection: Connection, suffix: str) -> None:
    try:
        while True:
            connection.send(connection.recv() + suffix)
    except EOFError:
        return


def deaf(connection: Connection) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    connection.send("deaf")
    time.sleep(600)


def slow(number: int) -> int:
    time.sleep(0.2)
    return number


def gone(pid: int, within_s: float = 60.0) -> bool:
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        try:
            os.kill(pid, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.05)
    return False


def test_a_function_communicates_by_its_pipe_and_ends_with_it() -> None:
    child = ChildFunction(echo, "!")
    child.pipe.send("hello")
    assert child.pipe.recv() == "hello!"
    assert child.alive
    child.end(patience_s=30)
    assert (child.alive, child.exit_code) == (False, 0)
    child.end(patience_s=30)


def test_a_function_that_does_not_respond_is_killed() -> None:
    child = ChildFunction(deaf)
    assert child.pipe.recv() == "deaf"
    child.end(patience_s=0.2)
    assert child.wait(patience_s=60)
    assert child.exit_code == -signal.SIGKILL


def test_a_program_is_read_and_ends_with_its_stdin() -> None:
    child = ChildProgram([sys.executable, "-c", f"{LISTENER} sys.stdin.read()"])
    assert child.line(timeout=400) == "ready\n"
    assert child.exit_code is None
    child.end(patience_s=30)
    assert (child.exit_code, child.last_words) == (0, "so good")
    child.end(patience_s=30)


def test_a_silent_program_does_not_block_its_reader() -> None:
    child = ChildProgram([sys.executable, "-c", "import sys; sys.stdin.read()"])
    assert child.line(timeout=0.1) == ""
    child.end(patience_s=30)
    assert (child.exit_code, child.last_words) == (0, "")


def test_a_program_that_does_not_respond_is_killed() -> None:
    child = ChildProgram([sys.executable, "-c", f"{DEAF} {LISTENER} import time; time.sleep(600)"])
    assert child.line(timeout=400) == "ready\n"
    child.end(patience_s=0.2)
    child._process.wait(60)
    assert child.exit_code == -signal.SIGKILL


def test_a_killed_process_leaves_no_program_behind() -> None:
    code = (
        "import sys, time\nfrom dpr_lab.child_process import ChildProgram\n"
        "child = ChildProgram([sys.executable, '-c', 'import sys; sys.stdin.read()'])\n"
        "print(child.pid, flush=True)\ntime.sleep(600)"
    )
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True) as parent:
        assert parent.stdout is not None
        pid = int(parent.stdout.readline())
        parent.kill()
    assert gone(pid)


def test_workers_share_calls_and_end_when_no_caller_waits() -> None:
    with worker_pool(2) as pool:
        assert sorted(pool.map(slow, range(4))) == [0, 1, 2, 3]
    began = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        broken_off()
    assert time.monotonic() - began < 300  # each call takes ten minutes


def broken_off() -> None:
    with worker_pool(1) as pool:
        for _ in range(3):
            pool.submit(time.sleep, 600)
        raise KeyboardInterrupt
