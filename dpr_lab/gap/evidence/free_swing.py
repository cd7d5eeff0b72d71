"""Prediction of one recording from its first readings, and its sensitivity to every uncertain input.

With r the readings, J0 and J their slopes along the start state and along the fitted values, W one over the noise, the
start state is fitted to the first readings h. Whatever changes the readings by dr moves that start as well, so that

    dr - J0 (J0_h^T W^2 J0_h)^-1 J0_h^T W^2 dr_h

is left of it: what `settled` gives.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.quantities import RigConstants
from dpr_lab.fitting.linearise import UNKNOWN_STARTS, UNREAD_STARTS
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.screen.record import Record
from dpr_lab.gap.transfer.free_run import FREE_RUN, FreeRuns

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FreeSwing:
    """A free run of one model along one recording."""

    item: Record
    t: Array
    """(n,) since the first reading, s."""
    measured: Array
    """(n, 2) readings of the joints, rad."""
    weight: Array
    """(n, 2) one over the noise, 1/rad; zero where nothing is read."""
    predicted: Array
    """(n, 2) rad."""
    by_values: Array
    """(n, 2, free) slopes along the fitted values."""
    by_start: Array
    """(n, 2, 4) along the start state."""

    @property
    def head(self) -> NDArray[np.bool_]:
        """(n,) what the start state was fitted to."""
        return self.t < FREE_RUN.settle_s

    @property
    def compared(self) -> NDArray[np.bool_]:
        """(n, 2) readings that are compared, without the horizon."""
        return (self.weight > 0) & ~self.head[:, None]

    @property
    def _normal(self) -> tuple[Array, Array]:
        """(4, 4) normal matrix of the start state, and (rows, 4) its weighted slopes."""
        A = (self.weight[:, :, None] * self.by_start)[self.head].reshape(-1, 4)
        slow = np.diag(UNREAD_STARTS if self.item.run.setup.alone else UNKNOWN_STARTS)
        return A.T @ A + slow.T @ slow, A

    def settled(self, change: Array) -> Array:
        """(n, 2, k) rest of a change of the readings, (n, 2, k), after the initial state is refitted."""
        normal, A = self._normal
        rows = (self.weight[:, :, None] * change)[self.head].reshape(len(A), -1)
        return change - self.by_start @ (_inverse(normal) @ (A.T @ rows))

    def start_variance(self) -> Array:
        """(n, 2) of the prediction, by the noise of the readings that the start state was fitted to, rad^2."""
        inner = _inverse(self._normal[0])
        return np.einsum("nij,jk,nik->ni", self.by_start, inner, self.by_start)


def _inverse(normal: Array) -> Array:
    """Inverse of a (4, 4) normal matrix; of one that is singular to rounding, the pseudoinverse."""
    scale = 1 / np.sqrt(np.maximum(np.diag(normal), np.finfo(np.float64).tiny))
    return scale[:, None] * np.linalg.pinv(normal * np.outer(scale, scale), hermitian=True) * scale


@dataclass(frozen=True, slots=True)
class FreeSwings:
    """Free runs of one model for all recordings."""

    runs: FreeRuns
    each: tuple[FreeSwing, ...]

    def otherwise(self, constants: RigConstants | None = None, finer: float = 1.0) -> list[Array]:
        """(n, 2) of each by how much its readings change for a rig measured otherwise, or with finer steps."""
        known = self.runs.problem
        finer_segments = replace(known.segments, step=known.segments.step / finer)
        model = known.model if constants is None else known.model.with_constants(constants)
        changed = replace(known, segments=finer_segments, model=model).predict(self.runs.begun)
        change = np.nan_to_num(changed - self.runs.predicted)
        return [change[own] for own in self.runs.rows]


def free_swings(runs: FreeRuns, at: Hypothesis) -> FreeSwings:
    """Sensitivity of the free runs of a model to all uncertain quantities."""
    free, problem = at.fit.free, runs.problem
    slopes = np.zeros((len(problem.t), 2, len(free) + 4))  # zeros of these very runs count as known
    moves = [i for i, parameter in enumerate(free) if parameter.block != "zeros"]
    slopes[:, :, [*moves, *range(len(free), len(free) + 4)]] = problem.slopes(runs.begun, [free[i] for i in moves])
    slopes, t = np.nan_to_num(slopes), problem.t
    parts = (t, problem.measured, problem.weight, runs.predicted, slopes[:, :, :-4], slopes[:, :, -4:])
    each = ((t[own.start], [values[own] for values in parts]) for own in runs.rows)
    return FreeSwings(
        runs,
        tuple(
            FreeSwing(item, since - first, *of_run)
            for item, (first, (since, *of_run)) in zip(runs.items, each, strict=True)
        ),
    )


def horizon(swing: FreeSwing, error_rad: float = 0.1) -> float | None:
    """Time after which the uncertainty of the initial state alone causes a given error, s; None: later than the run."""
    lost = np.flatnonzero((swing.start_variance() * (swing.weight > 0)).max(axis=1) > error_rad**2)
    lost = lost[~swing.head[lost]]
    return float(swing.t[lost[0]]) if len(lost) else None


def growth_rate(swing: FreeSwing, until: float) -> float:
    """Largest finite-time rate at which an error of the angles at the start grows by then, 1/s.

    Source: largest singular value of the tangent map over a finite time; E. N. Lorenz (1965), Tellus 17, 321-333.
    """
    last = int(np.searchsorted(swing.t, until, side="right")) - 1
    largest = float(np.linalg.norm(swing.by_start[last, :, :2], ord=2))
    return float(np.log(max(largest, 1e-12)) / max(float(swing.t[last]), 1e-12))
