"""Lengthen segments as far as the model follows, and say how far a free run can be predicted."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import base_from_ratios
from dpr_lab.dynamics.sensitivity import swing_sensitivity
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.estimation.least_squares import Conditions, SegmentFit, fit_segments
from dpr_lab.estimation.segments import MIN_SAMPLES, Segment, join, split

LINEAR_RANGES = (
    0.2,
    0.05,
    0.0125,
)  # a free run may stray so far from the measurement, rad; the next where the fit is lost
FOLLOWS = 3.0  # reduced chi-square above which longer segments would only amplify what the model misses
WORSE = 1.02  # a level whose reduced chi-square rises by this factor over the shortest segments' is lost
WORTH_MOVING = 0.1  # share of its neighbour that a segment must follow for the border between them to move
SOLVER_ERROR = 0.2  # of the noise: what the integrator may add to a longer segment
SHORTEST_STEP = 2e-4  # s
MAX_LEVELS = 30
MAX_ITERATIONS = 100  # over ten chaotic seconds the valley is curved and the steps are short

HORIZON_ERROR = 0.1
"""Angle error that ends the predictability horizon, rad."""


def grow(fit: SegmentFit, known: Conditions) -> SegmentFit:
    """Lengthen the segments while the model still follows: longer segments carry more information.

    Neighbours are joined where the first one's free run stays near the second's measurement; where it follows only a
    part, the border between them moves by that part. The new set is fitted again. A level whose residual rises is
    thrown away and tried again in smaller steps: the first one's free run must then stay nearer.
    """
    lost, ranges = WORSE * fit.chi2_per_dof, iter(LINEAR_RANGES)
    near = next(ranges)
    for _ in range(MAX_LEVELS):
        longer = _lengthened(fit, known, near) if fit.chi2_per_dof < FOLLOWS else None
        if longer is None:
            break
        trial = fit_segments(fit.unknowns, longer, known, max_iterations=MAX_ITERATIONS)
        if trial.converged and trial.chi2_per_dof < lost:
            fit = trial
        elif (near := next(ranges, 0.0)) == 0.0:
            break
    return fit


def _lengthened(fit: SegmentFit, known: Conditions, near: float) -> list[Segment] | None:
    """The segments after every first of a pair took what it follows of the second; None when nothing moved."""
    queue, done, moved = list(fit.segments), [], False
    while queue:
        first = queue.pop(0)
        if queue and queue[0].run == first.run and (pair := _taking(fit, first, queue[0], known, near)):
            moved = True
            done.append(pair[0])
            queue[0:1] = []
            done += pair[1:]
        else:
            done.append(first)
    return done if moved else None


def _taking(fit: SegmentFit, first: Segment, second: Segment, known: Conditions, near: float) -> list[Segment] | None:
    """The first segment with what it follows of the second, and what is left of that; None when that is too little."""
    taken = _followed(fit, first, second, known, near)
    if taken == len(second.t):
        pair = [join(first, second)]
    elif taken >= WORTH_MOVING * len(second.t) and len(second.t) - taken >= MIN_SAMPLES:
        head, rest = split(second, taken, _states(fit, second, second.t[: taken + 1], known)[-1])
        pair = [join(first, head), rest]
    else:
        return None
    step = _step_for(fit, pair[0], known)
    return None if step is None else [replace(pair[0], max_step=step), *pair[1:]]


def _step_for(fit: SegmentFit, segment: Segment, known: Conditions) -> float | None:
    """The longest step whose error stays below the noise, seen by halving it; None where chaos lets none do."""
    noise = 1.0 / np.abs(known.whitening[segment.run]).max()
    step = min(segment.max_step, float(np.median(np.diff(segment.t))))
    coarse = _states(fit, replace(segment, max_step=step), segment.t, known)
    while step >= SHORTEST_STEP:
        fine = _states(fit, replace(segment, max_step=step / 2), segment.t, known)
        if np.max(np.abs(fine - coarse)[:, :2]) < SOLVER_ERROR * noise:
            return step
        step, coarse = step / 2, fine
    return None


def _followed(fit: SegmentFit, first: Segment, second: Segment, known: Conditions, near: float) -> int:
    """How many samples of the second segment the first one's free run follows."""
    t = np.concatenate([first.t[:1], second.t])
    off = np.abs(_states(fit, first, t, known)[1:, :2] - second.theta).max(axis=1)
    strayed = np.flatnonzero(~(off < near))
    return int(strayed[0]) if len(strayed) else len(off)


def _states(fit: SegmentFit, segment: Segment, t: NDArray[np.float64], known: Conditions) -> NDArray[np.float64]:
    ratios, _ = known.ratios(fit.unknowns, segment.run)
    return simulate(base_from_ratios(ratios), known.L1, known.g, segment.start, t, segment.max_step)


def free_run(
    fit: SegmentFit, index: int, t: NDArray[np.float64], known: Conditions
) -> tuple[NDArray[np.float64], float]:
    """A swing simulated from a segment's fitted start state, and how far it means anything.

    The horizon is where the start state's uncertainty alone, carried along by the variational equation, moves an
    angle by `HORIZON_ERROR`.

    Args:
        fit: gives unknowns and start state
        index: the segment to start from
        t: (n,) instants, the first of them the segment's own
        known: as in the fit

    Returns:
        (n, 2) theta1, theta2, rad, and the horizon on the clock of `t`, s
    """
    ratios, _ = known.ratios(fit.unknowns, fit.segments[index].run)
    states, slopes = swing_sensitivity(ratios, known.L1, known.g, fit.segments[index].start, t)
    growth = slopes[:, :2, 5:]
    variance = np.einsum("nij,jk,nik->ni", growth, fit.start_covariances[index], growth) * max(1.0, fit.chi2_per_dof)
    lost = np.flatnonzero(~(variance.max(axis=1) < HORIZON_ERROR**2))
    return states[:, :2], float(t[lost[0]] if len(lost) else t[-1])
