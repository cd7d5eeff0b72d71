"""A run of all tests gives the fast tests to the workers first."""

import pytest

from tests.conftest import pytest_collection_modifyitems as sort
from tests.fast_first import groups


def test_fast_and_slow_tests_of_a_file_are_two_groups() -> None:
    first, again, other, slow = groups(["a.py::one", "a.py::two", "b.py::one", "a.py::slow"]).values()
    assert first == again
    assert len({first, other, slow}) == 3


def test_one_worker_gets_the_fast_tests_of_the_screen_and_other_files_stay_apart() -> None:
    names = ("tests/tui/a.py::one", "tests/tui/steps/b.py::one", "tests/tui/terminal/c.py::one", "tests/d.py::one")
    first, second, terminal, other = groups(names).values()
    assert first == second
    assert len({first, terminal, other}) == 3


def test_slow_tests_are_sorted_behind_the_fast_ones(request: pytest.FixtureRequest) -> None:
    here = [result for result in request.session.items if result.path == request.path]
    assert here
    items = [*here, pytest.Function.from_parent(request.node.parent, name="slow", callobj=lambda: None), *here]
    items[len(here)].add_marker(pytest.mark.slow)
    sort(items)
    assert items[-1].name == "slow"
