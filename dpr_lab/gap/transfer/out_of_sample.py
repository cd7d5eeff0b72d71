"""Prediction of recordings that were not fitted, and the reduction of the gap on them."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.effects import without_events
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.gauss_newton import descend
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.cross_validation import folds, left_out_chi2
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.result.saved import Interval
from dpr_lab.gap.screen.recordings import Recordings


@dataclass(frozen=True, slots=True)
class BlockBootstrap:
    """Settings of the bootstrap interval of a reduction."""

    block_s: float = 1.0
    """Duration of neighbouring segments that are drawn together, s, because the residuals of a swing are correlated."""
    fewest: int = 4
    """Minimum number of blocks of segments; shorter recordings have shorter blocks."""
    draws: int = 400
    """Number of bootstrap samples, which determine the ends of a 90 % interval to a twentieth of the width."""


BOOTSTRAP = BlockBootstrap()


def block(problem: Problem) -> int:
    """Return the number of neighbouring segments that count as one independent value."""
    offsets = problem.segments.offsets
    length = float(np.median(problem.t[offsets[1:] - 1] - problem.t[offsets[:-1]]))
    return max(1, round(BOOTSTRAP.block_s / max(length, 1e-9)))


def block_starts(run: Integers, size: int) -> Integers:
    """Return the first segment of each block of at most `size` segments of a run.

    Args:
        run: (segments,) index of the run of each segment; the segments of one run are neighbours
        size: number of segments in a block
    """
    first = np.flatnonzero(np.diff(run, prepend=-1))
    within = np.arange(len(run)) - np.repeat(first, np.diff(first, append=len(run)))
    return np.flatnonzero(within % size == 0)


@dataclass(frozen=True, slots=True)
class OutOfSample:
    """Predictions of recordings by models that were fitted to other recordings.

    Only the initial states are fitted to the predicted recordings.
    """

    names: tuple[str, ...]
    """Names of the runs."""
    run: Integers
    """(segments,) index of the run of each segment."""
    dof: Integers
    """(segments,) number of readings minus the number of values of the initial state."""
    noise_rad: float
    """Standard deviation of the noise of a reading, rad."""
    chi2: Callable[[Hypothesis], Array]
    """Function that returns the (segments,) chi2 of a model."""
    block: int
    """Number of neighbouring segments that count as one independent value."""
    whole_runs: bool = True
    """Whether whole recordings are predicted from others; otherwise quarters of the only recording."""

    @property
    def runs(self) -> list[tuple[str, Flags]]:
        """Name and mask of the segments, for each run."""
        return [(self.names[r], self.run == r) for r in np.unique(self.run)]


def left_out_prediction(recordings: Recordings, problem: Problem) -> OutOfSample:
    """Predict each run from the other runs, or each quarter of a single run from the other quarters."""
    fold = folds(problem)
    predicted = _out_of_sample(recordings, problem, lambda model: left_out_chi2(model.fit, fold))
    return replace(predicted, whole_runs=len(recordings.records) > 1)


def held_out_prediction(recordings: Recordings, bare: Hypothesis) -> OutOfSample:
    """Predict whole recordings that the diagnosis did not fit."""
    problem, initial = recordings.cut(recordings.working_length)
    states = descend(problem, bare.estimate.changed(initial=initial), (), iterations=20).estimate.initial

    @cache
    def chi2(model: Hypothesis) -> Array:
        estimate = model.estimate  # counts that were lost in a fitted run do not affect other runs
        estimate = estimate.changed(initial=states, params=without_events(estimate.params))
        fitted = descend(problem, estimate, (), iterations=20)
        return problem.chi2_by_segment(problem.predict(fitted.estimate))

    return _out_of_sample(recordings, problem, chi2)


def _out_of_sample(recordings: Recordings, problem: Problem, chi2: Callable[[Hypothesis], Array]) -> OutOfSample:
    noise = float(np.mean(problem.weight[problem.read] ** 2) ** -0.5)
    names, dof = tuple(record.run.name for record in recordings.records), problem.evidence_by_segment
    return OutOfSample(names, problem.segments.run, dof, noise, chi2, block(problem))


def reduction(above: Array, uncertainty: float, rng: np.random.Generator, block: int, run: Integers) -> Interval:
    """Return the relative reduction of the gap with a bootstrap interval.

    The interval is -1 to 1 if there is no gap, or if there is only one segment, which shows no scatter. Its lower limit
    allows for a small remainder that the noise hides, even if no sample of the bootstrap has a remainder.

    Args:
        above: (2, segments) chi2 above the noise, before and after the correction
        uncertainty: standard deviation of the sum of this chi2 for noise alone
        rng: source of randomness
        block: number of neighbouring segments that are drawn together
        run: (segments,) run of each segment
    """
    if above.shape[1] == 1 or above[0].sum() <= 0.0:
        return Interval(value=share(above), interval90=(-1.0, 1.0))
    block = max(1, min(block, above.shape[1] // BOOTSTRAP.fewest))
    sums = np.add.reduceat(above, block_starts(run, block), axis=1)
    blocks = sums.shape[1]
    drawn = _shares(sums[:, rng.integers(0, blocks, (BOOTSTRAP.draws, blocks))])
    low, high = np.quantile(drawn, [0.05, 0.95])
    before, after = above.sum(axis=1)
    hidden = share(np.array([[before], [max(after, 0.0) + NORMAL_Q90 * uncertainty]]))
    return Interval(value=share(above), interval90=(min(float(low), hidden), float(high)))


def share(above: Array) -> float:
    """Return the gap reduction 1 - rms after / rms before, at least -1.

    Args:
        above: (2, segments) chi2 above the noise, before and after
    """
    return float(_shares(above))


def _shares(above: Array) -> Array:
    """Return the (...) gap reductions, as `share`, from the (2, ..., segments) chi2 above the noise."""
    before, after = np.maximum(above.sum(axis=-1), 0.0)
    remaining_share = np.sqrt(after / np.where(before > 0, before, 1.0))
    return np.where(before > 0, np.maximum(1 - remaining_share, -1.0), 0.0)
