"""Merge segments as long as the model follows them, to gain information.

Two adjacent segments are merged if the free run of the first segment stays near the readings of the second segment. If
the free run follows only a part of these readings, the border between the segments is shifted to the end of that part.
The new segments (a level) are fitted again. If their residual is larger, they are discarded, and the segments are
merged again with a smaller permitted deviation of the free run from the readings.
"""

from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.segments import segments
from dpr_lab.fitting.cut import MIN_SAMPLES
from dpr_lab.fitting.rods import followed
from dpr_lab.identification.ratio_fit import RatioFit, driving_noise, fit_ratios


@dataclass(frozen=True, slots=True)
class MergeSettings:
    """Settings of segment merging, for clamped and moving arms."""

    ranges_rad: tuple[float, ...] = (0.2, 0.05, 0.0125)
    """Maximum deviations of a free run from the readings for which segments are merged, rad.

    The first value is used until a level fails, then the next one. The fit converges from each of these deviations.
    """
    follows: float = 3.0
    """Maximum reduced chi-square for which segments are lengthened.

    Above this value, longer segments would only amplify the model error.
    """
    worse: float = 1.02
    """Maximum reduced chi-square of a level, divided by the reduced chi-square of the shortest segments.

    A level with a larger ratio is discarded.
    """
    worth_moving: float = 0.1
    """Minimum share of the next segment that a free run must predict for the border between both to be shifted."""
    solver_error: float = 0.2
    """Maximum integration error of a longer segment, relative to the noise."""
    shortest_step: float = 2e-4
    """Shortest Runge-Kutta step, s; a segment that needs a shorter step is not merged."""
    levels: int = 30
    """Maximum number of levels; whole records of 10 s need about five."""
    iterations: int = 100
    """Maximum number of iterations of a fit.

    Over ten chaotic seconds the cost has a curved valley, and steps are short.
    """


SETTINGS = MergeSettings()


@dataclass(frozen=True, slots=True)
class _Piece:
    """A segment of the next level, which starts at the end of the previous segment."""

    run: int
    end: int
    """Index after the last sample of the segment."""
    initial: Array
    step: float


def merge_segments(ratio_fit: RatioFit) -> RatioFit:
    """Fit longer and longer segments as long as the model follows the readings."""
    lost, ranges = SETTINGS.worse * ratio_fit.chi2_per_dof, iter(SETTINGS.ranges_rad)
    tolerance = next(ranges)
    for _ in range(SETTINGS.levels):
        longer = _lengthened(ratio_fit, tolerance) if ratio_fit.chi2_per_dof < SETTINGS.follows else None
        if longer is None:
            break
        trial = _fitted(ratio_fit, longer)
        if trial.fit.converged and trial.chi2_per_dof < lost:
            ratio_fit = trial
        elif (tolerance := next(ranges, 0.0)) == 0.0:
            break
    return ratio_fit


def _fitted(ratio_fit: RatioFit, pieces: list[_Piece]) -> RatioFit:
    layout = replace(
        ratio_fit.problem.segments,
        offsets=np.array([0, *(piece.end for piece in pieces)]),
        run=np.array([piece.run for piece in pieces]),
        step=np.array([piece.step for piece in pieces]),
    )
    start = ratio_fit.fit.estimate.changed(initial=np.array([piece.initial for piece in pieces]))
    problem = replace(ratio_fit.problem, segments=layout)
    if problem.disturbance is not None:
        problem = replace(problem, disturbance=driving_noise(problem, start))
    return fit_ratios(problem, start, iterations=SETTINGS.iterations)


def _lengthened(ratio_fit: RatioFit, tolerance: float) -> list[_Piece] | None:
    """Return the segments of the next level, or None if no segment changes.

    The free run of the first segment of each pair predicts a part of the second segment. The first segment is extended
    by this part.
    """
    run = ratio_fit.problem.segments.run
    pieces: list[_Piece] = []
    index, moved = 0, False
    while index < len(run):
        has_next = index + 1 < len(run) and run[index] == run[index + 1]
        pair = _extended(ratio_fit, index, tolerance) if has_next else None
        pieces += pair or [_piece(ratio_fit, index)]
        index += 2 if pair else 1
        moved |= pair is not None
    return pieces if moved else None


def _piece(ratio_fit: RatioFit, index: int) -> _Piece:
    layout = ratio_fit.problem.segments
    initial, step = ratio_fit.fit.estimate.initial[index], float(layout.step[index])
    return _Piece(int(layout.run[index]), int(layout.offsets[index + 1]), initial, step)


def _extended(ratio_fit: RatioFit, index: int, tolerance: float) -> list[_Piece] | None:
    """Extend a segment as far as its free run predicts the next segment.

    Returns:
        the extended segment and the remaining part of the next segment; None if the predicted part or the remaining
        part is too short
    """
    t, (border, end) = ratio_fit.problem.t, ratio_fit.problem.segments.offsets[index + 1 : index + 3].tolist()
    first, second = _piece(ratio_fit, index), _piece(ratio_fit, index + 1)
    followed = _followed(ratio_fit, index, tolerance)
    if followed == end - border:
        first, remaining = replace(first, end=end, step=min(first.step, second.step)), []
    elif followed >= SETTINGS.worth_moving * (end - border) and end - border - followed >= MIN_SAMPLES:
        begin = border + followed
        states = _states(ratio_fit, index + 1, t[border : begin + 1], second.step)
        first, remaining = replace(first, end=begin), [replace(second, initial=states[-1])]
    else:
        return None
    step = _step_for(ratio_fit, index, first)
    return None if step is None else [replace(first, step=step), *remaining]


def _step_for(ratio_fit: RatioFit, index: int, piece: _Piece) -> float | None:
    """Return the longest integration step, s, whose error is negligible relative to the noise, or None.

    The error is estimated by halving the step.
    """
    samples = slice(int(ratio_fit.problem.segments.offsets[index]), piece.end)
    t, allowed = ratio_fit.problem.t[samples], SETTINGS.solver_error / ratio_fit.problem.weight[samples].max()
    step = min(piece.step, float(np.median(np.diff(t))))
    coarse = _states(ratio_fit, index, t, step)
    while step >= SETTINGS.shortest_step:
        fine = _states(ratio_fit, index, t, step / 2)
        if np.max(np.abs(fine - coarse)[:, :2]) < allowed:
            return step
        step, coarse = step / 2, fine
    return None


def _followed(ratio_fit: RatioFit, index: int, tolerance: float) -> int:
    """Count the samples of the next segment that a free run predicts.

    The prediction error must be within the tolerance, rad.
    """
    begin, border, end = ratio_fit.problem.segments.offsets[index : index + 3]
    layout = ratio_fit.problem.segments
    # known torques are given for each sample, so a driven free run needs all samples
    passed = begin + 1 if layout.setups[layout.run[index]].free else border
    t = np.concatenate([ratio_fit.problem.t[begin:passed], ratio_fit.problem.t[border:end]])
    angles = _states(ratio_fit, index, t, float(layout.step[index]))[passed - begin :, :2]
    zeros = ratio_fit.fit.estimate.zeros[layout.run[index]] if ratio_fit.problem.rezeroed else 0.0
    errors = np.abs(angles - ratio_fit.problem.joints.to_rods(ratio_fit.problem.measured[border:end] - zeros))
    errors = errors[:, : 1 + int(ratio_fit.problem.read[border:end, 1].any())].max(axis=1)
    departed = np.flatnonzero(~(errors < tolerance))
    return int(departed[0]) if len(departed) else len(errors)


def _states(ratio_fit: RatioFit, index: int, t: Array, step: float) -> Array:
    """Return the states (n, 4) of the free run of a segment."""
    rig, layout, estimate = ratio_fit.problem.model.constants, ratio_fit.problem.segments, ratio_fit.fit.estimate
    swing = segments([t], setups=[layout.setups[layout.run[index]]], step=step)
    return followed(estimate.ratios, swing, estimate.initial[index : index + 1], rig)[0]
