"""End by a signal: within a limited time, with a restored terminal and a closed recording."""

import signal

import pytest

from dpr_lab.storage.inspect import info
from tests.thinned import thinned
from tests.tui.terminal_emulator import to_ready

SIM = "sim://?seed=1"


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(
    "number", thinned((signal.SIGTERM, signal.SIGHUP, signal.SIGINT), 3), ids=lambda number: number.name
)
def test_a_signal_while_recording_closes_the_file_and_restores_the_terminal(on_terminal, tmp_path, number) -> None:
    terminal = on_terminal(SIM)
    to_ready(terminal)
    terminal.press("r")
    terminal.until_shown("REC")
    terminal.process.send_signal(number)
    assert terminal.ended() == 130
    assert terminal.restored
    assert not {b"?1049", b"?1003", b"?1004", b"?2004"} & terminal.modes
    (run,) = (tmp_path / "bench" / "runs").glob("*.mcap")
    assert info(run).stopped
    assert not info(run).complete


@pytest.mark.long
@pytest.mark.timeout(900)
def test_sigterm_ends_the_screen_though_its_terminal_no_longer_takes_anything(on_terminal) -> None:
    # The main thread waited without end for Textual's writer, which waited for the terminal.
    terminal = on_terminal(SIM)
    to_ready(terminal)
    terminal.reading = False
    terminal.press("123456" * 20)  # whole pictures, more than the pty holds
    terminal.process.terminate()
    assert terminal.ended() == 130
    assert terminal.restored


@pytest.mark.long
@pytest.mark.timeout(900)
def test_a_terminal_that_hangs_up_ends_the_screen(on_terminal) -> None:
    terminal = on_terminal(SIM)
    to_ready(terminal)
    terminal.hang_up()
    terminal.ended()
