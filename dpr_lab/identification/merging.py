"""Merge segments as far as the model follows: longer ones carry more information.

Neighbours are merged where the first one's free run stays near the second's readings; where it follows only a part, the
border between them moves by that part. The new set is fitted again. A level whose residual rises is thrown away and
tried again in smaller steps: the first one's free run must then stay nearer.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.segments import segments
from dpr_lab.fitting.cut import MIN_SAMPLES
from dpr_lab.fitting.rods import followed
from dpr_lab.identification.ratio_fit import RatioFit, driving_noise, fit_ratios

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MergeSettings:
    """How boldly segments are merged."""

    ranges_rad: tuple[float, ...] = (0.2, 0.05, 0.0125)
    """A free run may stray so far from the readings, where the fit still finds back; the next where it was lost."""
    follows: float = 3.0
    """Reduced chi-square above which longer segments would only amplify what the model misses."""
    worse: float = 1.02
    """A level whose reduced chi-square rises by this factor over the shortest segments' is lost."""
    worth_moving: float = 0.1
    """Share of its neighbour that a segment must follow for the border between them to move."""
    solver_error: float = 0.2
    """Of the noise: what the integrator may add to a longer segment."""
    shortest_step: float = 2e-4
    """Shortest Runge-Kutta step tried, s: a segment that needs a shorter one is not merged."""
    levels: int = 30
    """Rounds at most; whole records of 10 s take about five."""
    iterations: int = 100
    """Of a fit: over ten chaotic seconds the valley is curved and the steps are short."""


SETTINGS = MergeSettings()


@dataclass(frozen=True, slots=True)
class _Piece:
    """A segment of the next level; it begins where the one before it ends."""

    run: int
    end: int
    """Sample after its last."""
    initial: Array
    step: float


def merge_segments(found: RatioFit) -> RatioFit:
    """Fit ever longer segments while the model still follows."""
    lost, ranges = SETTINGS.worse * found.chi2_per_dof, iter(SETTINGS.ranges_rad)
    near = next(ranges)
    for _ in range(SETTINGS.levels):
        longer = _lengthened(found, near) if found.chi2_per_dof < SETTINGS.follows else None
        if longer is None:
            break
        trial = _fitted(found, longer)
        if trial.fit.converged and trial.chi2_per_dof < lost:
            found = trial
        elif (near := next(ranges, 0.0)) == 0.0:
            break
    return found


def _fitted(found: RatioFit, pieces: list[_Piece]) -> RatioFit:
    laid_out = replace(
        found.problem.segments,
        offsets=np.array([0, *(piece.end for piece in pieces)]),
        run=np.array([piece.run for piece in pieces]),
        step=np.array([piece.step for piece in pieces]),
    )
    start = found.fit.estimate.changed(initial=np.array([piece.initial for piece in pieces]))
    problem = replace(found.problem, segments=laid_out)
    if problem.disturbance is not None:
        problem = replace(problem, disturbance=driving_noise(problem, start))
    return fit_ratios(problem, start, iterations=SETTINGS.iterations)


def _lengthened(found: RatioFit, near: float) -> list[_Piece] | None:
    """The segments after every first of a pair took what it follows of the second; None when nothing moved."""
    run = found.problem.segments.run
    pieces: list[_Piece] = []
    index, moved = 0, False
    while index < len(run):
        has_next = index + 1 < len(run) and run[index] == run[index + 1]
        pair = _taking(found, index, near) if has_next else None
        pieces += pair or [_piece(found, index)]
        index += 2 if pair else 1
        moved |= pair is not None
    return pieces if moved else None


def _piece(found: RatioFit, index: int) -> _Piece:
    laid_out = found.problem.segments
    initial, step = found.fit.estimate.initial[index], float(laid_out.step[index])
    return _Piece(int(laid_out.run[index]), int(laid_out.offsets[index + 1]), initial, step)


def _taking(found: RatioFit, index: int, near: float) -> list[_Piece] | None:
    """A segment with what it follows of the next, and what is left of that; None when that is too little."""
    t, (border, end) = found.problem.t, found.problem.segments.offsets[index + 1 : index + 3].tolist()
    first, second = _piece(found, index), _piece(found, index + 1)
    taken = _followed(found, index, near)
    if taken == end - border:
        first, rest = replace(first, end=end, step=min(first.step, second.step)), []
    elif taken >= SETTINGS.worth_moving * (end - border) and end - border - taken >= MIN_SAMPLES:
        begin = border + taken
        states = _states(found, index + 1, t[border : begin + 1], second.step)
        first, rest = replace(first, end=begin), [replace(second, initial=states[-1])]
    else:
        return None
    step = _step_for(found, index, first)
    return None if step is None else [replace(first, step=step), *rest]


def _step_for(found: RatioFit, index: int, piece: _Piece) -> float | None:
    """The longest step whose error stays below the noise, seen by halving it; None where chaos lets none do."""
    own = slice(int(found.problem.segments.offsets[index]), piece.end)
    t, allowed = found.problem.t[own], SETTINGS.solver_error / found.problem.weight[own].max()
    step = min(piece.step, float(np.median(np.diff(t))))
    coarse = _states(found, index, t, step)
    while step >= SETTINGS.shortest_step:
        fine = _states(found, index, t, step / 2)
        if np.max(np.abs(fine - coarse)[:, :2]) < allowed:
            return step
        step, coarse = step / 2, fine
    return None


def _followed(found: RatioFit, index: int, near: float) -> int:
    """How many samples of the next segment a segment's free run follows."""
    begin, border, end = found.problem.segments.offsets[index : index + 3]
    laid_out = found.problem.segments
    passed = begin + 1 if laid_out.setups[laid_out.run[index]].free else border  # what drives is looked up by sample
    t = np.concatenate([found.problem.t[begin:passed], found.problem.t[border:end]])
    angles = _states(found, index, t, float(laid_out.step[index]))[passed - begin :, :2]
    zeros = found.fit.estimate.zeros[laid_out.run[index]] if found.problem.rezeroed else 0.0
    off = np.abs(angles - found.problem.joints.to_rods(found.problem.measured[border:end] - zeros))
    off = off[:, : 1 + int(found.problem.read[border:end, 1].any())].max(axis=1)
    strayed = np.flatnonzero(~(off < near))
    return int(strayed[0]) if len(strayed) else len(off)


def _states(found: RatioFit, index: int, t: Array, step: float) -> Array:
    """(n, 4) the free run of a segment."""
    rig, laid_out, at = found.problem.model.constants, found.problem.segments, found.fit.estimate
    own = segments([t], setups=[laid_out.setups[laid_out.run[index]]], step=step)
    return followed(at.ratios, own, at.initial[index : index + 1], rig)[0]
