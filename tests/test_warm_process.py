"""A process that is forked from one with the libraries loaded behaves like a new process."""

import os
import signal
import subprocess
import sys
from importlib import import_module
from multiprocessing.connection import Connection

import pytest

from dpr_lab.child_process import ChildFunction
from tests.warm_process import WarmProcess, started

PATIENCE_S = 60.0


def test_it_has_its_words_streams_and_exit_code() -> None:
    import_module("dpr_lab.kernels")  # sets variables of its own
    with started("sim_device", ["--help"], stdout=subprocess.PIPE, text=True) as process:
        out, _ = process.communicate()
    assert isinstance(process, WarmProcess)
    assert process.returncode == 0
    assert "usage: python -m sim_device" in out


def test_a_signal_ends_it_and_is_its_status() -> None:
    with started("sim_device", [], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline().startswith(b"{")
        assert process.poll() is None
        process.kill()
    assert process.returncode == -signal.SIGKILL


def test_variables_of_its_own_do_not_start_a_fresh_process_and_a_terminal_is_its_own() -> None:
    master, slave = os.openpty()
    environment = {**os.environ, "DPR_LAB_STATE": "elsewhere"}
    options = {"stdin": slave, "stdout": slave, "env": environment, "start_new_session": True}
    with started("sim_device", [], **options) as process:
        os.close(slave)
        assert isinstance(process, WarmProcess)
        assert os.read(master, 1) == b"{"
        os.write(master, b"\x03")  # only a controlling terminal sends the signal
        assert process.wait(PATIENCE_S) == 0
    os.close(master)


@pytest.mark.slow
def test_variables_that_the_libraries_read_start_a_fresh_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    with started("sim_device", ["--help"], stdout=subprocess.DEVNULL) as process:
        pass
    assert not isinstance(process, WarmProcess)
    assert process.returncode == 0


def send_whether_forked(connection: Connection) -> None:
    """Only a forked process has loaded the libraries before it runs this function."""
    connection.send("tests.loaded" in sys.modules)


def test_a_process_that_it_starts_with_multiprocessing_is_forked() -> None:
    with started("tests.test_warm_process", [], stdout=subprocess.PIPE, text=True) as process:
        out, _ = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, out) == (0, "True\n")


if __name__ == "__main__":
    child = ChildFunction(send_whether_forked)
    print(child.pipe.recv())
    child.end()
