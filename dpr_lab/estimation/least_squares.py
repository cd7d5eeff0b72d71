"""Segment least squares: the five ratios and every segment's start state, by damped Gauss-Newton.

    minimise  sum over segments s, samples k  | W_run(s) (theta_sk - theta_hat(t_k; r, x_s)) |^2

over the ratios r (5) and the start states x_s (4 each). A start state touches its own segment only, so it is eliminated
there by QR: with B = dresidual/dx_s = QR, the projected A~ = (I - Q Q^T) A and e~ = (I - Q Q^T) e leave five normal
equations however many segments there are.

Source: multiple shooting, H. G. Bock (1983); variable projection, Golub & Pereyra (1973).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.stats import t as student_t

from dpr_lab.dynamics.base import RATIOS, base_from_ratios
from dpr_lab.dynamics.segments import segments as laid_end_to_end
from dpr_lab.dynamics.sensitivity import sensitivities
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.estimation.segments import Segment, join, restart

BLOCK_S = 0.5  # residuals further apart than half a swing are taken as independent in the covariance
LINEAR_RANGE = 0.2  # a free run that strays further from the measurement than this, rad, is not Gauss-Newton-able
FRICTION = slice(3, 5)  # c1/b, c2/b cannot be negative


@dataclass(frozen=True, slots=True)
class SegmentFit:
    """Where the Gauss-Newton iteration ended."""

    ratios: NDArray[np.float64]
    """(5,) a/b, d/b, e1/b, c1/b, c2/b."""
    segments: tuple[Segment, ...]
    """The segments with their fitted start states."""
    predicted: tuple[NDArray[np.float64], ...]
    """(n, 2) fitted theta1, theta2 of each segment, rad."""
    information: NDArray[np.float64]
    """(5, 5) Fisher information of the ratios, start states eliminated."""
    covariance: NDArray[np.float64]
    """(5, 5) covariance of the ratios, valid under autocorrelated residuals (blocks as units)."""
    blocks: int
    chi2: float
    dof: int
    iterations: int
    converged: bool
    at_zero: tuple[str, ...]
    """Friction ratios held at zero because the data ask for less."""

    @property
    def chi2_per_dof(self) -> float:
        """Reduced chi-square; 1 = nothing left but noise."""
        return self.chi2 / self.dof

    def interval90(self, index: int) -> tuple[float, float]:
        """90 % interval of one ratio, Student-t with the blocks as units."""
        reach = float(student_t.ppf(0.95, max(self.blocks - len(RATIOS), 1))) * self.covariance[index, index] ** 0.5
        return float(self.ratios[index] - reach), float(self.ratios[index] + reach)

    def start_covariance(self, index: int, whitener: NDArray[np.float64], L1: float, g: float) -> NDArray[np.float64]:
        """(4, 4) covariance of one segment's start state, the ratios taken as known."""
        linear = _linearise(self.ratios, [self.segments[index]], [whitener], L1, g)[0]
        inverse = solve_triangular(linear.R, np.eye(4))
        return inverse @ inverse.T * max(1.0, self.chi2_per_dof)


@dataclass(frozen=True, slots=True)
class _Linear:
    residual: NDArray[np.float64]  # (2n,) whitened
    A: NDArray[np.float64]  # (2n, 5)
    Q: NDArray[np.float64]
    R: NDArray[np.float64]
    predicted: NDArray[np.float64]

    def projected(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        return self.A - self.Q @ (self.Q.T @ self.A), self.residual - self.Q @ (self.Q.T @ self.residual)


def fit_segments(
    ratios: NDArray[np.float64],
    segments: Sequence[Segment],
    whiteners: Sequence[NDArray[np.float64]],
    L1: float,
    g: float,
    *,
    hold_ratios: bool = False,
    max_iterations: int = 40,
) -> SegmentFit:
    """Fit ratios and start states to segments of fixed length.

    Args:
        ratios: (5,) where to start
        segments: what to fit; their `run` indexes `whiteners`
        whiteners: per run, the (2, 2) matrix W with W cov W^T = I for the noise of (theta1, theta2)
        L1: inner rod's length, m
        g: gravity, m/s^2
        hold_ratios: fit the start states only, as for a run that is held out
        max_iterations: give up (`converged` false) after as many
    """
    current = list(segments)
    linear = _linearise(ratios, current, whiteners, L1, g)
    cost, damping, converged, iteration = _cost(linear), 1e-6, False, 0
    while iteration < max_iterations and not converged:
        iteration += 1
        step = np.zeros(5) if hold_ratios else _ratio_step(ratios, linear, damping)
        starts = _start_steps(current, linear, step)
        trial_ratios = ratios + step
        trial = restart(current, starts)
        trial_linear = _linearise(trial_ratios, trial, whiteners, L1, g)
        trial_cost = _cost(trial_linear)
        if trial_cost <= cost:
            converged = cost - trial_cost <= 1e-8 * cost
            ratios, current, linear, cost = trial_ratios, trial, trial_linear, trial_cost
            damping = max(damping / 10, 1e-12)
        else:
            converged = damping > 1e6
            damping = max(damping * 10, 1e-6)
    return _result(ratios, current, linear, iteration, converged)


def information(
    ratios: NDArray[np.float64],
    segments: Sequence[Segment],
    whiteners: Sequence[NDArray[np.float64]],
    L1: float,
    g: float,
) -> NDArray[np.float64]:
    """(5, 5) Fisher information that segments hold of the ratios, start states eliminated; arguments of `fit_segments`."""
    H = np.zeros((5, 5))
    for part in _linearise(ratios, segments, whiteners, L1, g):
        A, _ = part.projected()
        H += A.T @ A
    return H


def grow(fit: SegmentFit, whiteners: Sequence[NDArray[np.float64]], L1: float, g: float) -> SegmentFit:
    """Lengthen the segments while the model still follows: longer segments carry more information.

    Neighbours are joined where the first one's free run stays within `LINEAR_RANGE` of the second's measurement, and
    the joined set is fitted again; a level whose residual rises is thrown away.
    """
    while fit.chi2_per_dof < 3.0:
        joined = _join_neighbours(fit, L1, g)
        if len(joined) == len(fit.segments):
            break
        longer = fit_segments(fit.ratios, joined, whiteners, L1, g)
        if not longer.converged or longer.chi2_per_dof > 1.5 * fit.chi2_per_dof:
            break
        fit = longer
    return fit


def _join_neighbours(fit: SegmentFit, L1: float, g: float) -> list[Segment]:
    joined: list[Segment] = []
    queue = list(fit.segments)
    while queue:
        first = queue.pop(0)
        if queue and queue[0].run == first.run and _follows(fit.ratios, both := join(first, queue[0]), L1, g):
            joined.append(both)
            queue.pop(0)
        else:
            joined.append(first)
    return joined


def _follows(ratios: NDArray[np.float64], segment: Segment, L1: float, g: float) -> bool:
    states = simulate(base_from_ratios(ratios), L1, g, segment.start, segment.t)
    return bool(np.max(np.abs(states[:, :2] - segment.theta)) < LINEAR_RANGE)


def _linearise(
    ratios: NDArray[np.float64],
    segments: Sequence[Segment],
    whiteners: Sequence[NDArray[np.float64]],
    L1: float,
    g: float,
) -> list[_Linear]:
    swings = laid_end_to_end([s.t for s in segments], np.array([s.start for s in segments]))
    states, slopes = sensitivities(ratios, L1, g, swings)
    linear = []
    for segment, (first, last) in zip(segments, pairwise(swings.offsets), strict=True):
        W, theta = whiteners[segment.run], states[first:last, :2]
        residual = ((segment.theta - theta) @ W.T).ravel()
        jacobian = np.einsum("ij,njk->nik", W, slopes[first:last, :2]).reshape(len(residual), 9)
        if np.isfinite(jacobian).all():
            Q, R = np.linalg.qr(jacobian[:, 5:])
        else:
            residual, Q, R = np.full_like(residual, np.inf), np.zeros((len(residual), 4)), np.eye(4)
        linear.append(_Linear(residual, jacobian[:, :5], Q, R, theta))
    return linear


def _cost(linear: Sequence[_Linear]) -> float:
    return float(sum(np.sum(part.residual**2) for part in linear))


def _ratio_step(ratios: NDArray[np.float64], linear: Sequence[_Linear], damping: float) -> NDArray[np.float64]:
    H, gradient = np.zeros((5, 5)), np.zeros(5)
    for part in linear:
        A, e = part.projected()
        H += A.T @ A
        gradient += A.T @ e
    free = np.ones(5, dtype=bool)
    step = np.zeros(5)
    for _ in range(3):
        inner = H[np.ix_(free, free)]
        step[:] = -ratios * ~free
        step[free] = np.linalg.solve(inner + damping * np.diag(np.diag(inner)), (gradient - H @ step)[free])
        below = np.zeros(5, dtype=bool)
        below[FRICTION] = (ratios + step)[FRICTION] < 0
        if not (below & free).any():
            break
        free &= ~below
    return step


def _start_steps(
    segments: Sequence[Segment], linear: Sequence[_Linear], ratio_step: NDArray[np.float64]
) -> NDArray[np.float64]:
    return np.array(
        [
            segment.start + solve_triangular(part.R, part.Q.T @ (part.residual - part.A @ ratio_step))
            for segment, part in zip(segments, linear, strict=True)
        ]
    )


def _result(
    ratios: NDArray[np.float64],
    segments: Sequence[Segment],
    linear: Sequence[_Linear],
    iterations: int,
    converged: bool,
) -> SegmentFit:
    H, meat, blocks, dof = np.zeros((5, 5)), np.zeros((5, 5)), 0, -len(RATIOS)
    for segment, part in zip(segments, linear, strict=True):
        A, e = part.projected()
        H += A.T @ A
        dof += len(e) - 4
        units = np.repeat(((segment.t - segment.t[0]) // BLOCK_S).astype(int), 2)
        for unit in np.unique(units):
            score = A[units == unit].T @ e[units == unit]
            meat += np.outer(score, score)
            blocks += 1
    free = ratios > 0
    covariance = np.zeros((5, 5))
    bread = np.linalg.inv(H[np.ix_(free, free)])
    scale = blocks / max(blocks - len(RATIOS), 1)
    covariance[np.ix_(free, free)] = bread @ meat[np.ix_(free, free)] @ bread * scale
    at_zero = tuple(name for name, is_free in zip(RATIOS, free, strict=True) if not is_free)
    predicted = tuple(part.predicted for part in linear)
    return SegmentFit(
        ratios, tuple(segments), predicted, H, covariance, blocks, _cost(linear), dof, iterations, converged, at_zero
    )
