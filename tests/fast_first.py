"""Distribution of the tests to the worker processes: the fast tests of all files first, then the slow ones."""

from collections.abc import Iterable
from itertools import groupby

from xdist.scheduler import LoadFileScheduling

SCREEN, TERMINAL = "tests/tui/", "tests/tui/terminal/"


def is_of_screen(test: str) -> bool:
    """Whether a test of the screen may start jobs in this process; tests on a terminal start programs instead."""
    return test.startswith(SCREEN) and not test.startswith(TERMINAL)


def place(test: str) -> str:
    """Return the file of a test, or the folder of the screen.

    Each worker that tests the screen has a server of jobs, which takes seconds to load the libraries.
    """
    return SCREEN if is_of_screen(test) else test.partition("::")[0]


def groups(tests: Iterable[str]) -> dict[str, str]:
    """Group of each test: consecutive tests of a place belong together.

    `tests/conftest.py` sorts slow tests behind all fast ones, so a file with both has two groups.
    """
    places = groupby(tests, place)
    return {test: f"{name} {number}" for number, (name, of_place) in enumerate(places) for test in of_place}


class FastFirst(LoadFileScheduling):
    """As `--dist loadfile`, but a worker gets the fast and the slow tests of a place at different times."""

    def _split_scope(self, nodeid: str) -> str:
        if not hasattr(self, "_groups"):
            self._groups = groups(self.collection or ())
        return self._groups[nodeid]
