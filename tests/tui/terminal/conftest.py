"""Fixtures that run the command on a pseudo-terminal with a simulated device."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from tests.tui.terminal_emulator import Terminal

OnTerminal = Callable[..., Terminal]


@pytest.fixture
def on_terminal(tmp_path: Path) -> Iterator[OnTerminal]:
    """(link, option=) -> `dpr-lab tui` with that link, on a terminal with these options, connected at Capture.

    `environment` are more variables of the command.
    """
    made: list[Terminal] = []

    def start(link: str, environment: Mapping[str, str] | None = None, **options: Any) -> Terminal:
        words = ["tui", "--link", link, "--out", str(tmp_path / "bench")]
        made.append(Terminal(words, environment or {}, **options))
        made[-1].until_shown("Connect")
        made[-1].press("c")
        made[-1].until_shown("latch OPEN")
        made[-1].press("3")
        return made[-1]

    yield start
    for terminal in made:
        terminal.close()
