"""Times with too few digits, as of a spreadsheet that shows three: several rows share one time.

If the rows are evenly spaced, their number determines the times: t_i = t_0 + i T, and each written time differs from
t_i by less than its resolution q. Rows of an uneven logger, or lost rows, violate this.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class RoundingSettings:
    """Limits from which rows of equal time are evenly spaced rows with rounded times."""

    shared: float = 0.1
    """Minimum share of rows with the time of the row before but other readings."""
    slack: float = 1.2
    """Maximum range of the deviations from an even spacing, in units of the resolution; exact arithmetic gives 1."""
    times: int = 10
    """Minimum number of different times."""


SETTINGS = RoundingSettings()


def shares_times(t: Array, readings: Mapping[str, Array]) -> NDArray[np.bool_]:
    """(n - 1,) whether a row has the time of the previous row but different readings."""
    changed = np.logical_or.reduce([np.diff(column) != 0 for column in readings.values()])
    return np.asarray(changed & (np.diff(t) == 0))


def even_times(t: Array, readings: Mapping[str, Array]) -> tuple[Array, str]:
    """Times of evenly spaced rows whose written times are rounded, and a note; other times are returned unchanged.

    Args:
        t: (n,) s, not decreasing
        readings: (n,) of each axis
    """
    steps = np.diff(t)
    known = bool(np.isfinite(t).all())
    if not known or shares_times(t, readings).sum() <= SETTINGS.shared * len(t):
        return t, ""
    if np.count_nonzero(steps) < SETTINGS.times:
        return t, ""
    rows = np.arange(len(t), dtype=np.float64)
    spacing, first = np.polyfit(rows, t, 1).tolist()
    resolution = float(steps[steps > 0].min())
    if np.ptp(t - spacing * rows) > SETTINGS.slack * resolution:
        return t, ""
    note = (
        f"several rows share one time: its resolution is {resolution:g} s. The rows are evenly spaced to within it, at"
        f" {1 / spacing:.5g} Hz, so their number determines the times"
    )
    return first + spacing * rows, note
