"""What of a curve is drawn: the extremes of a long record, no line across a gap, and not all of a wide interval."""

import numpy as np
from numpy.typing import NDArray

POINTS = 2400
"""Points drawn of one line of a figure; about four for each pixel column of a panel."""


def trace(
    t: NDArray[np.float64], y: NDArray[np.float64], points: int = POINTS, gap_steps: float = 10.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """A record as it is drawn: short ones untouched, long ones by their extremes, gaps as NaN.

    The record is cut into `points` / 2 stretches of equally many samples, and each gives its smallest and largest
    sample at the instant it was taken, so that no peak is lost and no value is invented.

    Args:
        t: (n,) increasing instants, s
        y: (n,) values; NaN where there is none
        points: about how many to draw at most
        gap_steps: a pause longer than so many median sample steps is drawn as a gap

    Returns:
        instants and values to draw; equal to the input when n <= `points` and nothing is missing
    """
    kept = _extremes(y, points)
    breaks = _gaps(t, gap_steps)
    middle = (t[breaks] + t[breaks + 1]) / 2
    where = np.searchsorted(kept, breaks, side="right")
    return np.insert(t[kept], where, middle), np.insert(y[kept], where, np.nan)


def _extremes(y: NDArray[np.float64], points: int) -> NDArray[np.intp]:
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


def _gaps(t: NDArray[np.float64], gap_steps: float) -> NDArray[np.intp]:
    """Indices of the last sample before each gap."""
    if len(t) < 3:
        return np.empty(0, dtype=np.intp)
    steps = np.diff(t)
    return np.flatnonzero(steps > gap_steps * np.median(steps))


def signal_scale(value: NDArray[np.float64], reach: NDArray[np.float64]) -> tuple[tuple[float, float], bool]:
    """The range of a curve and of its interval where that is as wide as it mostly is; whether part lies outside.

    The curve itself takes a quarter of the range at least.

    Args:
        value: (n,) the curve
        reach: (n,) half of its interval, which opens where little was recorded
    """
    finite = np.isfinite(value) & np.isfinite(reach)
    value, reach = value[finite], reach[finite]
    if not len(value):
        return (-1.0, 1.0), False
    known = reach <= 3 * np.median(reach)
    low, high = min(float((value - reach)[known].min()), 0.0), max(float((value + reach)[known].max()), 0.0)
    least, most = min(float(value.min()), 0.0), max(float(value.max()), 0.0)
    wide = 1.5 * (most - least) or np.inf
    low, high = max(low, least - wide), min(high, most + wide)
    room = 0.05 * (high - low) or 1.0
    return (low - room, high + room), bool(((value - reach < low) | (value + reach > high)).any())
