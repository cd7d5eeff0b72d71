"""A step of an encoder must be visible in its readings, not only in the residual of a fit."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.gap.damage.steps import ReadingStep, apparent_steps, is_sharp, shows_step, typical_step, visible_steps
from dpr_lab.gap.screen.record import Record
from dpr_lab.rig import Rig
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


def step_at(record: Record, place: int, size: float = SIZE) -> ReadingStep:
    return ReadingStep(gain=100.0, joint=1, run=0, at=float(record.t[place]) - 1e-4, size=size)


def shown(record: Record, place: int, size: float = SIZE) -> bool:
    step = step_at(record, place, size)
    return shows_step(record, step.joint, step.at, step.size)


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


def test_a_step_of_one_count_is_the_resolution_of_the_encoder(record_of, paper: Rig):
    record, count = record_of(1.0), abs(float(paper.radians_per_count[2]))
    place, constants = int(np.searchsorted(record.t, 1.0)), rig_constants(paper)
    assert visible_steps([record], [step_at(record, place, count)], constants) == []
    several = step_at(record, place, 3 * count)
    assert visible_steps([record], [several], constants) == [(1, 0, several.at)]


def test_a_step_is_sharp_if_no_other_instant_shows_one_as_large():
    """A zero that moves irregularly shows apparent steps everywhere."""
    rng, n, place = np.random.default_rng(5), 400, 130
    begins, ends = np.repeat([0, 200], 200), np.repeat([200, 400], 200)
    noise, step = rng.normal(size=n), 10.0 * (np.arange(n) >= place)
    wandering = 2.0 * np.cumsum(rng.normal(size=n))
    of_step, of_zero = (apparent_steps(noise + error, begins, ends) for error in (step, wandering))
    assert of_step[place] == pytest.approx(10.0, abs=6.0)
    assert np.isnan(of_step[[7, 193, 207]]).all()  # a polynomial does not extend from one segment to the next
    assert is_sharp(of_step, place + 2, 10.0, typical_step(of_step))
    assert not is_sharp(of_step, place + 40, 10.0, typical_step(of_step))
    assert not is_sharp(of_zero, place, 10.0, typical_step(of_zero))
    assert not is_sharp(of_zero, 198, 10.0, typical_step(of_zero))
    assert is_sharp(of_zero, 198, 100.0, typical_step(of_zero))


def test_missing_readings_are_no_residual_of_zero():
    begins, ends, place = np.zeros(100, dtype=int), np.full(100, 100), 50
    residual = 10.0 * (np.arange(100) >= place) + 5.0
    residual[[20, 21, 22]] = np.nan
    apparent = apparent_steps(residual, begins, ends)
    assert np.isnan(apparent[15:31]).all()
    assert np.nanmax(np.abs(apparent[31:43])) < 1e-9
    assert apparent[place] == pytest.approx(10.0)
