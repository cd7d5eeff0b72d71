"""Release command of `capture` on a terminal: only an empty line after the question releases the rods."""

import os
import pty
import sys
import time
from collections.abc import Callable, Iterator

import pytest

from dpr_lab.cli.capture import release_question


@pytest.fixture
def typed(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[bytes], None]]:
    """Fixture (bytes) that types these bytes on the terminal of this process."""
    keyboard, terminal = pty.openpty()
    with os.fdopen(terminal, "r", buffering=1) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield lambda keys: (os.write(keyboard, keys), time.sleep(0.1))[1]
    os.close(keyboard)


def test_lines_that_were_typed_before_the_question_release_nothing(typed: Callable[[bytes], None]) -> None:
    confirm = release_question(ask=True)
    typed(b"\n\n")
    assert confirm() is None
    assert confirm() is None
    typed(b"\n")
    assert confirm() is True


def test_another_line_than_an_empty_one_releases_nothing(typed: Callable[[bytes], None]) -> None:
    confirm = release_question(ask=True)
    assert confirm() is None
    typed(b"no\n")
    assert confirm() is None
    assert confirm() is None
    typed(b"\n")
    assert confirm() is True


def test_the_end_of_the_input_is_no_permission(typed: Callable[[bytes], None]) -> None:
    confirm = release_question(ask=True)
    assert confirm() is None
    typed(b"\x04")
    assert confirm() is False
