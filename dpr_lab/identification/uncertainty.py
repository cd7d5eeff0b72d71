"""Uncertainty of fitted ratios, valid under correlated residuals (docs/theory.md, equation 22)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri, stdtrit

from dpr_lab.fitting.estimate import UNKNOWN_RATIOS
from dpr_lab.fitting.problem import Problem
from dpr_lab.identification.ratio_fit import RatioFit

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class CovarianceSettings:
    """Settings of the independence of residuals."""

    block_s: float = 0.5
    """Residuals further apart are taken as independent: half a swing of a 0.4 m rod."""
    misfit: float = 1.5
    """Reduced chi-square above which the model, not the noise, decides how uncertain the result is."""
    halves: float = 1.1
    """Factor by which one linear step understates the difference between fits of the two halves."""


SETTINGS = CovarianceSettings()


@dataclass(frozen=True, slots=True)
class RatioUncertainty:
    """Of the unknowns that runs show, in the order of `dpr_lab.fitting.estimate.UNKNOWN_RATIOS`."""

    values: Array
    """(n,) the unknowns."""
    information: Array
    """(n, n) Fisher information, initial states eliminated."""
    covariance: Array
    """(n, n) with blocks of residuals as units; zero for what is held at its bound."""
    blocks: int
    """How many there are."""
    names: tuple[str, ...] = UNKNOWN_RATIOS
    """Of the unknowns."""

    @property
    def std(self) -> Array:
        """(n,) standard deviations."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def at_zero(self) -> tuple[str, ...]:
        """Friction ratios held at zero, because their unconstrained estimate is negative."""
        return tuple(name for name, value in zip(self.names, self.values, strict=False) if value <= 0)

    @property
    def cramer_rao_std(self) -> Array:
        """(n,) Cramer-Rao bound of the standard deviation; zero for what is held at zero."""
        free = self.values > 0
        std = np.zeros(len(free))
        std[free] = np.sqrt(np.diag(np.linalg.inv(self.information[np.ix_(free, free)])))
        return std

    def interval90(self, index: int) -> tuple[float, float]:
        """90 % interval of one unknown, Student-t with the blocks as units."""
        freedom = max(self.blocks - len(self.values), 1)
        reach = float(stdtrit(freedom, 0.95)) * self.covariance[index, index] ** 0.5
        return float(self.values[index] - reach), float(self.values[index] + reach)


def uncertainty(ratio_fit: RatioFit) -> RatioUncertainty:
    """Uncertainty of a fit with all unknowns free.

    The covariance comes from the information at the noise that is there, widened to what the scatter of the blocks asks
    for. White residuals make both agree, and the information is the exacter of the two, because a chaotic run holds
    most of it in few blocks; correlated residuals make the blocks scatter more. What a wrong model leaves changes
    slowly along a run, so there the 90 % interval is also no narrower than what first and second halves disagree by.

    Raises:
        LinAlgError: the recordings do not determine the unknowns.
    """
    A, e = ratio_fit.slopes, ratio_fit.fit.linear.e
    H = np.einsum("smi,smj->sij", A, A)
    scores = _block_scores(ratio_fit.problem, A * e[:, :, None])
    free = ratio_fit.unknowns > 0
    bread = np.linalg.inv(H.sum(axis=0)[np.ix_(free, free)])
    if not (np.diag(bread) > 0.0).all():
        raise np.linalg.LinAlgError("the information matrix is singular to rounding")
    white = bread * ratio_fit.chi2_per_dof
    own = scores[:, free]
    blocks = len(own) / max(len(own) - len(free), 1) * bread @ own.T @ own @ bread
    variance = np.maximum(np.diag(white), np.diag(blocks))
    if ratio_fit.chi2_per_dof > SETTINGS.misfit:
        apart = SETTINGS.halves * _halves_apart(ratio_fit.problem, H, np.einsum("smi,sm->si", A, e))[free]
        variance = np.maximum(variance, (apart / 2 / ndtri(0.95)) ** 2)
    widen = np.sqrt(variance / np.diag(white))
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = white * np.outer(widen, widen)
    names = tuple(UNKNOWN_RATIOS[i] for i in ratio_fit.visible)
    return RatioUncertainty(ratio_fit.unknowns, H.sum(axis=0), covariance, len(own), names)


def _block_scores(problem: Problem, scores: Array) -> Array:
    """(blocks, n) gradient of each stretch of `block_s`: the independent units of the covariance."""
    owner, t = problem.owner, problem.t
    first = problem.segments.offsets[owner]
    by_sample = scores.reshape(len(scores), -1, 2, scores.shape[2]).sum(axis=2)[owner, np.arange(len(t)) - first]
    block = ((t - t[first]) // SETTINGS.block_s).astype(int)
    edges = np.flatnonzero((np.diff(owner, prepend=-1) != 0) | (np.diff(block, prepend=-1) != 0))
    return np.add.reduceat(by_sample, edges, axis=0)


def _halves_apart(problem: Problem, H: Array, gradients: Array) -> Array:
    """(n,) how far apart one Gauss-Newton step takes the first and the second halves of the runs."""
    segments = problem.segments
    last = problem.t[segments.offsets[1:] - 1]
    middle = np.add.reduceat(problem.t, segments.offsets[:-1]) / np.diff(segments.offsets)
    length = np.array([last[segments.run == run].max() for run in segments.run])
    second = middle > length / 2
    steps = [
        np.linalg.pinv(H[half].sum(axis=0), hermitian=True) @ gradients[half].sum(axis=0) for half in (~second, second)
    ]
    return np.abs(steps[1] - steps[0])
