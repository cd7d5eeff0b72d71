"""Find rows that repeat a reading, because the logger writes faster than it reads.

Two kinds of loggers write most readings several times:

    held     rows at an even rate, each with the last reading; a camera or a bus updates the reading every few rows
    bursts   several rows within a moment, then no row until the next burst

In both cases a repeated reading is used once. A slowly moving encoder also repeats its readings, but the changes before
and after these rows are then of the order of one count.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.arrays import Array, Flags
from dpr_lab.estimation.counted_rows import edge_rows
from dpr_lab.shown import percent


@dataclass(frozen=True, slots=True)
class RepeatSettings:
    """Limits for the detection of rows that repeat a reading."""

    counts: float = 6.0
    """Minimum sum of the changes before and after a held reading, in units of the smallest change.

    If an encoder turns by less than a count per row, its readings change by at most three counts.
    """
    share: float = 0.2
    """Minimum fraction of rows with held readings for which all repeated rows are removed.

    Smaller fractions are left to the sensor screening of the diagnosis.
    """
    apart: float = 10.0
    """Minimum ratio of the time between bursts to the time between the rows of a burst."""
    even: float = 0.2
    """Maximum relative deviation of the times between bursts from their median, at both quartiles."""
    lasting: float = 0.2
    """Maximum median duration of a burst, in units of the time between bursts.

    Longer bursts consist of new readings, recorded by a logger that pauses regularly.
    """
    rows: float = 2.0
    """Minimum mean number of rows of a burst."""
    bursts: int = 5
    """Minimum number of bursts."""


SETTINGS = RepeatSettings()


def new_readings(t: Array, columns: Sequence[Array]) -> tuple[NDArray[np.intp], str]:
    """Return the indices of the rows with a new reading, and a note on the other rows.

    The note is empty if all rows have a new reading.

    Args:
        t: (n,) increasing times, s
        columns: (n,) readings of each axis
    """
    if edge_rows(np.column_stack(columns)) is not None:  # the rods turn back while no row is sent
        return np.arange(len(t)), ""
    middle, bursts = _bursts(t)
    if bursts:
        note = (
            f"the rows arrive in {len(middle)} bursts of about {len(t) / len(middle):.0f} rows: one row of each"
            " burst is used"
        )
        return middle, note
    repeats = np.append(False, np.logical_and.reduce([np.diff(column) == 0 for column in columns]))
    if not _held(repeats, columns):
        return np.arange(len(t)), ""
    note = (
        f"{percent(float(repeats.mean()))} of the rows repeat the previous reading while the rods move, because the"
        " logger writes faster than it reads: these rows are removed"
    )
    return np.flatnonzero(~repeats), note


def _bursts(t: Array) -> tuple[NDArray[np.intp], bool]:
    """Return the middle row of each burst, and whether the rows come in bursts."""
    steps = np.diff(t)
    if len(steps) < SETTINGS.bursts * SETTINGS.rows:
        return np.arange(len(t)), False
    last = np.flatnonzero(steps > SETTINGS.apart * np.median(steps))
    if len(last) < SETTINGS.bursts or len(t) < SETTINGS.rows * (len(last) + 1):
        return np.arange(len(t)), False
    edges = np.array([0, *(last + 1), len(t)])
    middle = (edges[:-1] + edges[1:] - 1) // 2
    apart = np.diff(t[middle])
    low, usual, high = np.quantile(apart, [0.25, 0.5, 0.75])
    even = high - usual <= SETTINGS.even * usual and usual - low <= SETTINGS.even * usual
    short = np.median(t[edges[1:] - 1] - t[edges[:-1]]) <= SETTINGS.lasting * usual
    return middle, bool(even and short)


def _held(again: Flags, columns: Sequence[Array]) -> bool:
    """Return whether most repeated rows contain held readings.

    A held reading is followed by a large change in the direction of the motion. `again` is the mask of the repeated
    rows.
    """
    starts = np.flatnonzero(np.diff(again.astype(int), prepend=0) == 1) - 1
    ends = np.flatnonzero(np.diff(again.astype(int), append=0) == -1)
    inside = (starts > 0) & (ends < len(again) - 1)
    starts, ends = starts[inside], ends[inside]
    if SETTINGS.share * len(again) > again.sum() or not len(starts):
        return False
    held = np.zeros(len(starts), dtype=bool)
    for column in columns:
        changes = np.abs(np.diff(column))
        if changes.any():
            before, after = column[starts] - column[starts - 1], column[ends + 1] - column[ends]
            least = float(changes[changes > 0].min())
            held |= (before * after > 0) & (np.abs(before + after) > SETTINGS.counts * least)
    return float((ends - starts)[held].sum()) > SETTINGS.share * len(again)
