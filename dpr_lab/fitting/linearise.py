"""Linearise a problem at an estimate, and eliminate the initial states of the segments.

An initial state x_s affects only its own segment s. Let B = dreadings/dx_s = Q R be weighted like the readings. Then

    A = (I - Q Q^T) dreadings/dp,    e = (I - Q Q^T) residual

give normal equations for the free parameters p alone, for any number of segments. A and e are stored by segment. All
later computations are linear algebra with A and e: the predicted reduction by a further effect, the prediction of a
held-out run, the similarity of effects, and minimum detectable effects.

Source: multiple shooting, H. G. Bock (1983); variable projection, Golub & Pereyra (1973). docs/theory.md.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.fitting.estimate import Estimate, FreeParameter
from dpr_lab.fitting.problem import Problem
from dpr_lab.setup import Setup

BLIND = 1e-12
"""Minimum sensitivity of readings to an initial state, in standard deviations per rad; smaller values are rounding."""


UNKNOWN_STARTS = np.array([0.0, 0.0, 1.0, 1.0])
UNREAD_STARTS = np.array([0.0, 1.0, 1.0, 1.0])
"""Inverse prior standard deviations of the step of an initial state, 1/rad and s/rad.

The readings of a joint that is at rest from the first sample on contain no information on its initial speed. Without
the prior, angle and speed would be indistinguishable. The same holds for the angle of an outer rod that is not mounted.
"""


def slow_starts(setup: Setup, states: int = 4) -> Array:
    """Return the (states,) inverse standard deviations that limit an initial-state step.

    The state of a clamped arm is fixed.
    """
    rods = UNREAD_STARTS if setup.alone else UNKNOWN_STARTS
    return rods if states == len(rods) else np.append(rods, [0.0 if setup.arm_moves else 1.0, 1.0])


@dataclass(frozen=True, slots=True)
class Linearisation:
    """Whitened residuals and derivatives of all segments at one estimate.

    Shorter segments are padded to m = 2 * samples of the longest segment.
    """

    residual: Array
    """(segments, m) residual; inf for a segment whose simulation fails."""
    e: Array
    """(segments, m) residual with the initial states projected out."""
    A: Array
    """(segments, m, free) derivatives with the initial states projected out."""
    initial_state_coefficients: Array
    """(segments, 4, free) Q^T dreadings/dp: the part of the derivatives that the initial states can reproduce."""
    Q: Array
    """(segments, m, 4) factor Q of the QR decomposition of the derivatives with respect to the initial states."""
    R: Array
    """(segments, 4, 4) factor R of the QR decomposition."""

    @property
    def chi2_by_segment(self) -> Array:
        """(segments,) sum of squared residuals, with inf for a segment whose simulation fails."""
        with np.errstate(over="ignore"):
            return np.sum(self.residual**2, axis=1)

    @property
    def chi2(self) -> float:
        """Sum of squared residuals of all segments."""
        with np.errstate(over="ignore"):
            return float(self.chi2_by_segment.sum())

    @property
    def flat(self) -> tuple[Array, Array]:
        """(rows, free) matrix A and (rows,) residual e, with all segments in sequence."""
        return self.A.reshape(self.e.size, self.A.shape[2]), self.e.ravel()

    def projected(self, columns: Array) -> Array:
        """Return the (segments, m, k) whitened columns with the initial states projected out."""
        absorbed = self.Q @ (self.Q.transpose(0, 2, 1) @ columns)
        return np.subtract(columns, absorbed, out=absorbed)

    def carried(self, problem: Problem, predicted: Array) -> "Linearisation | None":
        """Return a copy with the residuals of other predicted readings (samples, 2) and unchanged derivatives.

        The result is None if a simulation has failed.
        """
        residual = problem.whitened(problem.measured - predicted)
        if not (np.isfinite(self.residual).all() and np.isfinite(residual).all()):
            return None
        return replace(self, residual=residual, e=self.projected(residual[:, :, None])[:, :, 0])

    def chosen(self, columns: Sequence[int]) -> "Linearisation":
        """Return the linearisation with respect to only some of the free parameters, given by their indices."""
        return replace(
            self, A=self.A[:, :, columns], initial_state_coefficients=self.initial_state_coefficients[:, :, columns]
        )

    def predicted_chi2(self, step: Array) -> float:
        """Return the sum of squared residuals after a parameter step, by the linear model."""
        return float(np.sum((self.e - self.A @ step) ** 2))

    def initial_steps(self, step: Array) -> Array:
        """Return the (segments, 4) least-squares steps of the initial states for a parameter step."""
        residual = np.where(np.isfinite(self.residual), self.residual, 0.0)[:, :, None]
        remaining = self.Q.transpose(0, 2, 1) @ residual - (self.initial_state_coefficients @ step)[:, :, None]
        return np.asarray(np.linalg.solve(self.R, remaining)[:, :, 0], dtype=np.float64)


def linearise(
    problem: Problem,
    estimate: Estimate,
    free: Sequence[FreeParameter],
    predicted: Array | None = None,
    slopes: Array | None = None,
) -> Linearisation:
    """Linearise a problem at an estimate.

    Args:
        problem: measured readings, weights and model
        estimate: point of expansion
        free: unknowns in addition to the initial states
        predicted: readings at the estimate, (samples, 2), if known
        slopes: derivatives of the readings, (samples, 2, free + 4), if known
    """
    predicted = problem.predict(estimate) if predicted is None else predicted
    residual = problem.whitened(problem.measured - predicted)
    J = problem.whitened(problem.slopes(estimate, free, predicted) if slopes is None else slopes)
    lost = np.logical_not(np.isfinite(J).all(axis=(1, 2)) & np.isfinite(residual).all(axis=1))
    residual[lost], J[lost] = np.inf, 0.0
    states = problem.segments.states
    slow_by_run = [np.diag(slow_starts(setup, states)) for setup in problem.segments.setups]
    slow = np.array(slow_by_run)[problem.segments.run]
    Q, R = np.linalg.qr(np.concatenate([J[:, :, -states:], slow], axis=1))
    Q = np.ascontiguousarray(Q[:, :-states])
    blind = np.abs(np.diagonal(R, axis1=1, axis2=2)).min(axis=1) < BLIND
    # no reading determines the initial state of such a segment, so it is not changed
    R[lost | blind] = np.eye(states) / BLIND
    of_free = J[:, :, :-states]
    coefficients = Q.transpose(0, 2, 1) @ of_free
    absorbed = Q @ coefficients
    linear = Linearisation(residual, residual, np.subtract(of_free, absorbed, out=absorbed), coefficients, Q, R)
    e = linear.projected(np.where(lost[:, None], 0.0, residual)[:, :, None])[:, :, 0]
    return replace(linear, e=e)
