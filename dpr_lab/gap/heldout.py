"""Prediction of a release that took no part in the fit, and how much independent evidence residuals hold.

Normal equations add up over segments: H = sum A^T A + P and g = sum A^T e, with P the weak prior that an effect is a
few times its typical size at most. So the fit without release r is one Gauss-Newton step away from the fit to all,

    dp = (H - H_r)^-1 (g - g_r),    V = (H - H_r)^-1,

and how well it predicts r is the logarithm of its predictive density, which for Gaussian errors is

    -2 log p(r | rest) = chi2(all) - chi2(rest) + f (log det H - log det (H - H_r)) + const,

f being the chi2 units that one independent piece of evidence costs. A parameter that only r can see then predicts
nothing sharply, instead of something wrong. Held-out segments keep free start states: they are scored for their
course, not for where they begin.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.gap.problem import Problem
from dpr_lab.gap.shooting import Fit

Array = NDArray[np.float64]

PRIOR = 10.0  # standard deviation of an effect before the data, in typical sizes
WILDEST = 1e6  # standard deviations that a reading counts for where a segment cannot be followed
BLOCKS = 4  # folds of a single recording: contiguous quarters


def folds(problem: Problem) -> NDArray[np.int64]:
    """(segments,) the fold of each: its run, or the quarter of the only one."""
    if len(set(problem.run.tolist())) > 1:
        return problem.run
    return (np.arange(len(problem.run)) * BLOCKS) // len(problem.run)


class _Folds:
    """Normal equations of a fit, of all segments and of each fold, in units of the prior."""

    def __init__(self, fit: Fit, fold: NDArray[np.int64]) -> None:
        free = [i for i, slot in enumerate(fit.slots) if slot.read(fit.point) > slot.lower]
        self._scale = np.array([PRIOR * fit.slots[i].size for i in free])
        self.A, self.e = fit.linear.A[:, :, free] * self._scale, fit.linear.e
        self.names = np.unique(fold)
        self.mine = [fold == r for r in self.names]
        self.H = [self._flat(m).T @ self._flat(m) for m in self.mine]
        self.g = [self._flat(m).T @ self.e[m].ravel() for m in self.mine]
        self.all = sum(self.H, np.eye(len(free)))

    def _flat(self, chosen: NDArray[np.bool_]) -> Array:
        return self.A[chosen].reshape(-1, self.A.shape[2])


def left_out(fit: Fit, fold: NDArray[np.int64]) -> Array:
    """(segments,) chi2 of each segment as predicted from the other folds."""
    parts = _Folds(fit, fold)
    chi2 = np.sum(parts.e**2, axis=1)
    for mine, H, g in zip(parts.mine, parts.H, parts.g, strict=True):
        step = np.linalg.solve(parts.all - H, sum(parts.g) - g)
        chi2[mine] = np.sum((parts.e[mine] - parts.A[mine] @ step) ** 2, axis=1)
    return chi2


def surprise(fit: Fit, fold: NDArray[np.int64], inflation: float) -> Array:
    """(folds,) -2 log predictive density of each fold given the others, up to a constant, in units of chi2."""
    parts = _Folds(fit, fold)
    gradient = sum(parts.g)
    every = float(np.sum(parts.e**2)) - gradient @ np.linalg.solve(parts.all, gradient)
    _, volume = np.linalg.slogdet(parts.all)
    found = []
    for mine, H, g in zip(parts.mine, parts.H, parts.g, strict=True):
        rest = gradient - g
        others = float(np.sum(parts.e[~mine] ** 2)) - rest @ np.linalg.solve(parts.all - H, rest)
        found.append(every - others + inflation * (volume - np.linalg.slogdet(parts.all - H)[1]))
    return np.array(found)


@dataclass(frozen=True, slots=True)
class Remainder:
    """What a fit leaves, against the noise."""

    chi2: float
    dof: int
    level: float
    """Variance of the residual's rough part, in units of the noise taken for the fit: the floor of the remainder."""
    autocorrelation: float
    """Of neighbouring residuals: the share of a remainder that is smooth."""
    excess: float
    """chi2 above the noise."""
    uncertainty: float
    """Standard deviation of the excess when there is nothing but noise."""

    @property
    def z(self) -> float:
        """How many standard deviations the remainder is from noise."""
        return self.excess / self.uncertainty

    @property
    def inflation(self) -> float:
        """What one independent piece of evidence costs in chi2: variance times n / n_eff of a first-order process."""
        rho = min(max(self.autocorrelation, 0.0), 0.99)
        return max(self.chi2 / self.dof, 1.0) * (1 + rho) / (1 - rho)

    @property
    def noise_ratio(self) -> float:
        """Size of the remainder over that of the noise, both rms."""
        return float(np.sqrt(max(self.excess, 0.0) / (self.level * self.dof)))


def remainder(problem: Problem, fit: Fit) -> Remainder:
    """Compare a fit's residual with its own roughness: white noise has as much of both, a missing effect is smooth.

    The level of the noise is taken from differences of neighbouring residuals (von Neumann), so that a noise floor a
    few per cent off is no gap. A residual rougher than the floor allows is an excess too.

    Source: J. von Neumann (1941), Distribution of the ratio of the mean square successive difference to the variance,
    Annals of Mathematical Statistics 12(4), 367-395.
    """
    r = np.clip(np.nan_to_num(problem.by_sample(fit.linear.residual), nan=WILDEST), -WILDEST, WILDEST)
    within = np.ones(len(r) - 1, dtype=bool)
    within[problem.offsets[1:-1] - 1] = False
    rough = 0.5 * float(np.mean(np.diff(r, axis=0)[within] ** 2))
    mean = float(np.mean(r**2))
    dof = r.size - 4 * len(problem.run) - len(fit.slots)
    # chi2 less its rough part is the sum of products of neighbours, which for white noise has the variance dof.
    level = min(max(rough, LEVEL_KNOWN[0]), LEVEL_KNOWN[1])
    chi2 = float(np.sum(r**2))
    autocorrelation = 1 - rough / mean if mean > 0 else 0.0
    return Remainder(chi2, dof, level, autocorrelation, chi2 - level * dof, level * float(np.sqrt(dof)))


LEVEL_KNOWN = (0.3, 1.3)
"""How far, as variance, the noise floor may be off before the difference counts as a gap."""
