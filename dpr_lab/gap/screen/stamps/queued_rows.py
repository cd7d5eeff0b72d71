"""Rows that wait in the queue of a saturated link, with a varying delay.

A logger sends a row whenever an encoder counts, and the row is stamped when it arrives. While the rods move fast, there
are more changes than the link can transmit. The queue is then full, the logger waits for room before it reads the next
count, and successive rows differ by several counts. All these rows have the same delay, that of the full queue,

    D = (B + b) / r,    B bytes in the queue, b bytes per row, r bytes per second.

Near a turning point the counts change slowly, and the queue drains while no row is written. Afterwards, each single
count is a row until the queue is full again. These rows arrive at the even intervals of the link, as if the speed were
constant. Their delay lies between that of an empty and that of a full queue. Therefore

    a row that differs from the previous one by several counts   has the delay D,
    a row in a series of single counts                           has an unknown delay up to D.

Rows sampled at an even rate do not show this pattern: a reading that changes by one count per row around a turning
point repeats at the turning point.
"""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.estimation.counted_rows import whole_changes


@dataclass(frozen=True, slots=True)
class QueueSettings:
    """Limits of the test for rows that wait in a queue."""

    series: int = 4
    """Minimum number of successive single counts after a turning point that indicates a queue.

    With an even sampling rate there are at most three, because the acceleration is nearly constant there.
    """
    turns: int = 2
    """Minimum number of turning points that are followed by a series of single counts."""
    share_of_turns: float = 0.5
    """Minimum fraction of turning points that are followed by a series.

    Noise of the readings causes further turning points.
    """
    excluded: int = 2
    """Minimum number of successive single counts whose rows are excluded: the queue may not be full."""
    repeats: float = 0.01
    """Maximum fraction of rows that repeat the previous row; a logger that writes a row per count repeats none."""
    full: float = 0.5
    """Minimum fraction of the rows with a full queue; the other rows are excluded."""
    least: float = 1.0
    """Minimum time by which a series deviates from the motion around it, in median intervals of the rows.

    If each row is stamped when it is read, the deviation is zero.
    """
    span: float = 1.5
    """Number of rows on either side of a series to which a polynomial is fitted, divided by the length of the
    series."""
    degree: int = 4
    """Degree of the polynomial from which the delay of a series is measured."""
    grid: int = 1000
    """Number of instants at which the polynomial is compared with the readings."""


QUEUE = QueueSettings()


@dataclass(frozen=True, slots=True)
class QueuedRows:
    """Rows of a saturated link that were sent while its queue was not full, and the evidence for this queue."""

    rows: Flags
    """(n,) mask of rows that were sent while the queue was not full."""
    series: int
    """Number of series of successive single counts after turning points."""
    differ_s: float
    """Median difference between the delay of the rows and the delay of a full queue, s."""

    @property
    def evidence(self) -> str:
        """Sentence that states the evidence of the finding and the remedy."""
        return (
            f"a row is sent for each count over a saturated link: after {self.series} turning points the rows arrive at"
            " even intervals, one count each. The delay of these rows differs from the delay of the other rows by"
            f" {1e3 * self.differ_s:.2g} ms (median). These {self.rows.sum()} readings are excluded."
            " Increase the baud rate, or send the time of the board with each row"
        )


def queued_rows(t: Array, joints: Array) -> QueuedRows | None:
    """Return the rows with an unknown delay on a saturated link, or None.

    Args:
        t: (n,) stamps, s
        joints: (n, m) angles of the joints with an encoder, rad
    """
    changes = whole_changes(joints)
    if changes is None:
        return None
    counted = np.abs(changes).sum(axis=1)
    full = counted > 1
    if np.mean(counted == 0) > QUEUE.repeats or np.mean(full) < QUEUE.full:
        return None
    # each row is an interval [first, last) of changes
    single = np.flatnonzero(np.diff(np.pad(~full, 1).astype(np.int8))).reshape(-1, 2)
    turns = np.flatnonzero((changes[1:] * changes[:-1] < 0).any(axis=1)) + 1
    waited = [
        (turn, last)
        for first, last in single.tolist()
        for turn in turns[(turns >= first) & (turns + QUEUE.series <= last)][:1].tolist()
        if (changes[turn : turn + QUEUE.series] == changes[turn]).all()
    ]
    if len(waited) < max(QUEUE.turns, QUEUE.share_of_turns * len(turns)):
        return None
    rows = np.zeros(len(t), dtype=np.bool_)
    for first, last in single[np.diff(single, axis=1)[:, 0] >= QUEUE.excluded]:
        rows[first + 1 : last + 1] = True
    differ = float(np.median([_difference(t, joints, rows, slice(turn + 1, last + 1)) for turn, last in waited]))
    if differ < QUEUE.least * np.median(np.diff(t)):
        return None
    return QueuedRows(rows, len(waited), differ)


def _difference(t: Array, joints: Array, rows: Flags, series: slice) -> float:
    """Return the median deviation, s, of a series of rows from a polynomial through its neighbours."""
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
        displacement = angle[series][-1] - angle[series][0]
        same_way = grid[smooth.deriv()(grid) * displacement > 0.0]
        if displacement != 0.0 and len(same_way):
            nearest = np.abs(smooth(same_way) - angle[series][:, None]).argmin(axis=1)
            largest = max(largest, float(np.median(np.abs(t[series] - same_way[nearest]))))
    return largest
