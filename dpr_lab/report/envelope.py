"""Reduce curves for drawing, mark interruptions, and compute axis ranges."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.arrays import Array

POINTS = 2400
"""Maximum number of points per line; about four per pixel column of a panel."""


def trace(t: Array, y: Array, points: int = POINTS) -> tuple[Array, Array]:
    """Reduce a record for drawing, and mark interruptions by NaN.

    A record with more than `points` samples is divided into `points` / 2 blocks of equal length. The smallest and the
    largest sample of each block are kept with their times, so that no peak is lost.

    Args:
        t: (n,) increasing times, s
        y: (n,) values; missing values are NaN
        points: approximate maximum number of points

    Returns:
        Instants and values to draw. They equal the input if n <= `points` and no sample is missing.
    """
    points_kept = _extremes(y, points)
    breaks = _interruptions(t)
    middle = (t[breaks] + t[breaks + 1]) / 2
    positions = np.searchsorted(points_kept, breaks, side="right")
    return np.insert(t[points_kept], positions, middle), np.insert(y[points_kept], positions, np.nan)


def _extremes(y: Array, points: int) -> NDArray[np.intp]:
    """Return the indices of the first and last sample, and of the smallest and largest sample of each block."""
    n = len(y)
    if n <= points:
        return np.arange(n)
    width = -(-n // (points // 2))
    padded = np.pad(y, (0, -n % width), constant_values=np.nan).reshape(-1, width)
    first = np.arange(len(padded)) * width
    missing = np.isnan(padded)
    lowest = first + np.where(missing, np.inf, padded).argmin(axis=1)
    highest = first + np.where(missing, -np.inf, padded).argmax(axis=1)
    return np.unique(np.concatenate([[0, n - 1], lowest, highest]))


def _interruptions(t: Array, steps: float = 10.0) -> NDArray[np.intp]:
    """Return the index of the last sample before each interval that is longer than `steps` median intervals."""
    if len(t) < 3:
        return np.empty(0, dtype=np.intp)
    intervals = np.diff(t)
    return np.flatnonzero(intervals > steps * np.median(intervals))


def signal_scale(value: Array, half_width: Array) -> tuple[tuple[float, float], bool]:
    """Compute the axis range for a curve with its intervals, and whether the range clips an interval.

    The range contains all intervals whose half width is at most three times the median, except that the curve itself
    must cover at least a quarter of the range.

    Args:
        value: (n,) the curve
        half_width: (n,) half width of the interval of the curve; it is large where few samples were recorded
    """
    finite = np.isfinite(value) & np.isfinite(half_width)
    value, half_width = value[finite], half_width[finite]
    if not len(value):
        return (-1.0, 1.0), False
    lower, upper = value - half_width, value + half_width
    typical = half_width <= 3 * np.median(half_width)
    low, high = min(float(lower[typical].min()), 0.0), max(float(upper[typical].max()), 0.0)
    least, most = min(float(value.min()), 0.0), max(float(value.max()), 0.0)
    excess = 1.5 * (most - least) or np.inf
    low, high = max(low, least - excess), min(high, most + excess)
    margin = 0.05 * (high - low) or 1.0
    return (low - margin, high + margin), bool(((lower < low) | (upper > high)).any())
