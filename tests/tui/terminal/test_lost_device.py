"""A device that is lost or stopped: only values that are still known are displayed."""

import os
import signal
from pathlib import Path

import pytest

from tests.tui.terminal_emulator import Terminal, to_ready

CLAIMS = ("the rods are held", "the rods are free", "inside", "latch OPEN", "latch CLOSED")
SIM = "sim://?seed=1"


def drawn_cells(terminal: Terminal) -> int:
    return sum("\u2800" < character <= "\u28ff" for character in "".join(terminal.text().splitlines()[-9:]))


def nothing_is_stated_that_is_not_known(terminal: Terminal) -> None:
    terminal.until(lambda: not any(claim in terminal.text() for claim in CLAIMS))
    assert "UNKNOWN" in terminal.text()
    assert "last seen" in terminal.text()


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_device_killed_in_a_swing_leaves_the_latch_unknown_and_the_trace_in_sight(on_terminal, cable) -> None:
    port = cable()
    terminal = on_terminal(port.url)
    to_ready(terminal)
    terminal.press("r")
    terminal.until_shown("recording, 2")
    port.pull()
    terminal.until_shown("DEVICE LOST")
    terminal.press("\x1b")
    terminal.until(lambda: "OPEN when last seen" in terminal.text())
    nothing_is_stated_that_is_not_known(terminal)
    assert "keep clear" in terminal.text()
    assert "c: connect again" in " ".join(terminal.text().split())
    terminal.until(lambda: drawn_cells(terminal) > 40)  # the trace, once it is drawn in the room that is left
    ages = {line for line in terminal.text().splitlines() if "last seen" in line}
    terminal.until(lambda: {line for line in terminal.text().splitlines() if "last seen" in line} != ages)


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_a_device_killed_in_the_countdown_releases_nothing_and_claims_nothing(on_terminal, cable, tmp_path) -> None:
    port = cable()
    terminal = on_terminal(port.url)
    to_ready(terminal)
    terminal.press("r")
    terminal.until_shown("RELEASING")
    port.pull()
    terminal.until_shown("DEVICE LOST")
    terminal.until(lambda: "CLOSED when last seen" in terminal.text() and "RELEASING" not in terminal.text())
    nothing_is_stated_that_is_not_known(terminal)
    assert list((tmp_path / "bench" / "runs").glob("*.mcap")) == []


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.skipif(not Path("/proc").is_dir(), reason="reads /proc")
def test_a_stopped_recorder_marks_all_values_as_old(on_terminal) -> None:
    terminal = on_terminal(SIM)
    to_ready(terminal)
    recorder = next(pid for pid in children(terminal.process.pid) if b"resource_tracker" not in command(pid))
    os.kill(recorder, signal.SIGSTOP)
    try:
        terminal.until_shown("NO MESSAGE from the device")
        nothing_is_stated_that_is_not_known(terminal)
        terminal.press("r")
        terminal.until_shown("Not released: no message from the device")
    finally:
        os.kill(recorder, signal.SIGCONT)
    terminal.until_shown("latch CLOSED")  # heard again, and nothing was let go meanwhile


def children(parent: int) -> list[int]:
    """Processes that any thread of a process started."""
    return [int(pid) for entry in Path(f"/proc/{parent}/task").glob("*/children") for pid in entry.read_text().split()]


def command(pid: int) -> bytes:
    return Path(f"/proc/{pid}/cmdline").read_bytes()
