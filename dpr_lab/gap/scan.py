"""Shapes worth a closer look: orders and frequencies of torques, and instants at which a reading may have stepped.

Hundreds of shapes are compared on one linearised fit; the best few go on to the score test and to nonlinear fits.
"""

from itertools import product

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import SLICES, effect_vector, place
from dpr_lab.effects.effect import Effect
from dpr_lab.gap.along import ALONG
from dpr_lab.gap.problem import CONTINUOUS, Problem
from dpr_lab.gap.response import Course
from dpr_lab.gap.shooting import Fit

Array = NDArray[np.float64]
Shape = tuple[tuple[int, float], ...]
"""Entries of the effect vector that say how, not how much."""

MANY = 24
"""Shapes above which an effect is scanned along the swing before the score test."""
KEPT = 2
NEIGHBOURS = 0.1  # relative difference of frequencies or orders up to which two shapes are taken for one
FINER = 13
BLOCK = 64  # columns at a time, to stay within the cache
STEPS_KEPT = 3


def shapes(effect: Effect, problem: Problem, fit: Fit, along: Course) -> list[Shape]:
    """The shapes of an effect to put to the score test; none for an arm that was seen to stand still."""
    if effect.name == "arm_compliance" and all(item.arm_moves is False for item in problem.records):
        return []
    if effect.name == "missed_counts":
        return step_shapes(problem, fit)
    grid = [[(place(effect.name, p.name), value) for value in p.scan] for p in effect.shapes if p.scan]
    every = [tuple(choice) for choice in product(*grid)]
    if len(every) <= MANY or effect.stage not in ALONG:
        return every
    return _between(effect, _apart(every, _gains(effect, every, problem, fit, along)), problem, fit, along)


def _apart(every: list[Shape], gains: Array) -> list[Shape]:
    """The best shapes, none a neighbour of a better one."""
    kept: list[Shape] = []
    for i in np.argsort(-gains):
        first = every[i][0][1]
        if all(abs(np.log(first / other[0][1])) > NEIGHBOURS for other in kept):
            kept.append(every[i])
        if len(kept) == KEPT:
            break
    return kept


def _between(effect: Effect, kept: list[Shape], problem: Problem, fit: Fit, along: Course) -> list[Shape]:
    """The best shapes between those of the grid, where the shape varies continuously.

    The peak of a frequency is as narrow as the record is long, far narrower than a nonlinear fit can find.
    """
    shape = effect.shapes[0]
    if len(effect.shapes) > 1 or shape.name not in CONTINUOUS:
        return kept
    ratio = shape.scan[1] / shape.scan[0]
    finer = [((at, value * ratio**share),) for ((at, value),) in kept for share in np.linspace(-0.75, 0.75, FINER)]
    gains = _gains(effect, finer, problem, fit, along)
    return [finer[i] for i in np.argsort(-gains)[:KEPT]]


def _gains(effect: Effect, every: list[Shape], problem: Problem, fit: Fit, along: Course) -> Array:
    """(shapes,) fall of chi2 that the two leading amplitudes promise, start states and fitted slots projected out."""
    amplitudes = [place(effect.name, p.name) for p in effect.amplitudes[:2]]
    one_signed = [p.sign == "positive" for p in effect.amplitudes] == [True]
    e, A = fit.linear.e, fit.linear.A
    known = A.reshape(-1, A.shape[2])
    known = np.linalg.qr(known / np.maximum(np.linalg.norm(known, axis=0), 1e-300))[0]
    gains = np.zeros(len(every))
    block = BLOCK // len(amplitudes)
    for first in range(0, len(every), block):
        chosen = every[first : first + block]
        vectors = np.array([_unit(effect, at, shape) for shape in chosen for at in amplitudes])
        readings = along.readings(ALONG[effect.stage](problem, along, vectors))
        columns = fit.linear.projected(problem.whitened(readings))
        flat = columns.reshape(-1, columns.shape[2])
        onto = known.T @ flat
        G, b = flat.T @ flat - onto.T @ onto, flat.T @ e.ravel() - onto.T @ (known.T @ e.ravel())
        for i in range(len(chosen)):
            mine = slice(i * len(amplitudes), (i + 1) * len(amplitudes))
            if not (one_signed and b[mine] < 0):
                gains[first + i] = float(b[mine] @ np.linalg.lstsq(G[mine, mine], b[mine], rcond=1e-9)[0])
    return gains


def _unit(effect: Effect, at: int, shape: Shape) -> Array:
    vector = effect_vector({})
    vector[at] = effect.parameters[at - SLICES[effect.name].start].typical
    for index, value in shape:
        vector[index] = value
    return vector


def step_shapes(problem: Problem, fit: Fit) -> list[Shape]:
    """Joint, run and instant of the steps that the residual speaks for most, the screened ones first."""
    screened = [(axis, run, at) for run, item in enumerate(problem.records) for at, axis in item.screened.breaks]
    found = screened or [(axis, run, at) for _, axis, run, at in _step_gains(problem, fit)[:STEPS_KEPT]]
    return [
        (
            (place("missed_counts", "joint"), 1.0 + axis),
            (place("missed_counts", "run"), float(run)),
            (place("missed_counts", "time_s"), at),
        )
        for axis, run, at in found
    ]


def _step_gains(problem: Problem, fit: Fit) -> list[tuple[float, int, int, float]]:
    """Gain, axis, run and instant of a step at the best sample of each segment, by cumulative sums from its end.

    A segment wholly after the step sees a constant, which its start state nearly absorbs; the exact offset is left to
    the nonlinear fit.
    """
    found = []
    for s, (first, last) in enumerate(zip(problem.offsets[:-1], problem.offsets[1:], strict=True)):
        count = last - first
        for axis in range(2):
            rows = 2 * np.arange(count) + axis
            weight = problem.weight[first:last, axis]
            e, Q = fit.linear.e[s, rows], fit.linear.Q[s, rows]
            inner = np.cumsum((e * weight)[::-1])[::-1]
            onto = np.cumsum((Q * weight[:, None])[::-1], axis=0)[::-1]
            norm = np.cumsum((weight**2)[::-1])[::-1] - np.sum(onto**2, axis=1)
            gain = np.where(norm > 1e-6 * weight.sum() ** 2 / count, inner**2 / np.maximum(norm, 1e-300), 0.0)
            best = int(np.argmax(gain[1:])) + 1
            found.append((float(gain[best]), axis, int(problem.run[s]), float(problem.t[first + best] - 1e-4)))
    return sorted(found, reverse=True)
