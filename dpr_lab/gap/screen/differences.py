"""Noise of a smooth signal from high-order differences: level, increase with speed, correlation."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dpr_lab.arrays import Array, Flags
from dpr_lab.estimation.noise import ORDER, difference_weights
from dpr_lab.fitting.uncompiled import NORMAL_MAD


@dataclass(frozen=True, slots=True)
class SpeedNoiseSettings:
    """Settings of the test for noise that increases with speed."""

    bins: int = 12
    """Number of speed bins, each with the same number of readings."""
    fewest: int = 40
    """Minimum number of readings in a speed bin; with fewer readings, the test is omitted."""
    uneven: float = 0.9
    """Maximum deviation of a sampling interval from the period, in periods; windows with a larger deviation are
    excluded."""
    overlap: float = 4.0
    """Number of overlapping differences per independent difference."""
    relative_variance: float = 2.7
    """Variance of the robust noise level of a bin, relative to the variance of its sample standard deviation.

    It is the inverse of the efficiency, 0.37, of the median absolute deviation for normal values.
    """
    least_level: float = 0.1
    """Lower limit of the squared level in the weight of a bin, relative to the largest squared level."""


SPEED_NOISE = SpeedNoiseSettings()


def sixth(values: Array, stride: int = 1) -> Array:
    """Return the sixth differences of every `stride`-th value, scaled to the variance of white noise.

    The differences of white noise have the variance of the noise; those of a polynomial of degree 5 are zero.
    """
    return np.diff(values[::stride], ORDER, axis=0) / math.sqrt(math.comb(2 * ORDER, ORDER))


def clipped_rms(values: Array, wildest: float = 8.0) -> float:
    """Return the root mean square of values clipped at `wildest` robust standard deviations."""
    most = wildest * spread(values)
    return float(np.sqrt(np.mean(np.minimum(np.abs(values), most) ** 2)))


def spread(values: Array) -> float:
    """Estimate the standard deviation of zero-mean normal values from their median absolute value."""
    return float(NORMAL_MAD * np.median(np.abs(values)))


def stride_ratio(values: Array, floor: float) -> float:
    """Return the noise estimated from every third sample, divided by that from neighbouring samples.

    The ratio is 1 for white noise and larger for smoothed readings. `floor` is a lower limit of the noise of
    neighbouring samples, rad, because the reading of a coarse encoder is constant between counts while the rod is slow.
    """
    adjacent, distant = spread(sixth(values)), min(spread(sixth(values[k:], 3)) for k in range(3))
    return distant / max(adjacent, floor) if adjacent > 0 else 1.0


def noise_by_speed(
    t: Array,
    joints: Array,
    floor: Array,
    period: float,
    keep: Flags | None = None,
) -> tuple[float, float]:
    """Estimate the timing error s in the noise model sigma^2 = sigma_0^2 + (s omega)^2.

    Args:
        t: (n,) times, s
        joints: (n, 2) angles, rad
        floor: (2,) lower limit of the noise level, rad: the standard deviation at rest
        period: nominal sampling interval, s; neighbourhoods with missing readings are excluded
        keep: (n, 2) mask of the readings without a fault. If given, the noise level is a root mean square, which
            includes rare large time-stamp errors; if None, it is a robust estimate

    Returns:
        the timing error, s, and the ratio of its square to the standard error of the square
    """
    if len(t) < SPEED_NOISE.fewest * SPEED_NOISE.bins:
        return 0.0, 0.0
    windows, angles = sliding_window_view(t, ORDER + 1), sliding_window_view(joints, ORDER + 1, axis=0)
    evenly_spaced = np.abs(np.diff(windows, axis=1) - period).max(axis=1) < SPEED_NOISE.uneven * period
    speed2 = ((joints[ORDER:] - joints[:-ORDER]) / np.ptp(windows, axis=1)[:, None]) ** 2
    residual = np.einsum("wmj,wj->wm", angles, difference_weights(windows, period))
    level = spread
    if keep is not None:
        evenly_spaced &= sliding_window_view(keep.all(axis=1), ORDER + 1).all(axis=1)
        level = clipped_rms
    lines = [_line(speed2[evenly_spaced, axis], residual[evenly_spaced, axis], floor[axis], level) for axis in range(2)]
    weights = [1 / error**2 for _, error in lines]
    if not any(weights):
        return 0.0, 0.0
    slope, error = np.average([slope for slope, _ in lines], weights=weights), 1 / math.sqrt(sum(weights))
    return math.sqrt(max(slope, 0.0)), float(slope / error)


def _line(speed2: Array, residual: Array, floor: float, level: Callable[[Array], float]) -> tuple[float, float]:
    """Regress the variance of `residual` on the squared speed `speed2`; return slope and standard error.

    The variance is that of bins of the speed; the function `level` estimates the standard deviation of a bin.
    """
    in_bin = len(residual) / SPEED_NOISE.bins
    if in_bin < SPEED_NOISE.fewest:
        return 0.0, math.inf
    groups = np.array_split(np.argsort(speed2), SPEED_NOISE.bins)
    x = np.array([speed2[group].mean() for group in groups])
    y = np.array([max(level(residual[group]), floor) ** 2 for group in groups])
    if y.max() == 0.0 or np.ptp(x) <= 1e-6 * x.max():  # also at rest
        return 0.0, math.inf
    relative = np.sqrt(SPEED_NOISE.relative_variance * SPEED_NOISE.overlap / in_bin)
    weights = 1 / (np.maximum(y, SPEED_NOISE.least_level * y.max()) * relative)
    (slope, _), covariance = np.polyfit(x, y, 1, w=weights, cov="unscaled")
    return float(slope), float(np.sqrt(covariance[0, 0]))
