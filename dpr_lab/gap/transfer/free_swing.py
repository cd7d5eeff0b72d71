"""Prediction of a recording from its first readings, with sensitivities to uncertain inputs.

Let J0 and J be the Jacobians of the readings r with respect to the initial state and to the fitted values, and W the
inverse of the noise. The initial state is fitted to the first readings h. A change dr of the readings also changes this
initial state, so that

    dr - J0 (J0_h^T W^2 J0_h)^-1 J0_h^T W^2 dr_h

remains. `settled` returns this remaining change.
"""

from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.fitting.linearise import slow_starts
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.screen.record import Record
from dpr_lab.gap.transfer.free_run import FREE_RUN, FreeRunError, FreeRuns
from dpr_lab.setup import Setup


@dataclass(frozen=True, slots=True)
class FreeSwing:
    """Free run of a model along a recording.

    It contains the sensitivities to the initial state and to the fitted values.
    """

    record: Record
    t: Array
    """(n,) time since the first reading, s."""
    measured: Array
    """(n, 2) readings of the joints, rad."""
    weight: Array
    """(n, 2) inverse standard deviation of the noise, 1/rad; zero where a reading is missing."""
    predicted: Array
    """(n, 2) predicted readings, rad."""
    by_values: Array
    """(n, 2, free) Jacobian of the readings with respect to the fitted values."""
    by_start: Array
    """(n, 2, 4) Jacobian of the readings with respect to the initial state; (n, 3, 6) with an arm that moves."""
    setup: Setup
    """Mounted rods and motion of the arm."""

    @property
    def head(self) -> Flags:
        """(n,) mask of the readings to which the initial state was fitted."""
        return self.t < FREE_RUN.settle_s

    @property
    def compared(self) -> Flags:
        """(n, 2) mask of the readings that are compared, before the horizon is applied."""
        return (self.weight > 0) & ~self.head[:, None]

    @property
    def _normal(self) -> tuple[Array, Array]:
        """(4, 4) normal matrix of the initial state, and (rows, 4) weighted Jacobian."""
        A = (self.weight[:, :, None] * self.by_start)[self.head].reshape(-1, self.by_start.shape[2])
        slow = np.diag(slow_starts(self.setup, A.shape[1]))
        return A.T @ A + slow.T @ slow, A

    def settled(self, change: Array) -> Array:
        """Return the (n, 2, k) changes of the readings after a refit of the initial state."""
        normal, A = self._normal
        rows = (self.weight[:, :, None] * change)[self.head].reshape(len(A), -1)
        return change - self.by_start @ (_inverse(normal) @ (A.T @ rows))

    def start_variance(self) -> Array:
        """Return the (n, 2) prediction variance due to noise of the first readings, rad^2."""
        inner = _inverse(self._normal[0])
        return np.einsum("nij,jk,nik->ni", self.by_start, inner, self.by_start)


def _inverse(normal: Array) -> Array:
    """Invert a (4, 4) normal matrix, or return its pseudoinverse if it is singular."""
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), np.finfo(np.float64).tiny))
    return scale[:, None] * np.linalg.pinv(normal * np.outer(scale, scale), hermitian=True) * scale


@dataclass(frozen=True, slots=True)
class FreeSwings:
    """Free runs of one model for all recordings."""

    runs: FreeRuns
    each: tuple[FreeSwing, ...]

    def otherwise(self, constants: RigConstants | None = None, finer: float = 1.0) -> list[Array]:
        """Return the (n, 2) change of each run's readings in another simulation.

        Args:
            constants: constants of the rig for this simulation; None: unchanged
            finer: factor by which the integration steps are smaller
        """
        known = self.runs.problem
        finer_segments = replace(known.segments, step=known.segments.step / finer)
        model = known.model if constants is None else known.model.with_constants(constants)
        changed = replace(known, segments=finer_segments, model=model).predict(self.runs.start)
        change = np.nan_to_num(changed - self.runs.predicted)
        return [change[rows] for rows in self.runs.rows]


def free_swings(runs: FreeRuns, model: Hypothesis) -> FreeSwings:
    """Compute free runs of a model and their sensitivity to all uncertain quantities."""
    free, problem = model.fit.free, runs.problem
    states = problem.segments.states
    # the derivatives with respect to encoder zeros are zero, because the zeros of these runs are treated as known
    slopes = np.zeros((len(problem.t), problem.axes, len(free) + states))
    moves = [i for i, parameter in enumerate(free) if parameter.block != "zeros"]
    slopes[:, :, [*moves, *range(len(free), len(free) + states)]] = problem.slopes(runs.start, [free[i] for i in moves])
    slopes, t = np.nan_to_num(slopes), problem.t
    parts = (t, problem.measured, problem.weight, runs.predicted, slopes[:, :, :-states], slopes[:, :, -states:])
    predictions = []
    for recording, setup, rows in zip(runs.items, problem.segments.setups, runs.rows, strict=True):
        since_start, measured, weight, predicted, by_values, by_start = (values[rows] for values in parts)
        predictions.append(
            FreeSwing(recording, since_start - since_start[0], measured, weight, predicted, by_values, by_start, setup)
        )
    return FreeSwings(runs, tuple(predictions))


def expected_errors(swings: FreeSwings, noise: float) -> dict[str, FreeRunError]:
    """Return the mean squared error of each run due to noise of its first readings.

    The result has the form of `FreeRuns.errors`.

    Args:
        swings: the free runs
        noise: factor on the variance of a reading, for the level and the correlation of the noise
    """
    expected = {}
    for swing in swings.each:
        read, after = swing.weight.any(axis=0), ~swing.head
        if after.any():
            squares = noise * np.mean(swing.start_variance()[after][:, read], axis=1)
            expected[swing.record.run.name] = FreeRunError(swing.t[after], squares)
    return expected


def horizon(swing: FreeSwing, error_rad: float = 0.1) -> float | None:
    """Return the time, s, at which the uncertain initial state causes a given error.

    The result is None if this time exceeds the duration of the run.
    """
    lost = np.flatnonzero((swing.start_variance() * (swing.weight > 0)).max(axis=1) > error_rad**2)
    lost = lost[~swing.head[lost]]
    return float(swing.t[lost[0]]) if len(lost) else None


def growth_rate(swing: FreeSwing, until: float) -> float:
    """Return the largest growth rate of an initial angle error, 1/s.

    Source: largest singular value of the tangent map over a finite time; E. N. Lorenz (1965), Tellus 17, 321-333.
    """
    last = int(np.searchsorted(swing.t, until, side="right")) - 1
    largest = float(np.linalg.norm(swing.by_start[last, :, :2], ord=2))
    return float(np.log(max(largest, 1e-12)) / max(float(swing.t[last]), 1e-12))
