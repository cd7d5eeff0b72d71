"""Prediction of a run that took no part in the fit, by linear algebra on the fit to all.

Normal equations add up over segments: H = sum A^T A + P and g = sum A^T e, with P the weak prior that an effect is a
few times its typical size at most. So the fit without run r is one Gauss-Newton step away from the fit to all,

    dp = (H - H_r)^-1 (g - g_r),    V = (H - H_r)^-1,

and how well it predicts r is the logarithm of its predictive density, which for Gaussian errors is

    -2 log p(r | rest) = chi2(all) - chi2(rest) + f (log det H - log det (H - H_r)) + const,

f being the chi2 units that one independent piece of evidence costs. A parameter that only r can see then predicts
nothing sharply, instead of something wrong. Held-out segments keep free initial states: they are scored for their
course, not for where they begin. They keep free, too, what hardly any other run can see of the shape of an effect, such
as the cubic term of a spring that one run alone winds up: the others would extrapolate it. The size of the effect, its
first parameter, is always that of the others.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem

Array = NDArray[np.float64]

PRIOR = 10.0
"""Standard deviation of an effect before the data, in typical sizes: wide enough for any rig, and finite."""


@dataclass(frozen=True, slots=True)
class FoldSettings:
    """How recordings are left out."""

    quarters: int = 4
    """Folds of a single recording."""
    alone: float = 1e4
    """Growth of the variance of a shape parameter without a run, from which hardly any other run can see it."""


FOLDS = FoldSettings()


def folds(problem: Problem) -> NDArray[np.int64]:
    """(segments,) the fold of each: its run, or the quarter of the only one."""
    run = problem.segments.run
    return run if run.min() < run.max() else (np.arange(len(run)) * FOLDS.quarters) // len(run)


@dataclass(frozen=True, slots=True)
class _Fold:
    """Normal equations of one fold, in units of the prior."""

    mine: NDArray[np.bool_]
    H: Array
    gradient: Array
    chi2: float


class _Folds:
    """Normal equations of a fit, of all segments and of each fold, in units of the prior."""

    def __init__(self, fit: Fit, fold: NDArray[np.int64]) -> None:
        free = fit.inside
        self.A = fit.linear.A[:, :, free] * np.array([PRIOR * fit.free[i].size for i in free])
        self.zeros = np.array([fit.free[i].block == "zeros" for i in free], dtype=np.bool_)
        effects = [fit.free[i].effect for i in free]
        self.shapes = np.array([bool(name) and name in effects[:k] for k, name in enumerate(effects)], dtype=np.bool_)
        self.e = fit.linear.e
        self.each = [self._fold(fold == r) for r in np.unique(fold)]
        self.H = sum((one.H for one in self.each), np.eye(len(free)))
        self.gradient = sum((one.gradient for one in self.each), np.zeros(len(free)))

    def seen_by_one_alone(self, one: _Fold, V: Array) -> NDArray[np.bool_]:
        """(free,) zeros set before the run of a fold, and shape parameters of which V, without that run, knows little.

        They are as free there as its initial state.
        """
        zeros = self.zeros & (np.diag(self.H) - np.diag(one.H) <= 1.0)
        if not self.shapes.any():
            return zeros
        return zeros | (self.shapes & (np.diag(V) > FOLDS.alone * np.diag(np.linalg.inv(self.H))))

    def _fold(self, mine: NDArray[np.bool_]) -> _Fold:
        A, e = self.A[mine].reshape(-1, self.A.shape[2]), self.e[mine].ravel()
        return _Fold(mine, A.T @ A, A.T @ e, float(e @ e))


def left_out_chi2(fit: Fit, fold: NDArray[np.int64]) -> Array:
    """(segments,) chi2 of each segment as predicted from the other folds."""
    parts = _Folds(fit, fold)
    chi2 = np.sum(parts.e**2, axis=1)
    for one in parts.each:
        V = np.asarray(np.linalg.inv(parts.H - one.H), dtype=np.float64)
        left = parts.e[one.mine] - parts.A[one.mine] @ (V @ (parts.gradient - one.gradient))
        if (own := parts.seen_by_one_alone(one, V)).any():
            # What is tied to them moves along.
            columns = parts.A[one.mine] @ (V[:, own] @ np.linalg.inv(V[np.ix_(own, own)]))
            left = left - columns @ np.linalg.lstsq(columns.reshape(-1, columns.shape[2]), left.ravel(), rcond=None)[0]
        chi2[one.mine] = np.sum(left**2, axis=1)
    return chi2


def predictive_loss(fit: Fit, fold: NDArray[np.int64], inflation: float) -> Array:
    """(folds,) -2 log predictive density of each fold given the others, up to a constant, in units of chi2."""
    parts = _Folds(fit, fold)
    chi2 = sum(one.chi2 for one in parts.each)
    every = chi2 - parts.gradient @ np.linalg.solve(parts.H, parts.gradient)
    _, volume = np.linalg.slogdet(parts.H)
    found = []
    for one in parts.each:
        H, gradient = parts.H - one.H, parts.gradient - one.gradient
        others = chi2 - one.chi2 - gradient @ np.linalg.solve(H, gradient)
        found.append(every - others + inflation * (volume - np.linalg.slogdet(H)[1]))
    return np.array(found)
