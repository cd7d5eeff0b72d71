"""Scan of shape parameters of effects, such as orders and frequencies."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.trajectory import TRAJECTORY_TORQUES
from dpr_lab.effects import effect_params, param_index, proposed_shapes
from dpr_lab.effects.effect import Effect, Recorded, Shape
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.linearise import Linearisation
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace, SmallSets
from dpr_lab.fitting.response import Trajectory
from dpr_lab.gap.hypothesis.swing_lines import FREQUENCY


@dataclass(frozen=True, slots=True)
class ScanSettings:
    """Settings of the scan over shapes."""

    many: int = 24
    """Maximum number of shapes of an effect without a preliminary scan before the score test."""
    kept: int = 2
    """Number of shapes that a scan returns: the best shape and the best shapes that are not its neighbours."""
    neighbours: float = 0.1
    """Maximum relative difference between the frequencies or orders of two neighbouring shapes."""
    finer: int = 13
    """Number of additional values of a shape parameter around a grid point, because peaks of the gain are narrow.

    The width of a peak is the inverse of the record length.
    """
    reach: float = 0.75
    """Range of the additional values on either side, in steps of the grid."""
    block: int = 32
    """Number of columns that are processed together and fit into the processor cache."""
    amplitudes: int = 2
    """Number of amplitudes of an effect that a scan fits: the first ones."""
    periods: int = 2
    """Minimum number of periods that the motion of a joint must cover; a pattern that does not repeat is not evidence
    of a periodic effect."""
    gap_rad: float = 0.5
    """Maximum interval of angles that are not visited, for a joint that counts as revolving, rad."""


SCAN = ScanSettings()

ORDER = "order"
"""Name of the shape parameter for the number of periods of a torque per turn of its joint.

Orders with fewer than `SCAN.periods` periods in the arc of the joint are not tested. Over such an arc, two harmonics
can fit any smooth torque and any nonlinearity of the encoder, so that they do not indicate a periodic effect.
"""


@dataclass(frozen=True, slots=True)
class FittedColumns:
    """Linearised fit: columns A of the parameters, residual e, and orthonormal columns Q of the initial states."""

    space: ColumnSpace
    """Column space of A and e."""
    rows: Array
    """(segments, k + 1 + states, m) transposed A, e and Q."""
    onto_initial: Array
    """(segments, k + 1 + states, states) inner products of the rows with Q."""

    @classmethod
    def of(cls, linear: Linearisation) -> "FittedColumns":
        """Copy the columns, the residual and the initial-state columns of a linearised fit."""
        rows = np.concatenate([linear.A, linear.e[:, :, None], linear.Q], axis=2).transpose(0, 2, 1).copy()
        return cls(ColumnSpace.of(*linear.flat), rows, rows @ linear.Q)

    def projected(self, columns: Array, count: int) -> SmallSets:
        """Project the fitted columns and the initial states out of sets of columns.

        Args:
            columns: (segments, m, sets * count) whitened columns
            count: number of columns of each set
        """
        products, within = self.products(columns, count)
        return self.of_products(products.sum(axis=0), within.sum(axis=0), count)

    def products(self, columns: Array, count: int) -> tuple[Array, Array]:
        """Return inner products of columns, with the initial states projected out of the columns.

        Returns:
            (segments, k + 1, sets * count) products with A and e, and (segments, sets, count, count) products within
            each set
        """
        states = self.onto_initial.shape[2]
        products = self.rows @ columns
        initial = products[:, -states:].copy()
        products -= self.onto_initial @ initial  # equivalent to projecting the columns, without one more pass over them
        within = _within(columns, columns, count) - _within(initial, initial + products[:, -states:], count)
        return products[:, :-states], within

    def of_products(self, products: Array, within: Array, count: int) -> SmallSets:
        """Project the fitted columns out of sets of `count` columns.

        `products` and `within` are the results of `products()`, summed over all segments.
        """
        across = products.reshape(len(products), -1, count)
        return self.space.projected_out_of_sets(across[:-1], within, across[-1])


@dataclass(frozen=True)
class ShapeScan:
    """Scan of the shapes of effects; each shape is added to one linearised fit."""

    problem: Problem
    """Segments and noise."""
    fit: Fit
    """Fit to improve."""
    reference: Trajectory
    """Trajectory of the fit."""
    recorded: Recorded
    """Properties of the recordings from which shapes are proposed."""

    def shapes(self, effect: Effect) -> list[Shape]:
        """Return the shapes of an effect to be compared by the score test."""
        proposed = proposed_shapes(effect, self.recorded)
        if proposed is not None:
            return proposed
        grid = [[(param_index(effect.name, p.name), value) for value in p.scan] for p in effect.shapes if p.scan]
        grid_points = [tuple(choice) for choice in product(*grid)]
        if any(p.name == ORDER for p in effect.shapes):
            covered = self._covered(effect.joints[0])
            grid_points = [chosen for chosen in grid_points if chosen[0][1] * covered >= SCAN.periods * 2 * np.pi]
        if [p.name for p in effect.shapes] == [FREQUENCY]:
            grid_points = [chosen for chosen in grid_points if chosen[0][1] < self.resolved_hz]
        if len(grid_points) <= SCAN.many or effect.stage not in TRAJECTORY_TORQUES:
            return grid_points
        return self._between(effect, _apart(grid_points, self._gains(effect, grid_points)))

    def _covered(self, joint: int) -> float:
        """Return the arc that a joint covers, rad.

        The arc of joint 1 is at most that of its readings, because a fit without the zero error or tilt of the rig may
        cover a larger arc. The readings of encoder 2 are not used: they may be angles of the outer rod instead of joint
        2.
        """
        covered = arc(self.reference.joint_angle[:, joint])
        readings = self.problem.measured[self.problem.read[:, 0], 0]
        return min(covered, arc(readings)) if joint == 0 and len(readings) else covered

    @cached_property
    def resolved_hz(self) -> float:
        """Half the sampling rate, Hz: higher frequencies are aliased.

        The joints may have different sampling rates; the higher rate counts. The result is infinite if no run has two
        readings of a joint.
        """
        segments = self.problem.segments
        run = segments.run[segments.owner]
        steps = [np.diff(segments.t[read])[np.diff(run[read]) == 0] for read in self.problem.read.T]
        medians = [float(np.median(of_joint)) for of_joint in steps if len(of_joint)]
        return 0.5 / min(medians) if medians else np.inf

    def _between(self, effect: Effect, separate: list[Shape]) -> list[Shape]:
        """Return the best shapes between the grid points of a continuous shape parameter.

        The width of a peak over the frequency is the inverse of the record length. This is too narrow for a nonlinear
        fit that starts from a grid point.
        """
        shape = effect.shapes[0]
        if len(effect.shapes) > 1 or not shape.continuous:
            return separate
        ratio, shares = shape.scan[1] / shape.scan[0], np.linspace(-SCAN.reach, SCAN.reach, SCAN.finer).tolist()
        finer = [((index, value * ratio**share),) for ((index, value),) in separate for share in shares]
        gains = self._gains(effect, finer)
        return [finer[i] for i in np.argsort(-gains)[: SCAN.kept]]

    @cached_property
    def _fitted(self) -> FittedColumns:
        """Columns of the linearised fit, with their inner products."""
        return FittedColumns.of(self.fit.linear)

    def _gains(self, effect: Effect, candidates: list[Shape]) -> Array:
        """Predict the (shapes,) reduction of chi2 for each value of the shape parameters.

        Only the first `SCAN.amplitudes` amplitudes are used. The fitted parameters are projected out of their columns.
        """
        amplitudes = effect.amplitudes[: SCAN.amplitudes]
        positive = [p.sign == "positive" for p in amplitudes] == [True]
        sizes = [p.typical for p in amplitudes]
        blocks = shape_columns(self.problem, self.reference, effect, sizes, candidates)
        return np.concatenate([self._fitted.projected(block, len(sizes)).gains(positive=positive) for block in blocks])


def arc(angle: Array) -> float:
    """Return the arc that angles (n,) cover, rad.

    The arc is the full circle minus the largest interval between two neighbouring angles. For a joint that revolves,
    the arc is the range of the angles including full turns, because a periodic pattern repeats in each turn.
    """
    around = np.sort(np.mod(angle, 2 * np.pi))
    gap = float(np.diff(around, append=around[0] + 2 * np.pi).max())
    return 2 * np.pi - gap if gap > SCAN.gap_rad else float(np.ptp(angle))


def _apart(candidates: list[Shape], gains: Array) -> list[Shape]:
    """Return the best shapes, without neighbours of a better shape."""
    separate: list[Shape] = []
    for i in np.argsort(-gains):
        first = candidates[i][0][1]
        if all(abs(np.log(first / other[0][1])) > SCAN.neighbours for other in separate):
            separate.append(candidates[i])
        if len(separate) == SCAN.kept:
            break
    return separate


def _within(columns: Array, others: Array, count: int) -> Array:
    """Return the (segments, sets, n, n) inner products of `columns` with `others` within each set, with n = `count`.

    Both arguments have the shape (segments, rows, sets * n). The products of a set are symmetric, so only products with
    the same or a later column are computed.
    """
    diagonals = [
        np.einsum("smk,smk->sk", columns[:, :, : columns.shape[2] - i], others[:, :, i:]) for i in range(count)
    ]
    blocks = np.empty((len(columns), columns.shape[2] // count, count, count))
    for i, j in product(range(count), repeat=2):
        blocks[:, :, i, j] = diagonals[abs(i - j)][:, min(i, j) :: count]
    return blocks


def shape_columns(
    problem: Problem, reference: Trajectory, effect: Effect, sizes: Sequence[float], shapes: Sequence[Shape]
) -> Iterator[Array]:
    """Yield the (segments, m, block * sizes) changes of the readings caused by an effect, for blocks of its shapes.

    Args:
        problem: segments and noise
        reference: trajectory along which the effect acts
        effect: a torque along the trajectory
        sizes: size of each of the leading amplitudes; in each column, only one of them is not zero
        shapes: shapes of the effect
    """
    at_once = max(1, SCAN.block // len(sizes))
    for first in range(0, len(shapes), at_once):
        params = _one_amplitude(effect, sizes, shapes[first : first + at_once])
        yield reference.response(problem, reference.torques(effect.stage, problem.model.constants, params))


def _one_amplitude(effect: Effect, sizes: Sequence[float], shapes: Sequence[Shape]) -> Array:
    """Return (shapes * sizes, SIZE) parameters: each row has one non-zero amplitude of the effect."""
    params = np.tile(effect_params({}), (len(shapes), len(sizes), 1))
    for i, size in enumerate(sizes):
        params[:, i, param_index(effect.name, effect.amplitudes[i].name)] = size
    for of_shape, shape in zip(params, shapes, strict=True):
        for index, value in shape:
            of_shape[:, index] = value
    return params.reshape(len(shapes) * len(sizes), -1)
