"""Noise of a smooth signal from high-order differences: its level, its growth with speed, its colour."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from dpr_lab.estimation.noise import ORDER, difference_weights
from dpr_lab.fitting.spread import NORMAL_MAD

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SpeedNoiseSettings:
    """How growth of noise with speed is tested: noise level in bins of speed, a straight line through the squares."""

    bins: int = 12
    """Bins of equally many readings, by speed."""
    fewest: int = 40
    """Readings in a bin; with fewer no growth is tested."""
    uneven: float = 0.9
    """Deviation of the time between two readings of a neighbourhood up to which it counts, in sampling periods."""
    overlap: float = 4.0
    """Overlapping differences for one independent one."""
    relative_variance: float = 2.7
    """Of a bin's level: one over the efficiency, 0.37, of a median deviation on normal values."""
    least_level: float = 0.1
    """Share of the highest bin's square below which a bin is not taken to be known better."""


SPEED_NOISE = SpeedNoiseSettings()


def sixth(values: Array, stride: int = 1) -> Array:
    """Sixth differences of every `stride`-th value, at unit gain on white noise; degree 5 gives zero."""
    return np.diff(values[::stride], ORDER, axis=0) / math.sqrt(math.comb(2 * ORDER, ORDER))


def tamed_rms(values: Array, wildest: float = 8.0) -> float:
    """Root mean square; single wild values count for so many robust deviations only."""
    most = wildest * spread(values)
    return float(np.sqrt(np.mean(np.minimum(np.abs(values), most) ** 2)))


def spread(values: Array) -> float:
    """Standard deviation of normal values, from their median size: blind to a few outliers."""
    return float(NORMAL_MAD * np.median(np.abs(values)))


def stride_ratio(values: Array) -> float:
    """Noise of every third sample over noise of neighbours; 1 for white noise, more where a filter smoothed it."""
    near, far = spread(sixth(values)), min(spread(sixth(values[k:], 3)) for k in range(3))
    return far / near if near > 0 else 1.0


def noise_by_speed(
    t: Array,
    joints: Array,
    floor: Array,
    period: float,
    keep: NDArray[np.bool_] | None = None,
    settings: SpeedNoiseSettings = SPEED_NOISE,
) -> tuple[float, float]:
    """Timing error s of sigma^2 = sigma_0^2 + (s omega)^2, and how many standard errors s^2 is from zero.

    Args:
        t: (n,) instants, s
        joints: (n, 2) angles, rad
        floor: (2,) standard deviation at rest, below which slow stretches of a coarse encoder only seem to be, rad
        period: nominal time between samples, s; neighbourhoods with a gap are left out
        keep: (n, 2) readings without a fault: with them the level is a root mean square, which late stamps raise that
            are rare and large; without, it is that of the usual reading
        settings: bins of speed, and what they say

    Returns:
        s (s), and the significance
    """
    if len(t) < settings.fewest * settings.bins:
        return 0.0, 0.0
    windows, angles = sliding_window_view(t, ORDER + 1), sliding_window_view(joints, ORDER + 1, axis=0)
    whole = np.abs(np.diff(windows, axis=1) - period).max(axis=1) < settings.uneven * period
    speed2 = ((joints[ORDER:] - joints[:-ORDER]) / np.ptp(windows, axis=1)[:, None]) ** 2
    residual = np.einsum("wmj,wj->wm", angles, difference_weights(windows, period))
    level = spread
    if keep is not None:
        whole &= sliding_window_view(keep.all(axis=1), ORDER + 1).all(axis=1)
        level = tamed_rms
    lines = [_line(speed2[whole, axis], residual[whole, axis], floor[axis], level, settings) for axis in range(2)]
    weights = [1 / error**2 for _, error in lines]
    if not any(weights):
        return 0.0, 0.0
    slope, error = np.average([slope for slope, _ in lines], weights=weights), 1 / math.sqrt(sum(weights))
    return math.sqrt(max(slope, 0.0)), float(slope / error)


def _line(
    speed2: Array, residual: Array, floor: float, level: Callable[[Array], float], settings: SpeedNoiseSettings
) -> tuple[float, float]:
    """Slope of the variance of `residual` over `speed2`, and its standard error, from levels in bins of speed."""
    in_bin = len(residual) / settings.bins
    if in_bin < settings.fewest:
        return 0.0, math.inf
    groups = np.array_split(np.argsort(speed2), settings.bins)
    x = np.array([speed2[group].mean() for group in groups])
    y = np.array([max(level(residual[group]), floor) ** 2 for group in groups])
    if y.max() == 0.0 or x.max() == 0.0:
        return 0.0, math.inf
    relative = np.sqrt(settings.relative_variance * settings.overlap / in_bin)
    weights = 1 / (np.maximum(y, settings.least_level * y.max()) * relative)
    A = np.stack([np.ones(settings.bins), x], axis=1) * weights[:, None]
    covariance = np.linalg.pinv(A.T @ A)
    slope = (covariance @ A.T @ (y * weights))[1]
    return float(slope), float(np.sqrt(covariance[1, 1]))
