"""Rows that wait in the queue of a saturated link: their delay varies within a recording.

A logger sends a row whenever an encoder counts, and the row is stamped when it arrives. While the rods move fast, there
are more changes than the link carries: the queue is full, the logger waits for room before it reads the next count, and
successive rows differ by several counts. All these rows have the same delay, that of the full queue,

    D = (B + b) / r,    B bytes in the queue, b of the row, r bytes per second.

Near a turning point the rods count slowly and the queue drains while no row is written. After it, each single count is
a row until the queue is full again. These rows arrive at the even intervals of the link, as if the speed were constant,
with a delay between that of an empty and that of a full queue. Therefore

    a row that differs from the one before by several counts     has the delay D,
    a row in a series of single counts                           has an unknown delay up to D.

Rows of an even sampling rate are never so: at a turning point, a reading that changes by one count per row before
and after it is repeated in between.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class QueueSettings:
    """Limits of the test for rows that wait in a queue."""

    series: int = 4
    """Successive single counts after a turning point from which rows wait in a queue. With an even sampling rate,
    the constant acceleration there allows three.
    """
    turns: int = 2
    """Minimum number of turning points with such a series."""
    most_turns: float = 0.5
    """Minimum fraction of the turning points with such a series: noise of the readings reverses their changes too."""
    excluded: int = 2
    """Successive single counts for which the queue need not be full."""
    repeats: float = 0.01
    """Maximum fraction of rows that repeat the one before, outside of pauses."""
    full: float = 0.5
    """Minimum fraction of the rows with a full queue: the others are excluded."""
    least: float = 1.0
    """Minimum deviation of a series in time from the motion around it, in median intervals of the rows: stamps that
    were taken with the readings deviate by nothing.
    """
    on_grid: float = 0.02
    """Maximum deviation of a change from whole counts, in counts."""
    span: float = 1.5
    """Rows on either side of a series, relative to its length, whose polynomial measures its delay."""
    degree: int = 4
    """Degree of that polynomial."""
    grid: int = 1000
    """Number of instants at which the polynomial is compared with the readings."""


QUEUE = QueueSettings()


@dataclass(frozen=True, slots=True)
class QueuedRows:
    """Rows that were sent while the queue was not full."""

    rows: Flags
    """(n,) whether a row is one of them."""
    series: int
    """Number of series of such rows that follow a turning point."""
    differ_s: float
    """Difference of their delay from that of the full queue after turning points, s: a median."""

    @property
    def evidence(self) -> str:
        """Evidence of the finding, and what to do."""
        return (
            f"a row is sent for each count, over a saturated link: after {self.series} turning points the rows arrive"
            " at even intervals, one count each, with a delay that differs from that of the other rows by"
            f" {1e3 * self.differ_s:.2g} ms (median). These {self.rows.sum()} readings are excluded. Increase the baud"
            " rate, or send the time of the board with each row"
        )


def queued_rows(t: Array, joints: Array) -> QueuedRows | None:
    """Rows with an unknown delay after turning points; None if the rows are not sent at each change over a full link.

    Args:
        t: (n,) stamps, s
        joints: (n, m) angles of the joints with an encoder, rad
    """
    changes = _whole_changes(joints)
    if changes is None:
        return None
    counted = np.abs(changes).sum(axis=1)
    full = counted > 1
    if np.mean(counted == 0) > QUEUE.repeats or np.mean(full) < QUEUE.full:
        return None
    single = np.flatnonzero(np.diff(np.pad(~full, 1).astype(np.int8))).reshape(-1, 2)  # changes [first, last)
    turns = np.flatnonzero((changes[1:] * changes[:-1] < 0).any(axis=1)) + 1
    waited = [
        (turn, last)
        for first, last in single.tolist()
        for turn in turns[(turns >= first) & (turns + QUEUE.series <= last)][:1].tolist()
        if (changes[turn : turn + QUEUE.series] == changes[turn]).all()
    ]
    if len(waited) < max(QUEUE.turns, QUEUE.most_turns * len(turns)):
        return None
    rows = np.zeros(len(t), dtype=np.bool_)
    for first, last in single[np.diff(single, axis=1)[:, 0] >= QUEUE.excluded]:
        rows[first + 1 : last + 1] = True
    differ = float(np.median([_difference(t, joints, rows, slice(turn + 1, last + 1)) for turn, last in waited]))
    if differ < QUEUE.least * np.median(np.diff(t)):
        return None
    return QueuedRows(rows, len(waited), differ)


def _whole_changes(joints: Array) -> NDArray[np.int64] | None:
    """(n - 1, m) changes from row to row in units of the smallest one; None if they are not whole."""
    moved = np.diff(joints, axis=0)
    size = np.abs(moved)
    smallest = np.where(size > 0.0, size, np.inf).min(axis=0, initial=np.inf)
    changes = moved / smallest  # zero for a joint that does not move
    whole = np.rint(changes)
    if len(moved) <= 2 * QUEUE.series or np.abs(changes - whole).max() > QUEUE.on_grid:
        return None
    return whole.astype(np.int64)


def _difference(t: Array, joints: Array, rows: Flags, series: slice) -> float:
    """Median deviation of a series of rows in time, s, from the polynomial through the other rows around it."""
    length = series.stop - series.start
    around = np.arange(
        max(0, series.start - int(QUEUE.span * length)), min(len(t), series.stop + int(QUEUE.span * length))
    )
    known = around[~rows[around]]
    if len(known) <= QUEUE.degree or not (known[0] < series.start < known[-1]):
        return 0.0
    grid = np.linspace(t[known[0]], t[known[-1]], QUEUE.grid)
    largest = 0.0
    for angle in joints.T:
        smooth = np.polynomial.Polynomial.fit(t[known], angle[known], QUEUE.degree)
        moved = angle[series][-1] - angle[series][0]
        same_way = grid[smooth.deriv()(grid) * moved > 0.0]
        if moved != 0.0 and len(same_way):
            nearest = np.abs(smooth(same_way) - angle[series][:, None]).argmin(axis=1)
            largest = max(largest, float(np.median(np.abs(t[series] - same_way[nearest]))))
    return largest
