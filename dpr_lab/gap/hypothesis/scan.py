"""Shapes worth a closer look: orders and frequencies of torques, and instants at which a reading may have stepped.

Hundreds of shapes are compared on one linearised fit; the best few go on to the score test and to nonlinear fits.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.trajectory import TRAJECTORY_TORQUES
from dpr_lab.effects import SLICES, effect_params, param_index, proposed_shapes
from dpr_lab.effects.effect import Effect, Recorded, Shape
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.fitting.response import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ScanSettings:
    """Settings of the scan over shapes."""

    many: int = 24
    """Shapes above which an effect is scanned along the swing before the score test."""
    kept: int = 2
    """Shapes that go on: the best, and one that is no neighbour of it."""
    neighbours: float = 0.1
    """Relative difference of frequencies or orders up to which two shapes are taken for one."""
    finer: int = 13
    """Shapes tried between those of the grid: its peak is as narrow as the record is long."""
    reach: float = 0.75
    """How far on either side, in steps of the grid."""
    block: int = 32
    """Columns at a time, to stay within the cache."""
    amplitudes: int = 2
    """Leading amplitudes of an effect that a scan fits."""


SCAN = ScanSettings()


def shapes(effect: Effect, problem: Problem, fit: Fit, along: Trajectory, recorded: Recorded) -> list[Shape]:
    """The shapes of an effect to put to the score test."""
    proposed = proposed_shapes(effect, recorded)
    if proposed is not None:
        return proposed
    grid = [[(param_index(effect.name, p.name), value) for value in p.scan] for p in effect.shapes if p.scan]
    every = [tuple(choice) for choice in product(*grid)]
    if len(every) <= SCAN.many or effect.stage not in TRAJECTORY_TORQUES:
        return every
    return _between(effect, _apart(every, _gains(effect, every, problem, fit, along)), problem, fit, along)


def _apart(every: list[Shape], gains: Array) -> list[Shape]:
    """The best shapes, none a neighbour of a better one."""
    kept: list[Shape] = []
    for i in np.argsort(-gains):
        first = every[i][0][1]
        if all(abs(np.log(first / other[0][1])) > SCAN.neighbours for other in kept):
            kept.append(every[i])
        if len(kept) == SCAN.kept:
            break
    return kept


def _between(effect: Effect, kept: list[Shape], problem: Problem, fit: Fit, along: Trajectory) -> list[Shape]:
    """The best shapes between those of the grid, where the shape varies continuously.

    The peak of a frequency is as narrow as the record is long, far narrower than a nonlinear fit can find.
    """
    shape = effect.shapes[0]
    if len(effect.shapes) > 1 or not shape.continuous:
        return kept
    ratio, shares = shape.scan[1] / shape.scan[0], np.linspace(-SCAN.reach, SCAN.reach, SCAN.finer).tolist()
    finer = [((index, value * ratio**share),) for ((index, value),) in kept for share in shares]
    gains = _gains(effect, finer, problem, fit, along)
    return [finer[i] for i in np.argsort(-gains)[: SCAN.kept]]


def _gains(effect: Effect, every: list[Shape], problem: Problem, fit: Fit, along: Trajectory) -> Array:
    """(shapes,) fall of chi2 that the leading amplitudes promise, what is fitted already projected out."""
    amplitudes, linear = effect.amplitudes[: SCAN.amplitudes], fit.linear
    fitted, many = ColumnSpace.of(*linear.flat), len(amplitudes)
    rows = np.concatenate([linear.A, linear.e[:, :, None], linear.Q], axis=2).transpose(0, 2, 1).copy()
    onto_initial = rows @ linear.Q
    positive = [p.sign == "positive" for p in amplitudes] == [True]
    gains: list[Array] = []
    for first in range(0, len(every), SCAN.block // many):
        chosen = every[first : first + SCAN.block // many]
        params = np.array([_unit(effect, p.name, shape) for shape in chosen for p in amplitudes])
        columns = along.answer(problem, along.torques(effect.stage, problem.model.constants, params))
        products = rows @ columns
        initial = products[:, -4:].copy()
        products -= onto_initial @ initial  # as if the columns had been projected, which would cost a pass over them
        across = products[:, :-4].sum(axis=0).reshape(-1, len(chosen), many)
        own = _within(columns, columns, many) - _within(initial, initial + products[:, -4:], many)
        gains.append(fitted.gains_given(across[:-1], own, across[-1], positive))
    return np.concatenate(gains)


def _within(columns: Array, others: Array, many: int) -> Array:
    """(shapes, many, many) products of columns (segments, rows, shapes * many) of a shape with others of the same."""
    apart = [np.einsum("smk,smk->k", columns[:, :, : columns.shape[2] - i], others[:, :, i:]) for i in range(many)]
    found = np.empty((columns.shape[2] // many, many, many))
    for i, j in product(range(many), repeat=2):
        found[:, i, j] = apart[abs(i - j)][min(i, j) :: many]
    return found


def _unit(effect: Effect, amplitude: str, shape: Shape) -> Array:
    """(SIZE,) parameters of one typical amplitude of an effect in a shape."""
    params, index = effect_params({}), param_index(effect.name, amplitude)
    params[index] = effect.parameters[index - SLICES[effect.name].start].typical
    for place, value in shape:
        params[place] = value
    return params
