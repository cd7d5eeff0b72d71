"""No rod is released before the terminal has confirmed the countdown: real, slow and silent pseudo-terminals."""

import re
import time
from pathlib import Path

import pytest

from dpr_lab.tui.terminal.sight import SIGHT
from tests.tui.terminal_emulator import Terminal, to_ready

SIM = "sim://?seed=1"
CONSOLE = 11520.0
"""Rate of a line with 115200 baud, bytes/s."""


def first_shown(terminal: Terminal, text: str) -> float:
    return next(at for at, screen in terminal.shown if text in screen)


@pytest.mark.long
@pytest.mark.timeout(900)
def test_on_a_serial_console_the_countdown_is_seen_in_full_before_the_latch_opens(on_terminal) -> None:
    # The latch opened six seconds before the countdown was visible: frames piled up in front of the line.
    terminal = on_terminal(SIM, bytes_per_s=CONSOLE)
    to_ready(terminal)
    terminal.press("r")
    terminal.until(lambda: "latch OPEN" in terminal.text() or "Not released" in terminal.text())
    assert "Not released" not in terminal.text()
    assert first_shown(terminal, "REC") - first_shown(terminal, "RELEASING") >= 2.5
    numbers = [screen for _, screen in terminal.shown if "RELEASING" in screen]
    assert len(set(numbers)) >= 3  # three, two, one


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_recording_leaves_bandwidth_on_a_serial_console(on_terminal) -> None:
    terminal = on_terminal(SIM)
    to_ready(terminal)
    terminal.press("r")
    terminal.until_shown("REC")
    time.sleep(1.0)  # the step from countdown to swing is one whole picture
    before, started = terminal.received, time.monotonic()
    time.sleep(5.0)
    assert "REC" in terminal.text()
    assert (terminal.received - before) / (time.monotonic() - started) < 10_000


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    ("options", "why"),
    [
        ({"answers": False}, "did not confirm the countdown within 10 s"),
        pytest.param({"bytes_per_s": 300.0}, "terminal", marks=pytest.mark.long),
    ],
    ids=["a terminal that does not answer", "a line that is too slow"],
)
def test_where_the_countdown_is_not_seen_in_time_the_release_is_refused(
    on_terminal, tmp_path: Path, options: dict[str, object], why: str
) -> None:
    terminal = on_terminal(SIM)
    to_ready(terminal)
    for name, value in options.items():
        setattr(terminal, name, value)
    terminal.press("r")
    time.sleep(SIGHT.patience_s + 2.0)  # so long nothing is confirmed in time
    terminal.bytes_per_s = None  # the rest is to read why
    terminal.until(lambda: why in " ".join(re.findall(r"[\w.]+", terminal.text())))
    terminal.until_shown("latch CLOSED")
    assert list((tmp_path / "bench" / "runs").glob("*.mcap")) == []
