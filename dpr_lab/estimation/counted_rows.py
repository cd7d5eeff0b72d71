"""Tables with one row per encoder count, whose angles are exact.

An encoder counts at the edge between two counts n and n + 1. The row is sent with the new count. At this instant the
rod is at the lower end of count n + 1 if it moves up, and at the upper end of count n if it moves down:

    theta = (theta_before + theta_read) / 2

Here theta_read is the reading of the row and theta_before the reading of the previous row. The angle of an edge has no
rounding error. In contrast, the count itself has an error of half a count. The sign of this error depends on the
direction of motion, like the torque of dry friction. The readings of the other encoders are equal in both rows, so the
mean does not change them.
"""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Integers


@dataclass(frozen=True, slots=True)
class CountedRowSettings:
    """Limits for the detection of tables with one row per count."""

    fewest: int = 8
    """Minimum number of changes from row to row."""
    others: float = 0.01
    """Maximum fraction of rows that do not differ by one count from the previous row, because rows were lost."""
    exact: float = 1e-4
    """Maximum change of a reading whose encoder did not count, relative to the largest change.

    The change is not exactly zero, because differences of angles are rounded.
    """
    on_grid: float = 0.02
    """Maximum deviation of a change from an integer number of counts, in counts."""


SETTINGS = CountedRowSettings()


def edge_rows(angles: Array) -> Integers | None:
    """Return the indices of the rows that an encoder sent when it counted.

    These rows differ by one count from the previous row. The result is None if the table does not have one row per
    count: rows sampled at an even rate repeat a reading at turning points, and skip counts when the rods move fast. The
    first row is left out, and so is a row that differs by more than one count, because a row before it was lost.

    Args:
        angles: (n, m) readings of the encoders, in any unit
    """
    changes = whole_changes(angles)
    if changes is None:
        return None
    single = np.abs(changes).sum(axis=1) == 1
    return np.flatnonzero(single) + 1 if np.mean(~single) <= SETTINGS.others else None


def whole_changes(angles: Array) -> Integers | None:
    """Return the (n - 1, m) changes between rows, in units of the smallest change.

    The result is None if these changes are not integers.

    Args:
        angles: (n, m) readings of the encoders, in any unit
    """
    moved = np.diff(angles, axis=0)
    size = np.abs(moved)
    smallest = np.where(size > SETTINGS.exact * size.max(axis=0, initial=0.0), size, np.inf).min(axis=0, initial=np.inf)
    changes = moved / smallest  # zero for a joint that does not move
    whole = np.rint(changes)
    if len(moved) <= SETTINGS.fewest or np.abs(changes - whole).max() > SETTINGS.on_grid:
        return None
    return whole.astype(np.int64)
