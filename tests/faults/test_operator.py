"""Faults of the computer during captures in separate processes: signals, full disks, high load."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dpr_lab.storage.inspect import info, recover, verify
from tests.full_disk import full_disk
from tests.warm_process import started

FULL = os.environ.get("DPR_LAB_FULL") == "1"
KILLS, AT_A_TIME = (50, 2) if FULL else (1, 1)
"""Rounds, and processes of each signal in a round."""
LINKS = {"serial": "sim://?seed=5&clock={clock}", "CAN": "sim://?seed=5&clock={clock}&bus=can"}
pytestmark = pytest.mark.slow
SMALL_DISK = 40_000
"""Room for a run file, bytes: more than the rest before the release takes."""
UNTIL = "every sample until then, in a file marked as incomplete"


def by_turns(*numbers: signal.Signals) -> list[Any]:
    """Every signal over every link. Fast tests use each signal with one link."""
    return [
        pytest.param(number, link, id=f"{number.name}, {link}", marks=[pytest.mark.long] if turn != place else [])
        for turn, number in enumerate(numbers)
        for place, link in enumerate(LINKS)
    ]


def start(out: Path, link: str, *words: str, clock: str = "realtime") -> subprocess.Popen[str]:
    command = ["capture", "--rig", "paper", "--pose", "X1", "--yes", "--link", LINKS[link].format(clock=clock)]
    words = (*command, "--out", str(out), *words)
    return started("dpr_lab", words, stdin=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def await_file(out: Path, process: subprocess.Popen[str], size: int = 1) -> Path:
    """Wait until a process has written a run file of a given size, and return the file."""
    while True:
        for path in out.glob("*.mcap"):
            if path.stat().st_size >= size:
                return path
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.005)


def await_release(out: Path, process: subprocess.Popen[str], size: int) -> Path:
    """Wait until the run file contains the release and has a given size."""
    path = await_file(out, process, size)
    while not _readable(path):
        assert process.poll() is None, process.communicate()[1]
        time.sleep(0.05)
    return path


def last_line(process: subprocess.Popen[str]) -> str:
    return process.communicate(timeout=400)[1].strip().splitlines()[-1]


@pytest.mark.parametrize(("number", "link"), by_turns(signal.SIGINT, signal.SIGTERM))
def test_a_stopped_capture_finishes_its_file(
    number: signal.Signals, link: str, tmp_path: Path, wrong_samples, matrix
) -> None:
    process = start(tmp_path, link, "--duration", "60")
    path = await_release(tmp_path, process, 40_000)
    process.send_signal(number)
    result = last_line(process)
    assert process.returncode == 130
    about = info(path)
    assert about.stopped == "stopped by the operator"
    assert about.damage == ""
    assert about.clock["n"] >= 5
    assert wrong_samples(path) == 0
    matrix.show(f"{number.name} during the swing", link, result, process.returncode, UNTIL)


def halted_three_times(folder: Path, link: str) -> tuple[int, Path, str]:
    """Stop the process of a capture three times for 300 ms; return its exit code, its file and its last message."""
    folder.mkdir()
    process = start(folder, link, "--duration", "4")
    path = await_release(folder, process, 30_000)
    for _ in range(3):
        process.send_signal(signal.SIGSTOP)
        time.sleep(0.3)
        process.send_signal(signal.SIGCONT)
        time.sleep(0.4)
    last = last_line(process)
    return process.returncode, path, last


@pytest.mark.parametrize("link", ["serial", pytest.param("CAN", marks=pytest.mark.long)])
def test_a_host_stopped_for_300_ms_loses_nothing(link: str, tmp_path: Path, wrong_samples, matrix) -> None:
    attempts = (halted_three_times(tmp_path / str(number), link) for number in range(8))
    # a loaded machine may leave it standing until the device no longer waits
    code, path, last = next(attempt for attempt in attempts if "heard nothing from the host" not in attempt[2])
    assert code == 0, last
    assert sum(info(path).lost.values()) == 0
    assert wrong_samples(path) == 0
    matrix.show("the host stopped for 300 ms, three times", link, last, 0, "every sample")


@pytest.mark.parametrize(("link", "address"), [("serial", "pty"), pytest.param("CAN", "slcan", marks=pytest.mark.long)])
def test_a_disk_that_fills_up(
    link: str, address: str, operate, serve, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong_samples, matrix
) -> None:
    disk = full_disk(monkeypatch, SMALL_DISK)
    done = operate(serve(link=address, clock="realtime"), "--duration", "60")
    assert done.code == 3, done.message
    (path,) = done.runs
    assert not info(path).complete
    assert wrong_samples(path) == 0
    disk.room = sys.maxsize  # the repaired file has further metadata, and may be larger than the recording
    assert recover(path, tmp_path / "saved.mcap") > 500
    assert verify(tmp_path / "saved.mcap").ok
    survives = "every sample until then, in a file to be recovered"
    matrix.show("the disk fills up during the swing", link, done.message, 3, survives)


def test_a_folder_that_cannot_be_written(operate, serve, matrix) -> None:
    done = operate(serve(), out=Path("/proc/runs"))
    assert (done.code, done.runs) == (3, [])
    matrix.show("a folder that cannot be written", "any", done.message, done.code, "no RELEASE sent, no file created")


def test_a_disk_without_room(operate, serve, matrix) -> None:
    done = operate(serve(), "--duration", "1e12")
    assert (done.code, done.runs) == (3, [])
    assert "MB are free" in done.message
    matrix.show("a disk without enough free space", "any", done.message, done.code, "no RELEASE sent, no file created")


@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.parametrize(("number", "link"), by_turns(signal.SIGKILL, signal.SIGINT))
@pytest.mark.parametrize("seed", range(KILLS))
def test_stopped_at_any_instant(seed: int, number: signal.Signals, link: str, tmp_path: Path, wrong_samples) -> None:
    rng = np.random.default_rng([seed, number, len(link)])
    folders = [tmp_path / str(k) for k in range(AT_A_TIME)]
    processes = [start(out, link, "--duration", "0.7", "--repeat", "100", clock="fast") for out in folders]
    for out, process in zip(folders, processes, strict=True):
        await_file(out, process, 0)
    for process, delay in zip(processes, rng.uniform(0, 1.5, AT_A_TIME), strict=True):
        time.sleep(delay)
        process.send_signal(number)
    for out, process in zip(folders, processes, strict=True):
        process.communicate(timeout=400)
        assert process.returncode in (-number, 130, 0)
        assert_what_is_left_is_true(out, wrong_samples)


def assert_what_is_left_is_true(out: Path, wrong_samples) -> None:
    assert {path.suffix for path in out.iterdir()} <= {".mcap", ".sha256"}
    paths = sorted(out.glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns)
    for release, path in enumerate(paths, 1):
        finished = verify(path).ok
        assert finished or path == paths[-1]
        if finished or (path.stat().st_size and _readable(path)):
            assert wrong_samples(path, release=release) == 0


def _readable(path: Path) -> bool:
    """Whether an incomplete file contains a release."""
    from dpr_lab.errors import RunError

    try:
        return info(path).release_tick is not None and info(path).samples > 0
    except RunError:
        return False


def test_a_killed_capture_keeps_all_but_the_last_quarter_second(tmp_path: Path, wrong_samples, matrix) -> None:
    process = start(tmp_path, "serial", "--duration", "60")
    path = await_release(tmp_path, process, 60_000)
    process.kill()
    process.communicate()
    about = info(path)
    assert (about.complete, about.stopped) == (False, "")
    assert about.clock["n"] >= 5
    assert wrong_samples(path) == 0
    assert recover(path, tmp_path / "saved.mcap") == about.samples
    result = verify(path).faults[0]
    matrix.show(
        "SIGKILL, at any instant", "serial, CAN", f"`run verify`: {result}", 137, "every sample except the last 250 ms"
    )
