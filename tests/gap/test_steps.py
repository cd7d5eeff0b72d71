"""A step of an encoder must be visible in its readings, not only in the residual of a fit."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dpr_lab.gap.damage.steps import shows_step
from dpr_lab.gap.screen.record import Record
from dpr_lab.run import Run

SIZE = 3e-3
"""A few counts, rad."""


@pytest.fixture
def record_of(recorded: Callable[..., list[Run]], screened: Callable[..., Any]) -> Callable[..., Record]:
    """A recording in which encoder 2 steps at an instant, s."""

    def made(at: float, size: float = SIZE) -> Record:
        one = screened(recorded({}, duration=2.0)).records[0]
        one.joints[one.t >= at, 1] += size
        return one

    return made


def shown(record: Record, place: int, size: float = SIZE) -> bool:
    return shows_step(record, 1, float(record.t[place]) - 1e-4, size)


def test_a_step_of_the_readings_is_seen_also_some_readings_from_where_the_residual_puts_it(record_of):
    record = record_of(1.0)
    place = int(np.searchsorted(record.t, 1.0))
    assert all(shown(record, place + shift) for shift in (-2, 0, 3))
    assert not shown(record, place, 4 * SIZE)


def test_a_zero_that_differs_or_a_step_of_the_residual_alone_is_no_step(record_of):
    record = record_of(-1.0)  # another zero during the whole recording
    assert not any(shown(record, place) for place in (3, 60, 200, len(record.t) - 4))


def test_a_small_step_must_be_seen_in_the_readings_not_only_be_possible(record_of):
    record = record_of(-1.0)
    size = 8.0 * float(np.median(record.sigma[:, 1]))  # one that three standard errors of the readings do not exclude
    places = range(40, len(record.t) - 40, 40)
    seen = [shown(record, place, sign * size) for place in places for sign in (1.0, -1.0)]
    assert np.mean(seen) < 0.2
    for place in places[::8]:
        stepped = record_of(float(record.t[place]), size)
        assert shown(stepped, place, size)
