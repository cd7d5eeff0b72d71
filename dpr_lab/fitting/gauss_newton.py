"""Damped Gauss-Newton with bounds: free parameters and the initial states of all segments.

    minimise  sum over segments s, samples k  | w_sk (y_sk - predicted(t_sk; p, x_s)) |^2

Each step solves the projected normal equations of `dpr_lab.fitting.linearise`; the initial states follow. A step that
does not lower the cost is shortened, and a segment that alone gets worse takes less of its own share: one swing that
passes near the upright would otherwise hold back all others. Where no length helps, damping grows; a step that promises
no more than what ends the iteration is tried once. Where a step falls as its slopes promised, they are kept for the
next.

A fit without free parameters moves initial states alone, as for a run that is held out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.fitting.estimate import Estimate, FreeParameter, moved
from dpr_lab.fitting.linearise import Linearisation, linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class GaussNewton:
    """When to stop, and how to shorten steps."""

    converged: float = 1e-4
    """Relative fall of the cost in a whole step that ends the iteration: a small part of what noise leaves of it."""
    straight: float = 0.1
    """Relative difference of a step's fall from what it promised up to which its slopes are kept for the next one."""
    settled: float = 3e-6
    """Relative fall that ends the iteration where slopes were kept, if less: what then is left falls step by step."""
    grown: float = 0.2
    """Relative change of an amplitude from which the slopes of its effect's shape are made anew at the end."""
    tries: int = 6
    """Lengths of a step before it counts as failed: of 1817 steps of 15 diagnoses three were found beyond."""
    shorter: float = 0.3
    """Factor of a step that did not lower the cost."""
    shorter_segment: float = 0.1
    """Factor of the initial step of a segment that got worse alone."""
    least_damping: float = 1e-9
    """Of unit columns, to begin with."""
    damping_fallen: float = 0.1
    """Factor after a step that helped."""
    damping_raised: float = 1e3
    """Factor after one that failed."""
    most_damping: float = 0.1
    """Damping beyond which a step of no length helps: the estimate stays."""


SETTINGS = GaussNewton()


@dataclass(frozen=True, slots=True)
class Fit:
    """Where the iteration ended."""

    estimate: Estimate
    free: tuple[FreeParameter, ...]
    linear: Linearisation
    converged: bool
    iterations: int = 0

    @property
    def chi2(self) -> float:
        """Sum of squared whitened residuals."""
        return self.linear.chi2

    @property
    def values(self) -> Array:
        """(free,) fitted values."""
        return np.array([parameter.read(self.estimate) for parameter in self.free])

    @property
    def inside(self) -> list[int]:
        """Places of the free parameters that are not held at their bounds."""
        return [i for i, parameter in enumerate(self.free) if parameter.read(self.estimate) > parameter.lower]


@dataclass(frozen=True, slots=True)
class Descent:
    """Where an iteration ended, not yet linearised there."""

    estimate: Estimate
    predicted: Array | None
    """(samples, 2) the readings there; none where the last step failed, or none was taken."""
    chi2: float
    linear: Linearisation
    """By which the last step was made."""
    sloped: Estimate
    """Where its slopes were made."""
    converged: bool
    iterations: int


def fit(
    problem: Problem,
    start: Estimate,
    free: Sequence[FreeParameter],
    *,
    iterations: int = 12,
    first: Linearisation | None = None,
    predicted: Array | None = None,
    settings: GaussNewton = SETTINGS,
) -> Fit:
    """Fit the free parameters and all initial states.

    Args:
        problem: what was measured
        start: to start from; what is not free stays as it is
        free: the unknowns besides the initial states
        iterations: at most
        first: the problem linearised at `start` where that is known already
        predicted: the readings at `start`, (samples, 2), where only those are known
        settings: when to stop
    """
    free = problem.all_free(free)
    end = descend(problem, start, free, iterations=iterations, first=first, predicted=predicted, settings=settings)
    linear, alike = end.linear, end.converged and not _grown(end.sloped, end.estimate, free, settings)
    if end.predicted is not None or not (alike or end.sloped is end.estimate):
        same = linear.carried(problem, end.predicted) if alike and end.predicted is not None else None
        linear = same or linearise(problem, end.estimate, free, end.predicted)
    return Fit(end.estimate, free, linear, end.converged, end.iterations)


def _grown(before: Estimate, after: Estimate, free: Sequence[FreeParameter], settings: GaussNewton) -> bool:
    """Whether an amplitude has changed so far that the slopes of its shape, in proportion to it, have too."""
    shaped = {parameter.effect for parameter in free if not parameter.amplitude}
    pairs = [(p.read(before), p.read(after)) for p in free if p.amplitude and p.effect in shaped]
    return any(abs(new - old) > settings.grown * abs(old) for old, new in pairs)


def descend(
    problem: Problem,
    start: Estimate,
    free: Sequence[FreeParameter],
    *,
    iterations: int,
    first: Linearisation | None = None,
    predicted: Array | None = None,
    settings: GaussNewton = SETTINGS,
) -> Descent:
    """The iteration of `fit` alone, for where it leads: arguments as there."""
    at, free, read = problem.begun(start), problem.all_free(free), predicted
    linear, sloped, predicted = first or linearise(problem, at, free, read), at, None
    chi2, damping, done = linear.chi2, settings.least_damping, 0
    converged, straight = False, False
    while done < iterations and not converged:
        done += 1
        if predicted is not None:
            same = linear.carried(problem, predicted) if straight else None
            linear, sloped = (same, sloped) if same else (linearise(problem, at, free, predicted), at)
            read, predicted = predicted, None
        kept = sloped is not at
        step = _step(linear, at, free, damping)
        promise = chi2 - linear.left(step)
        enough = (min(settings.settled, settings.converged) if kept else settings.converged) * chi2
        promising = not (np.isfinite(chi2) and promise <= enough)
        found = _search(problem, at, free, step, linear, settings, settings.tries if promising else 1)
        if found is None and kept and promising:
            linear, sloped = linearise(problem, at, free, read), at
            continue
        if found is None:
            damping *= settings.damping_raised
            converged = not promising or damping > settings.most_damping
            continue
        at, predicted, after = found
        converged = chi2 - after <= enough
        straight = abs(chi2 - after - promise) <= settings.straight * promise
        chi2 = after
        damping = max(damping * settings.damping_fallen, settings.least_damping)
    return Descent(at, predicted, chi2, linear, sloped, converged, done)


def _step(linear: Linearisation, at: Estimate, free: tuple[FreeParameter, ...], damping: float) -> Array:
    if not free:
        return np.zeros(0)
    lower = np.array([parameter.lower - parameter.read(at) for parameter in free])
    return ColumnSpace.of(*linear.flat).solution(lower, damping)


def _search(
    problem: Problem,
    at: Estimate,
    free: tuple[FreeParameter, ...],
    step: Array,
    linear: Linearisation,
    settings: GaussNewton,
    tries: int,
) -> tuple[Estimate, Array, float] | None:
    """The first estimate along the step that lowers the cost, its readings and its cost; none in so many tries."""
    before = linear.chi2_by_segment
    followed = np.isfinite(before)
    if not followed.any():
        return None
    initial_steps = linear.initial_steps(step)
    share, own = 1.0, np.ones(len(before))
    for attempt in range(tries):
        trial = moved(at, free, share * step, (share * own)[:, None] * initial_steps)
        predicted = problem.predict(trial)
        after = problem.chi2_by_segment(predicted)
        if after[followed].sum() <= before[followed].sum():
            return trial, predicted, float(after.sum())
        worse = ~(after <= before)
        if attempt % 2 or worse.mean() > 0.5:
            share *= settings.shorter
        else:
            own[worse] *= settings.shorter_segment
    return None
