"""Correlated errors of angles that were tracked in a video.

The errors of a tracker have the same sign over several frames. High-order differences contain only the high-frequency
part of such errors and underestimate the noise. The low-frequency part looks like an effect of the rig. The residual of
the bare model contains both parts. Within a segment its covariance is

    K(i, j) = s^2 rho^|i - j| + v^2 exp(-(t_i - t_j)^2 / (2 l^2)),

the sum of a first-order autoregressive error and a smooth error of the motion. The standard deviations s and v, the
correlation rho and the correlation time l are free. The spectrum of the first term decreases with the square of the
frequency, that of the second much faster. The two terms are therefore separable. The value of rho is its
maximum-likelihood estimate.

Source: Rasmussen & Williams (2006), Gaussian Processes for Machine Learning, sections 4.2.1 and 5.4.1.
"""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.estimation.noise import ORDER
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.screen.differences import sixth
from dpr_lab.gap.screen.recordings import Recordings, TrackingNoise


@dataclass(frozen=True, slots=True)
class TrackingNoiseSettings:
    """Settings of the likelihood of tracking noise."""

    shorter: float = 0.2
    """Maximum fraction of the segments that may be shorter than a window."""
    fewest: int = 10
    """Minimum number of readings in a window: half a second at 20 frames per second."""
    most: int = 64
    """Maximum number of readings in a window."""
    windows: int = 8
    """Minimum number of windows for an estimate."""
    correlations: tuple[float, ...] = tuple((1 - np.geomspace(1.0, 0.04, 24)).tolist())
    """Tested correlations of neighbouring errors, 0 first."""
    remainders: tuple[float, ...] = (0.0, *np.geomspace(0.1, 1e5, 13).tolist())
    """Tested values of v^2 / s^2, the variance of the smooth error relative to that of the correlated error."""
    smooth: tuple[float, ...] = (0.5, 1.0)
    """Tested correlation times l of the smooth error, in units of sqrt(L1 / g)."""
    significant: float = 10.8
    """Minimum of twice the logarithm of the likelihood ratio to white noise. Chance exceeds this minimum in 0.1 % of
    cases."""
    rougher: float = 1.5
    """Maximum ratio of the estimated errors to those estimated from differences of neighbouring readings.

    Abrupt stops of a sticking rod increase this ratio, although they are not errors of a tracker.
    """


TRACKING = TrackingNoiseSettings()


def tracking_noise(recordings: Recordings, problem: Problem, bare: Fit) -> TrackingNoise | None:
    """Estimate correlated errors of the readings by maximum likelihood.

    Args:
        recordings: the runs
        problem: segments of the runs
        bare: bare model, fitted to the segments

    Returns:
        the noise; None if it is not significantly more likely than white noise, too large for a tracker, or measured
    """
    records = recordings.records
    if recordings.tracking or not all(record.may_be_film and not record.noise_measured for record in records):
        return None
    windows = _windows(problem, bare)
    if windows is None:
        return None
    t, residuals = windows
    times = np.asarray(TRACKING.smooth) * np.sqrt(recordings.rig.L1 / recordings.rig.g)
    axes = [axis for axis in range(2) if np.isfinite(residuals[axis]).all() and residuals[axis].any()]
    minus2logs = np.zeros(len(TRACKING.correlations))
    variances = np.ones((2, len(TRACKING.correlations)))
    for axis in axes:
        values, variances[axis] = _profile(t, residuals[axis], times)
        minus2logs += values
    best = int(np.argmin(minus2logs))
    if minus2logs[0] - minus2logs[best] < TRACKING.significant:
        return None
    correlation, factor = TRACKING.correlations[best], np.sqrt(variances[:, best])
    if (factor > TRACKING.rougher / _high_frequency_part(correlation)).any():
        return None
    return TrackingNoise(correlation, factor)


def _high_frequency_part(correlation: float) -> float:
    """Return the standard deviation of the scaled sixth differences of autoregressive errors of unit variance."""
    unit = sixth(np.eye(ORDER + 1))[0]
    lags = np.arange(len(unit))
    return float(np.sqrt(unit @ np.power(correlation, np.abs(lags[:, None] - lags)) @ unit))


def _windows(problem: Problem, bare: Fit) -> tuple[Array, Array] | None:
    """Return the (n,) times of a window, s, and (2, n, windows) residuals in standard deviations of the noise.

    The result is None if there are too few windows.
    """
    residual = problem.by_sample(bare.linear.residual)
    interval = float(np.median(np.diff(problem.t)))
    n = min(int(np.quantile(np.diff(problem.segments.offsets), TRACKING.shorter)), TRACKING.most)
    if n < TRACKING.fewest:
        return None
    chosen = [
        slice(first, first + n)
        for begin, end in zip(problem.segments.offsets[:-1], problem.segments.offsets[1:], strict=True)
        for first in range(begin, end - n + 1, n)
        if np.ptp(problem.t[first : first + n]) < (n - 0.5) * interval and problem.read[first : first + n, 0].all()
    ]
    if len(chosen) < TRACKING.windows:
        return None
    residuals = np.array([residual[window].T for window in chosen], dtype=np.float64)  # (windows, 2, n)
    return interval * np.arange(n, dtype=np.float64), residuals.transpose(1, 2, 0)


def _profile(t: Array, residual: Array, times: Array) -> tuple[Array, Array]:
    """Minimise -2 log L over the smooth error, for each correlation of the other error.

    Returns:
        (correlations,) minimum of -2 log L, and (correlations,) variance s^2 at the minimum
    """
    apart = np.abs(t[:, None] - t)
    lags = np.abs(np.subtract.outer(np.arange(len(t)), np.arange(len(t))))
    smooth = [v * np.exp(-0.5 * (apart / s) ** 2) for s in times for v in TRACKING.remainders]
    values, variances = [], []
    for correlation in TRACKING.correlations:
        covariance = np.power(correlation, lags) + np.stack(smooth)
        L = np.linalg.cholesky(covariance + 1e-9 * np.eye(len(t)))
        variance = (np.linalg.solve(L, residual) ** 2).mean(axis=(1, 2))
        log_det = 2 * np.log(np.diagonal(L, axis1=1, axis2=2)).sum(axis=1)
        minus2log = residual.size * np.log(variance) + residual.shape[1] * log_det
        best = int(np.argmin(minus2log))
        values.append(minus2log[best])
        variances.append(variance[best])
    return np.array(values), np.array(variances)
