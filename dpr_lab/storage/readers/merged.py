"""Remove the rows of a table that contain only other quantities than angles.

Some loggers write a row for each message: it contains the values of one quantity, and the other fields are empty.
"""

from collections.abc import Sequence

import numpy as np

from dpr_lab.errors import RunError
from dpr_lab.storage.tables.table import Table


def rows_of_angles(table: Table, angles: Sequence[str]) -> Table:
    """Remove the rows that a logger wrote only for quantities other than angles.

    A row without an angle is kept in two cases. Either it is empty, or its quantities also occur in most rows with an
    angle, so that the angle was lost.

    Args:
        table: the table
        angles: names of the columns of the angles

    Raises:
        RunError: no row contains all angles, although each angle has values.
    """
    known = {name: np.isfinite(column) for name, column in table.named}
    present = np.stack([known[name] for name in angles])
    measured = present.any(axis=0)
    if present.any(axis=1).all() and not present.all(axis=0).any():
        raise RunError(
            f"{table.path}: no row contains {' and '.join(angles)}: the logger writes them in separate rows."
            " Interpolate them to the same times"
        )
    often = np.count_nonzero(measured) / 2
    others = [rows for name, rows in known.items() if name not in angles and np.count_nonzero(rows & measured) <= often]
    remaining = measured | ~np.logical_or.reduce([np.zeros_like(measured), *others])
    removed = int(np.count_nonzero(~remaining))
    if removed in (0, len(remaining)):
        return table
    return table.rows(remaining, f"rows that contain only other quantities than the angles, removed: {removed}")
