"""Unwrap times from a counter that wraps, such as a 32-bit counter of microseconds."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import RunError
from dpr_lab.storage.tables.columns import TO_SECONDS
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
    first: float = 1.5
    """Maximum value after a wrap, in steps from row to row."""
    reach: int = 6
    """Number of rows before and after a decrease of the time column. The steps of the reading between these rows are
    compared with its step across the decrease."""
    jump: float = 2.0
    """Maximum step of a reading across a wrap, relative to the largest other step nearby."""


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
            f"{name}: spans {span:.10g}, which is more than the given period of its counter, {wrap:.10g} (--time-wrap)"
        )
    falls = np.diff(times[known], prepend=times[known[:1]]) < -wrap / 2
    grown = times.copy()
    grown[known] += wrap * np.cumsum(falls)
    return grown


def wrap_behind(before: float, after: float, step: float = 0.0, continues: bool = False) -> float | None:
    """Return the width of the counter that wrapped between two values, or None.

    Args:
        before: last value before the decrease
        after: next value
        step: usual difference between successive values
        continues: whether the readings continue smoothly across the decrease; the counter may then have any width
    """
    widths = sorted(2.0**bits / ticks for bits in SETTINGS.bits for ticks in SETTINGS.ticks)
    within = [width for width in widths if 0 <= after <= before < width]
    drop = before - after
    known = next((width for width in within if abs(drop - width) < SETTINGS.slack * width), None)
    if known is not None or not continues or not 0 <= after <= SETTINGS.first * step or not before > 2 * step:
        return known
    width = drop + step
    near = [other for other in (*within, *_round(width), 2.0 ** round(np.log2(width))) if other > before]
    return min((other for other in near if abs(other - width) < step / 2), key=lambda x: abs(x - width), default=width)


def continues_across(row: int, columns: Iterable[Array]) -> bool:
    """Check whether the clock wrapped at a row.

    The clock wrapped if the readings move, and continue across the decrease of the time as between adjacent rows.

    Args:
        row: index of the first row after the decrease
        columns: (n,) readings
    """
    reach = SETTINGS.reach
    around = [np.abs(np.diff(column[max(row - reach, 0) : row + reach])) for column in columns]
    last = min(row, reach) - 1
    others = [np.delete(steps, last) for steps in around]
    moved = [float(np.max(other, initial=0.0)) for other in others]
    return max(moved, default=0.0) > 0 and all(
        steps[last] <= SETTINGS.jump * most for steps, most in zip(around, moved, strict=True)
    )


def _round(width: float) -> list[float]:
    """Return numbers of one to four digits near a width."""
    return [float(f"{width:.{digits}g}") for digits in range(1, 5)]


def check_forwards(table: Table, t: Array, options: ImportOptions, readings: Mapping[str, Array]) -> None:
    """Check that the times of a table never decrease.

    Raises:
        RunError: they decrease; the message proposes `--time-wrap` if the cause is a counter that wraps.
    """
    known = np.flatnonzero(np.isfinite(t))
    backwards = np.flatnonzero(np.diff(t[known]) < 0)
    if len(backwards):
        row, before = known[backwards[0] + 1], known[backwards[0]]
        place = f"{table.path}: {_line(table, int(row))}"
        unit = TO_SECONDS[options.time_unit or "s"]
        step = float(np.median(np.abs(np.diff(t[known]))))
        continues = continues_across(int(backwards[0]) + 1, (column[known] for column in readings.values()))
        wrap = wrap_behind(float(t[before]) / unit, float(t[row]) / unit, step / unit, continues)
        if wrap is not None:
            raise RunError(
                f"{place}: time decreases by {t[before] - t[row]:g} s, like a wrapping counter: import with"
                f" --time-wrap {wrap:.10g}"
            )
        if len(backwards) == len(known) - 1:
            raise RunError(f"{place}: time decreases in all rows: sort the rows by time")
        if 2 * np.count_nonzero(np.diff(t[known]) <= 0) >= len(known) - 1 and np.ptp(t[known]) < np.median(t[known]):
            raise RunError(
                f"{place}: the time column contains values near {np.median(t[known]) / unit:g}, which are probably the"
                " durations of the rows, not times: state the rate of the rows (--rate-hz) instead"
            )
        raise RunError(
            f"{place}: time decreases by {t[before] - t[row]:g} s, to {t[row]:.10g} s; split the table there, because"
            f" each recording is a separate run"
        )


def _line(table: Table, row: int) -> str:
    return f"{'line' if table.heading or table.kind == 'text table' else 'row'} {table.lines[row]}"
