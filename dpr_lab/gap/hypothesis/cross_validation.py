"""Prediction of a held-out run by linear algebra on the fit to all runs.

The normal equations are sums over segments: H = sum A^T A + P and g = sum A^T e, where P is a weak prior that limits an
effect to a few times its typical size. The fit without run r is therefore one Gauss-Newton step away from the fit to
all runs,

    dp = (H - H_r)^-1 (g - g_r),    V = (H - H_r)^-1.

The prediction of r is judged by the logarithm of its predictive density. For Gaussian errors,

    -2 log p(r | rest) = chi2(all) - chi2(rest) + f (log det H - log det (H - H_r)) + const,

where f is the variance inflation n / n_eff. If only r determines a parameter, the prediction is therefore uncertain but
not biased. The initial states of held-out segments are free, so that only the motion is predicted.

A shape parameter that the other runs hardly determine is also fitted to the held-out run. An example is the cubic term
of a spring that is far deflected in one run only. The size of an effect, which is its first parameter, is always taken
from the other runs.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.residuals import ASSUMPTIONS

PRIOR = 10.0
"""Standard deviation of the prior of the size of an effect, in typical sizes."""


@dataclass(frozen=True, slots=True)
class FoldSettings:
    """Settings of cross-validation."""

    quarters: int = 4
    """Number of folds into which a single recording is divided."""
    alone: float = 1e4
    """Maximum factor by which the variance of a shape parameter may grow if a run is held out.

    A parameter whose variance grows more is also fitted to the held-out run.
    """


FOLDS = FoldSettings()


def folds(problem: Problem) -> Integers:
    """Return the (segments,) index of the cross-validation fold of each segment.

    A fold is a run or, if there is a single run, a quarter of it. The quarters have equal numbers of segments or, if a
    known input drives the run, equal paths of the joints. A controller may keep the joints at rest for most of a run,
    and segments at rest cannot predict the other quarters. The indices are consecutive and begin at 0.
    """
    run, starts = problem.segments.run, problem.segments.offsets[:-1]
    if run.min() < run.max():
        return np.unique(run, return_inverse=True)[1]
    path = np.ones(len(run))
    if problem.segments.setups[run[0]].torques is not None:
        steps = np.abs(np.diff(problem.measured, axis=0, prepend=problem.measured[:1])).sum(axis=1)
        steps[starts] = 0.0
        path = np.add.reduceat(steps, starts)
    before = np.cumsum(path) - path
    quarter = (FOLDS.quarters * before / max(float(path.sum()), np.finfo(float).tiny)).astype(np.int64)
    return np.unique(quarter, return_inverse=True)[1]


def scaled_columns(fit: Fit, columns: Sequence[int]) -> Array:
    """Return the (segments, m, k) Jacobian of selected parameters, per prior standard deviation."""
    return fit.linear.A[:, :, columns] * np.array([PRIOR * fit.free[i].size for i in columns])


@dataclass(frozen=True, slots=True)
class Fold:
    """Normal equations of one fold: its segments, A^T A, A^T e and e^T e."""

    segments: Flags
    H: Array
    gradient: Array
    chi2: float


def split(A: Array, e: Array, fold: Integers) -> list[Fold]:
    """Compute the normal equations of each fold.

    The whitened columns A have the shape (segments, m, k), the whitened residuals e the shape (segments, m).
    """
    parts = []
    for r in np.unique(fold):
        segments = fold == r
        residual = e[segments].ravel()
        columns = A[segments].reshape(len(residual), A.shape[2])
        parts.append(Fold(segments, columns.T @ columns, columns.T @ residual, float(residual @ residual)))
    return parts


class _Folds:
    """Normal equations of a fit, for all segments and for each fold.

    The parameters are divided by their prior standard deviations, so that the prior is a unit matrix. The readings of a
    segment that cannot be simulated have the residual `ASSUMPTIONS.wildest`.
    """

    def __init__(self, fit: Fit, fold: Integers) -> None:
        free = _within_bounds(fit)
        self.A = scaled_columns(fit, free)
        self.zeros = np.array([fit.free[i].block == "zeros" for i in free], dtype=np.bool_)
        effects = [fit.free[i].effect for i in free]
        self.shapes = np.array([bool(name) and name in effects[:k] for k, name in enumerate(effects)], dtype=np.bool_)
        lost = ~np.isfinite(fit.linear.chi2_by_segment)
        self.e = np.where(lost[:, None], ASSUMPTIONS.wildest, fit.linear.e)
        self.folds = split(self.A, self.e, fold)
        self.H, self.gradient = self._total(self.folds)

    def without(self, left_out: Fold) -> tuple[Array, Array]:
        """Return the normal equations of all folds except one, with the prior.

        They are a new sum, because the difference of two sums could lose the prior by rounding.
        """
        return self._total([part for part in self.folds if part is not left_out])

    def _total(self, parts: Sequence[Fold]) -> tuple[Array, Array]:
        k = self.A.shape[2]
        return sum((part.H for part in parts), np.eye(k)), sum((part.gradient for part in parts), np.zeros(k))

    def free_in(self, fold: Fold, V: Array) -> Flags:
        """Return a (free,) mask of the parameters that are free in a held-out run.

        These are the encoder zeros of this run, if they are set before each run, and the shape parameters whose
        variance grows too much if the run is left out. V is the covariance of the fit without the run.
        """
        zeros = self.zeros & (np.diag(self.H) - np.diag(fold.H) <= 1.0)
        if not self.shapes.any():
            return zeros
        return zeros | (self.shapes & (np.diag(V) > FOLDS.alone * np.diag(np.linalg.inv(self.H))))


def _within_bounds(fit: Fit) -> list[int]:
    """Return the indices of the parameters whose values at the linear minimum are within their bounds.

    If a fit ends near a bound, the linear minimum may lie beyond it. It would then count as evidence for an effect
    whose sign is impossible.
    """
    free = fit.inside
    while free:
        sizes = np.array([PRIOR * fit.free[i].size for i in free])
        A = scaled_columns(fit, free).reshape(-1, len(free))
        step = sizes * np.linalg.solve(A.T @ A + np.eye(len(free)), A.T @ fit.linear.e.ravel())
        at_minimum = fit.values[free] + step
        within = [i for i, v in zip(free, at_minimum, strict=True) if fit.free[i].lower < v < fit.free[i].upper]
        if within == free:
            break
        free = within
    return free


def left_out_chi2(fit: Fit, fold: Integers) -> Array:
    """Return the (segments,) chi2 of each segment, with parameters from the other folds."""
    parts = _Folds(fit, fold)
    chi2 = np.sum(parts.e**2, axis=1)
    for left_out in parts.folds:
        H, gradient = parts.without(left_out)
        V = np.asarray(np.linalg.inv(H), dtype=np.float64)
        error = parts.e[left_out.segments] - parts.A[left_out.segments] @ (V @ gradient)
        if (free := parts.free_in(left_out, V)).any():
            # parameters that are correlated with the free ones change with them
            columns = parts.A[left_out.segments] @ (V[:, free] @ np.linalg.inv(V[np.ix_(free, free)]))
            error = (
                error - columns @ np.linalg.lstsq(columns.reshape(-1, columns.shape[2]), error.ravel(), rcond=None)[0]
            )
        chi2[left_out.segments] = np.sum(error**2, axis=1)
    return chi2


def predictive_loss(fit: Fit, fold: Integers, inflation: float) -> float:
    """Compute the predictive loss of a fit, in units of chi2.

    Each fold is predicted from the other folds. The loss is -2 times the logarithm of the predictive density, summed
    over all folds, up to a constant.
    """
    parts = _Folds(fit, fold)
    chi2 = sum(left_out.chi2 for left_out in parts.folds)
    total = chi2 - parts.gradient @ np.linalg.solve(parts.H, parts.gradient)
    _, volume = np.linalg.slogdet(parts.H)
    losses = []
    for left_out in parts.folds:
        H, gradient = parts.without(left_out)
        others = chi2 - left_out.chi2 - gradient @ np.linalg.solve(H, gradient)
        losses.append(total - others + inflation * (volume - np.linalg.slogdet(H)[1]))
    return float(np.sum(losses))
