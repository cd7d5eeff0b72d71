"""Noise of a smooth signal from high-order differences: its level, its growth with speed, its colour."""

import math

import numpy as np
from numpy.typing import NDArray

ORDER = 6
BINS = 12
_GAIN = math.sqrt(math.comb(2 * ORDER, ORDER))  # of the sixth difference on white noise
_MAD = 1.482602218505602


def sixth(values: NDArray[np.float64], stride: int = 1) -> NDArray[np.float64]:
    """Sixth differences of every `stride`-th value, at unit gain on white noise; degree 5 gives zero."""
    return np.diff(values[::stride], ORDER, axis=0) / _GAIN


def spread(values: NDArray[np.float64]) -> float:
    """Standard deviation of normal values, from their median size: blind to a few outliers."""
    return float(_MAD * np.median(np.abs(values)))


def stride_ratio(values: NDArray[np.float64]) -> float:
    """Noise of every third sample over noise of neighbours; 1 for white noise, more where a filter smoothed it."""
    near, far = spread(sixth(values)), min(spread(sixth(values[k:], 3)) for k in range(3))
    return far / near if near > 0 else 1.0


def noise_by_speed(
    t: NDArray[np.float64], joints: NDArray[np.float64], floor: NDArray[np.float64], period: float
) -> tuple[float, float]:
    """Timing error s of sigma^2 = sigma_0^2 + (s omega)^2, and how many standard errors s^2 is from zero.

    Args:
        t: (n,) instants, s
        joints: (n, 2) angles, rad
        floor: (2,) standard deviation at rest, below which slow stretches of a coarse encoder only seem to be, rad
        period: nominal time between samples, s; neighbourhoods with a gap are left out

    Returns:
        s (s), and the significance
    """
    if len(t) < 40 * BINS:
        return 0.0, 0.0
    whole = np.abs(t[ORDER:] - t[:-ORDER] - ORDER * period) < 0.25 * period
    speed = (joints[ORDER:] - joints[:-ORDER]) / (ORDER * period)
    found, weights = [], []
    for axis in range(joints.shape[1]):
        slope, error = _growth(speed[whole, axis] ** 2, sixth(joints[:, axis])[whole], floor[axis])
        found.append(slope)
        weights.append(1 / error**2)
    if not any(weights):
        return 0.0, 0.0
    slope, error = np.average(found, weights=weights), 1 / math.sqrt(sum(weights))
    return math.sqrt(max(slope, 0.0)), float(slope / error)


def _growth(speed2: NDArray[np.float64], residual: NDArray[np.float64], floor: float) -> tuple[float, float]:
    """Slope of the variance of `residual` over `speed2`, and its standard error, from medians in bins of speed."""
    if len(residual) < 40 * BINS:
        return 0.0, math.inf
    groups = np.array_split(np.argsort(speed2), BINS)
    x = np.array([speed2[group].mean() for group in groups])
    y = np.array([max(spread(residual[group]), floor) ** 2 for group in groups])
    if y.max() == 0.0:
        return 0.0, math.inf
    # Overlapping differences count for a quarter as many independent ones, each of relative variance 2.7.
    error = np.maximum(y, 0.1 * y.max()) * np.sqrt(2.7 * 4 / (len(residual) / BINS))
    weights = 1 / error
    A = np.stack([np.ones(BINS), x], axis=1) * weights[:, None]
    covariance = np.linalg.pinv(A.T @ A)
    slope = (covariance @ A.T @ (y * weights))[1]
    return float(slope), float(np.sqrt(covariance[1, 1]))
