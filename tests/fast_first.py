"""Distribution of the tests to the worker processes: the fast tests of all files first, then the slow ones."""

from collections.abc import Iterable
from itertools import groupby

from xdist.scheduler import LoadFileScheduling


def groups(tests: Iterable[str]) -> dict[str, str]:
    """Group of each test: consecutive tests of a file belong together.

    `tests/conftest.py` sorts slow tests behind all fast ones, so a file with both has two groups.
    """
    files = groupby(tests, lambda test: test.partition("::")[0])
    return {test: f"{file} {number}" for number, (file, of_file) in enumerate(files) for test in of_file}


class FastFirst(LoadFileScheduling):
    """As `--dist loadfile`, but a worker gets the fast and the slow tests of a file at different times."""

    def _split_scope(self, nodeid: str) -> str:
        if not hasattr(self, "_groups"):
            self._groups = groups(self.collection or ())
        return self._groups[nodeid]
