"""Segments followed by a model with effects: only the start states are fitted, as for a run that is held out."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.readings import Pieces, memories, readings, readings_batch
from dpr_lab.effects.quantities import Known

Array = NDArray[np.float64]

STEPS = np.array([1e-6, 1e-6, 1e-5, 1e-5])  # forward differences of a start state, rad and rad/s
ITERATIONS = 15
SETTLED = 1e-8


@dataclass(frozen=True, slots=True)
class Simulated:
    """What is simulated: a rig and its effects."""

    base: Array
    """(6,) base parameters, SI."""
    vector: Array
    """(SIZE,) effects."""
    known: Known

    def angles(self, cut: Pieces, starts: Array) -> Array:
        """(samples, 2) what the encoders read from given start states, (segments, 4), rad."""
        return readings(self.base, self.vector, self.known, cut, starts)


def track(model: Simulated, cut: Pieces, measured: Array, starts: Array) -> tuple[Array, Array]:
    """Fit the start state of every segment, damped Gauss-Newton, each segment by itself.

    Args:
        model: ratios and effects, which stay as they are
        cut: the segments
        measured: (samples, 2) encoder readings, rad
        starts: (segments, 4) to begin with

    Returns:
        (segments, 4) start states, and the (samples, 2) readings they predict, rad
    """
    predicted = model.angles(cut, starts)
    cost = _by_segment((measured - predicted) ** 2, cut)
    damping = np.full(len(starts), 1e-9)
    for _ in range(ITERATIONS):
        trial = starts + _steps(model, cut, starts, predicted, measured, damping)
        angles = model.angles(cut, trial)
        trial_cost = np.nan_to_num(_by_segment((measured - angles) ** 2, cut), nan=np.inf)
        better = trial_cost < cost
        gain = np.max(np.where(better, 1 - trial_cost / cost, 0.0))
        starts = np.where(better[:, None], trial, starts)
        predicted = model.angles(cut, starts)
        cost = np.where(better, trial_cost, cost)
        damping = np.where(better, damping / 10, np.minimum(damping * 100, 1e3))
        if gain < SETTLED:
            break
    return starts, predicted


def _by_segment(squares: Array, cut: Pieces) -> Array:
    return np.add.reduceat(squares.sum(axis=1), cut.offsets[:-1])


def _steps(model: Simulated, cut: Pieces, starts: Array, predicted: Array, measured: Array, damping: Array) -> Array:
    moved = np.tile(starts, (4, 1, 1))
    for j in range(4):
        moved[j, :, j] += STEPS[j]
    memory = memories(model.base, model.vector, model.known, cut, starts)
    shifted = readings_batch(
        np.tile(model.base, (4, 1)), np.tile(model.vector, (4, 1)), model.known, cut, moved, memory
    )
    slopes = np.moveaxis(shifted - predicted, 0, -1) / STEPS
    steps = np.zeros_like(starts)
    for s, (first, last) in enumerate(zip(cut.offsets[:-1], cut.offsets[1:], strict=True)):
        J = slopes[first:last].reshape(-1, 4)
        H = J.T @ J
        steps[s] = np.linalg.solve(
            H + damping[s] * np.diag(np.diag(H)) + 1e-15 * np.eye(4), J.T @ (measured - predicted)[first:last].ravel()
        )
    return steps
