"""Compute increasing times from a counter that wraps, such as 32 bits of microseconds, or from durations."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.errors import RunError
from dpr_lab.storage.tables.columns import TO_SECONDS, is_duration
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.storage.tables.table import Table


@dataclass(frozen=True, slots=True)
class CounterSettings:
    """Common widths of counters, and criteria that detect a wrap."""

    bits: tuple[int, ...] = (16, 24, 31, 32)
    ticks: tuple[float, ...] = (1.0, 1e3, 1e6)
    """Counts per unit of the time column: 1 if the column is the counter itself; 1e3 or 1e6 if a counter of
    milliseconds or microseconds was converted to larger units."""
    slack: float = 0.01
    """Maximum difference between the decrease at a wrap and the width of the counter, relative to the width. The
    difference is up to one interval between rows."""
    returns: float = 2.0
    """Minimum sum of all decreases in a column of durations, relative to the range of the values. For times that
    decrease once, the sum is at most 1."""
    falling: float = 0.25
    """Minimum share of decreases among the changes of durations. It is 1/2 for random durations, and small for times
    with a few wrong rows or for a counter that wraps."""


SETTINGS = CounterSettings()


def unwrapped_times(times: Array, wrap: float, name: str) -> Array:
    """Unwrap the times (n,) of a counter with the period `wrap`; NaN values are kept.

    `name` is the name of the column in error messages.

    Raises:
        RunError: the times span at least the given period, so that the period is wrong.
    """
    known = np.flatnonzero(np.isfinite(times))
    span = float(np.ptp(times[known])) if len(known) else 0.0
    if span >= wrap:
        raise RunError(
            f"{name}: spans {span:.10g}, which is more than the given period of its counter, {wrap:.10g}: correct"
            " --time-wrap"
        )
    falls = np.diff(times[known], prepend=times[known[:1]]) < -wrap / 2
    grown = times.copy()
    grown[known] += wrap * np.cumsum(falls)
    return grown


def wrap_behind(before: float, after: float) -> float | None:
    """Return the width of a common counter that can have wrapped between two successive values, or None."""
    widths = sorted(2.0**bits / ticks for bits in SETTINGS.bits for ticks in SETTINGS.ticks)
    within = (width for width in widths if 0 <= after <= before < width)
    return next((width for width in within if abs(before - after - width) < SETTINGS.slack * width), None)


def summed_durations(t: Array, name: str) -> tuple[Array, str]:
    """Replace the durations of rows by their sums; return the times (n,) and a note.

    Other times are not changed, and the note is then empty. Each duration ends at its row. NaN values are kept. `name`
    is the name of the column in the note.
    """
    known = np.flatnonzero(np.isfinite(t))
    values, later = t[known], t[known[1:]]  # the first duration may be 0
    steps = np.diff(later)
    spread = float(np.ptp(later)) if len(later) else 0.0
    returns = -steps[steps < 0].sum() > SETTINGS.returns * spread > 0
    durations = is_duration(name) or (returns and later.min() > 0 and spread <= np.median(later))
    growing = np.count_nonzero(steps < 0) < SETTINGS.falling * np.count_nonzero(steps)
    if not durations or growing or values.min(initial=0.0) < 0:
        return t, ""
    summed = t.copy()
    summed[known] = np.cumsum(values) - values[0]
    return summed, f"column {name} contains the durations of the rows; the time is their sum"


def check_forwards(table: Table, t: Array, options: ImportOptions) -> None:
    """Check that the times of a table never decrease.

    Raises:
        RunError: they decrease; the message proposes `--time-wrap` if the cause is a counter that wraps.
    """
    known = np.flatnonzero(np.isfinite(t))
    backwards = np.flatnonzero(np.diff(t[known]) < 0)
    if len(backwards):
        row, before = known[backwards[0] + 1], known[backwards[0]]
        place = f"{table.path}: {_lines(table, known[backwards[:1] + 1])}"
        decrease = f"time decreases by {t[before] - t[row]:g} s"
        unit = TO_SECONDS[options.time_unit or "s"]
        if (wrap := wrap_behind(float(t[before]) / unit, float(t[row]) / unit)) is not None:
            raise RunError(f"{place}: {decrease}, like a wrapping counter: import with --time-wrap {wrap:.10g}")
        if len(backwards) == len(known) - 1:
            raise RunError(f"{place}: time decreases in all rows: sort the rows by time")
        period = t[before] - t[row] + np.median(np.diff(t[known]))
        value = f" {period / unit:.6g}" if np.ptp(t[known]) < period else ""
        raise RunError(
            f"{place}: {decrease}, to {t[row]:.10g} s: split the table there if another recording begins, or correct or"
            " delete rows with a wrong time. If the same swing continues, give the period of its counter"
            f" (--time-wrap{value})"
        )


def _lines(table: Table, rows: Integers) -> str:
    kind = "line" if table.heading or table.kind == "text table" else "row"
    first, last = table.lines[rows[0]], table.lines[rows[-1]]
    return f"{kind} {first}" if first == last else f"{kind}s {first} to {last}"
