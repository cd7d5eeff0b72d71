"""Scatter of the fitted values between recordings, beyond the noise of the readings.

Let H_r and g_r be the normal matrix and the gradient of recording r at the common fit, with initial states projected
out. The values fitted to recording r alone then differ from the common values by H_r^+ g_r. If only the noise of the
readings caused these differences,

    Q = sum_r g_r^T H_r^+ g_r

would be about nu = sum_r rank(H_r) - k for k values. A larger Q shows that the values are effective values of an
incomplete model. The values of another recording then have the covariance

    B = k (sum_r H_r + k P)^+,    k = (Q / nu - 1) R

about the common values, for R equally informative recordings. P is the information of the rig file (`fitting.prior`),
which also limits the values of another recording. B is zero if Q <= nu + 3 sqrt(2 nu). A single recording is divided
into quarters, as for the gap budget.

Source: R. T. Birge (1932), The calculation of errors by the method of least squares, Physical Review 40, 207-227, for
the ratio Q / nu; W. G. Cochran (1954), The combination of estimates from different experiments, Biometrics 10, 101-129.
"""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.cross_validation import Fold, folds, split


@dataclass(frozen=True, slots=True)
class ScatterSettings:
    """Settings of the estimate of the scatter."""

    significant: float = 3.0
    """Minimum excess of Q over nu, in standard deviations sqrt(2 nu), for recordings that differ."""
    singular: float = 1e-6
    """Largest relative eigenvalue of a scaled normal matrix that counts as zero."""


SCATTER = ScatterSettings()


def between_recordings(problem: Problem, fit: Fit) -> Array:
    """Return the (free, free) covariance B of the values between recordings (random effects).

    It describes the values of a new recording about the common values, and is zero for values at a bound.

    Args:
        problem: segments and noise
        fit: the common fit
    """
    inside, parts = _by_recording(fit, folds(problem))
    covariance = np.zeros((len(fit.free), len(fit.free)))
    normal = sum((part.H for part in parts), np.zeros((len(inside), len(inside))))
    if len(parts) < 2 or not inside or not np.isfinite(normal).all():
        return covariance
    scale = np.sqrt(np.maximum(np.diag(normal), np.finfo(np.float64).tiny))
    Q, rank = 0.0, 0
    for part in parts:
        eigenvalues, vectors = np.linalg.eigh(part.H / np.outer(scale, scale))
        determined = eigenvalues > SCATTER.singular * eigenvalues.max()
        Q += float(np.sum((vectors[:, determined].T @ (part.gradient / scale)) ** 2 / eigenvalues[determined]))
        rank += int(determined.sum())
    nu = rank - len(inside)
    if nu < 1 or not Q > nu + SCATTER.significant * (2 * nu) ** 0.5:
        return covariance
    excess = (Q / nu - 1) * len(np.unique(problem.segments.run))
    prior = fit.prior[:, inside]
    information = (normal + excess * prior.T @ prior) / np.outer(scale, scale)
    inverse = np.linalg.pinv(information, rcond=SCATTER.singular**2, hermitian=True)
    covariance[np.ix_(inside, inside)] = excess * inverse / np.outer(scale, scale)
    return covariance


def left_out_values(problem: Problem, fit: Fit) -> Array:
    """Fit the values without each recording in turn; return (recordings, free) values.

    One Gauss-Newton step gives the values without recording r,

        p - (H - H_r + P)^+ g_r

    with the common values p and the sum H of all H_r; the docstring of the module defines H_r, g_r and P. A value that
    only the omitted recording determines keeps its common value. So do all values if the normal equations are not
    finite. The result has no rows for a single recording.

    Args:
        problem: segments and noise
        fit: the common fit
    """
    inside, parts = _by_recording(fit, problem.segments.run)
    if len(parts) < 2:
        return np.zeros((0, len(fit.free)))
    values = np.repeat(fit.values[None], len(parts), axis=0)
    prior = fit.prior[:, inside].T @ fit.prior[:, inside]
    for row, part in enumerate(parts):
        normal = sum((other.H for other in parts if other is not part), prior)
        if not (np.isfinite(normal).all() and np.isfinite(part.gradient).all()):
            continue
        scale = np.sqrt(np.maximum(np.diag(normal + part.H), np.finfo(np.float64).tiny))
        inverse = np.linalg.pinv(normal / np.outer(scale, scale), rcond=SCATTER.singular, hermitian=True)
        values[row, inside] -= inverse @ (part.gradient / scale) / scale
    return np.clip(values, [p.lower for p in fit.free], [p.upper for p in fit.free])


def _by_recording(fit: Fit, recording: Integers) -> tuple[list[int], list[Fold]]:
    """Return the indices of the values inside their bounds, and the normal equations of each recording.

    A segment that cannot be simulated contributes nothing.
    """
    inside, followed = fit.inside, np.isfinite(fit.linear.chi2_by_segment)
    A = np.where(followed[:, None, None], fit.linear.A[:, :, inside], 0.0)
    return inside, split(A, np.where(followed[:, None], fit.linear.e, 0.0), recording)
