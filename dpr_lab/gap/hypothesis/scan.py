"""Scan of shapes: orders and frequencies of torques, and instants at which a reading may have stepped.

Hundreds of shapes are compared by one linearised fit. The score test and nonlinear fits examine the best few.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.trajectory import TRAJECTORY_TORQUES
from dpr_lab.effects import SLICES, effect_params, param_index, proposed_shapes
from dpr_lab.effects.effect import Effect, Recorded, Shape
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.fitting.response import Trajectory


@dataclass(frozen=True, slots=True)
class ScanSettings:
    """Settings of the scan over shapes."""

    many: int = 24
    """Number of shapes above which an effect is scanned along the swing before the score test."""
    kept: int = 2
    """Number of shapes that a scan returns: the best shape, and the best shape that is not its neighbour."""
    neighbours: float = 0.1
    """Maximum relative difference between the frequencies or orders of two neighbouring shapes."""
    finer: int = 13
    """Number of additional shapes around a shape of the grid.

    The width of a peak is the inverse of the record length.
    """
    reach: float = 0.75
    """Range of the additional shapes on either side, in steps of the grid."""
    block: int = 32
    """Number of columns that are processed together, so that they fit into the cache."""
    amplitudes: int = 2
    """Number of leading amplitudes of an effect that a scan fits."""
    periods: int = 2
    """Minimum number of periods that a joint must cover. A pattern that does not repeat is not evidence of a periodic
    effect."""
    gap_rad: float = 0.5
    """Largest gap in the visited angles of a joint that counts as revolving, rad."""


SCAN = ScanSettings()

ORDER = "order"
"""Name of the shape parameter for the number of periods of a torque per turn of its joint.

If the arc covers fewer periods than `SCAN.periods`, two harmonics act like a free polynomial in the angle. Such a
polynomial fits any smooth force and any nonlinearity of the encoder, so it is evidence of neither.
"""


@dataclass(frozen=True)
class ShapeScan:
    """Scan of the shapes of effects that are added to one linearised fit."""

    problem: Problem
    """Segments and noise."""
    fit: Fit
    """Fit to improve."""
    reference: Trajectory
    """Trajectory of the fit."""
    recorded: Recorded
    """Properties of the recordings from which shapes are proposed."""

    def shapes(self, effect: Effect) -> list[Shape]:
        """Shapes of an effect for the score test."""
        proposed = proposed_shapes(effect, self.recorded)
        if proposed is not None:
            return proposed
        grid = [[(param_index(effect.name, p.name), value) for value in p.scan] for p in effect.shapes if p.scan]
        grid_points = [tuple(choice) for choice in product(*grid)]
        if any(p.name == ORDER for p in effect.shapes):
            covered = arc(self.reference.joint_angle[:, effect.joints[0]])
            grid_points = [chosen for chosen in grid_points if chosen[0][1] * covered >= SCAN.periods * 2 * np.pi]
        if len(grid_points) <= SCAN.many or effect.stage not in TRAJECTORY_TORQUES:
            return grid_points
        return self._between(effect, _apart(grid_points, self._gains(effect, grid_points)))

    def _between(self, effect: Effect, separate: list[Shape]) -> list[Shape]:
        """Best shapes between the shapes of the grid, if the shape parameter is continuous.

        The width of a frequency peak is the inverse of the record length. It is too narrow for a nonlinear fit that
        starts from the grid.
        """
        shape = effect.shapes[0]
        if len(effect.shapes) > 1 or not shape.continuous:
            return separate
        ratio, shares = shape.scan[1] / shape.scan[0], np.linspace(-SCAN.reach, SCAN.reach, SCAN.finer).tolist()
        finer = [((index, value * ratio**share),) for ((index, value),) in separate for share in shares]
        gains = self._gains(effect, finer)
        return [finer[i] for i in np.argsort(-gains)[: SCAN.kept]]

    @cached_property
    def _fitted(self) -> ColumnSpace:
        """Columns of the fitted parameters."""
        return ColumnSpace.of(*self.fit.linear.flat)

    @cached_property
    def _rows(self) -> tuple[Array, Array]:
        """Rows with which columns are multiplied: transposed A, e and Q, (segments, free + 1 + states, m).

        The second array contains their inner products with Q, (segments, free + 1 + states, states).
        """
        linear = self.fit.linear
        rows = np.concatenate([linear.A, linear.e[:, :, None], linear.Q], axis=2).transpose(0, 2, 1).copy()
        return rows, rows @ linear.Q

    def _gains(self, effect: Effect, candidates: list[Shape]) -> Array:
        """(shapes,) predicted reduction of chi2 by the leading amplitudes, with the fitted model projected out."""
        amplitudes, problem = effect.amplitudes[: SCAN.amplitudes], self.problem
        count, states, (rows, onto_initial) = len(amplitudes), problem.segments.states, self._rows
        positive = [p.sign == "positive" for p in amplitudes] == [True]
        gains: list[Array] = []
        for first in range(0, len(candidates), SCAN.block // count):
            chosen = candidates[first : first + SCAN.block // count]
            params = np.array([_unit(effect, p.name, shape) for shape in chosen for p in amplitudes])
            torques = self.reference.torques(effect.stage, problem.model.constants, params)
            columns = self.reference.response(problem, torques)
            products = rows @ columns
            initial = products[:, -states:].copy()
            products -= onto_initial @ initial  # equivalent to projecting the columns, without one more pass over them
            across = products[:, :-states].sum(axis=0).reshape(-1, len(chosen), count)
            reduced = _within(columns, columns, count) - _within(initial, initial + products[:, -states:], count)
            gains.append(self._fitted.gains_given(across[:-1], reduced, across[-1], positive))
        return np.concatenate(gains)


def arc(angle: Array) -> float:
    """Arc that angles (n,) cover, rad: the circle without the largest interval between two neighbouring angles.

    For a joint that revolves, the arc is the whole range of the angles, because a periodic pattern repeats in each
    turn.
    """
    around = np.sort(np.mod(angle, 2 * np.pi))
    gap = float(np.diff(around, append=around[0] + 2 * np.pi).max())
    return 2 * np.pi - gap if gap > SCAN.gap_rad else float(np.ptp(angle))


def _apart(candidates: list[Shape], gains: Array) -> list[Shape]:
    """Best shapes; a shape that is a neighbour of a better one is omitted."""
    separate: list[Shape] = []
    for i in np.argsort(-gains):
        first = candidates[i][0][1]
        if all(abs(np.log(first / other[0][1])) > SCAN.neighbours for other in separate):
            separate.append(candidates[i])
        if len(separate) == SCAN.kept:
            break
    return separate


def _within(columns: Array, others: Array, count: int) -> Array:
    """(shapes, many, many) inner products between the columns of each shape, from (segments, rows, shapes * many)."""
    diagonals = [np.einsum("smk,smk->k", columns[:, :, : columns.shape[2] - i], others[:, :, i:]) for i in range(count)]
    blocks = np.empty((columns.shape[2] // count, count, count))
    for i, j in product(range(count), repeat=2):
        blocks[:, i, j] = diagonals[abs(i - j)][min(i, j) :: count]
    return blocks


def _unit(effect: Effect, amplitude: str, shape: Shape) -> Array:
    """(SIZE,) parameters with one typical amplitude of an effect in a given shape."""
    params, index = effect_params({}), param_index(effect.name, amplitude)
    params[index] = effect.parameters[index - SLICES[effect.name].start].typical
    for shape_index, value in shape:
        params[shape_index] = value
    return params
