"""Correct four kinds of faulty time stamps.

Too few digits: several rows have the same time, for example in a spreadsheet that shows three digits. If the rows are
evenly spaced, their number determines the times t_i = t_0 + i T. Apart from a constant, each written time then differs
from t_i by at most half of the resolution of the times. Unevenly sampled or lost rows violate this condition.

One stamp for several rows: a clock is read once for several rows, or rows wait and are stamped together. The true times
of these rows are in the interruption after or before them.

Stamps at interruptions: a logger that pauses, for example while it writes to a card, may take the stamp of a row before
the pause and the reading of the row after the pause, or vice versa. The reading then continues the motion on the other
side of the interruption.

Full second in the wrong row: a stamp may be composed of two counters that are not read at one instant, for example the
second of a clock and the milliseconds of the processor. Rows between the changes of the two counters are then a second
early or late: 24.997, 24.002, 25.009.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Flags, correlation


@dataclass(frozen=True, slots=True)
class StampSettings:
    """Limits for detecting faulty time stamps."""

    shared: float = 0.1
    """Minimum share of rows with the time of the previous row but other readings, for times to count as rounded."""
    slack: float = 1.2
    """Maximum range of the deviations from even spacing, in units of the resolution of the times; 1 in exact
    arithmetic. The times have too few digits if their shortest step exceeds this multiple of the mean spacing."""
    times: int = 10
    """Minimum number of different times, for times to count as rounded."""
    digits: int = 6
    """Maximum number of significant digits of a rounded time."""
    spacing: float = 0.7
    """Minimum spacing of rows that are spread over an interruption, in units of the mean spacing. A row that is written
    twice has about 1/2 and real rows have about 1; the limit is their geometric mean."""
    gap_steps: float = 3.0
    """Minimum length of an interruption, in median steps. In a shorter one, the instants of both stamps are nearly
    equal."""
    fitted: int = 6
    """Number of rows before or after an interruption to which a parabola is fitted. The parabola predicts the reading
    next to the interruption."""
    usual: float = 0.95
    """Usual size of a prediction error: this quantile of the prediction errors elsewhere in the table."""
    elsewhere: int = 1000
    """Maximum number of rows, evenly spaced over the table, that determine the usual size of the prediction errors."""
    far: float = 1e3
    """Maximum distance of a predicted instant from the fitted rows, in units of the duration of these rows."""
    misfit: float = 4.0
    """Minimum prediction error for which a stamp is doubted, in units of the usual size, in at least one column."""
    carries: tuple[float, ...] = (1.0, 60.0)
    """Units, s, whose number and fraction may come from two counters, so that one of them may change a row too late."""
    carried_rows: int = 3
    """Maximum number of successive rows between the changes of the two counters."""
    carried_step: float = 10.0
    """Maximum step before and after a corrected row, in median steps. A longer step may be the start of a new
    recording."""
    fit: float = 2.0
    """Maximum prediction error with the stamp on the other side of the interruption, in units of the usual size, in
    every column."""
    speed_correlation: float = 0.9
    """Minimum correlation of the steps of an angle with its speed; it is 0.95 for exact speeds at six rows per
    period."""


SETTINGS = StampSettings()


def carried_times(t: Array) -> tuple[Array, str]:
    """Correct times that are a second or a minute off; return times and a note.

    A few rows are shifted by one unit if the time decreases without the shift, and if all steps around the rows have
    the usual size with the shift. Other times are not changed.

    Args:
        t: (n,) times, s; unknown times are NaN
    """
    known = np.flatnonzero(np.isfinite(t))
    steps = np.diff(t[known])
    if not (steps < 0).any():
        return t, ""
    longest = SETTINGS.carried_step * float(np.median(np.abs(steps)))
    corrected, moved = t.copy(), list[int]()
    for unit in SETTINGS.carries:
        if not 0 < longest < unit:
            continue
        for sign in (1.0, -1.0):  # the rows are early, or late
            starts = np.flatnonzero((steps + sign * unit >= 0) & (steps + sign * unit <= longest))
            ends = np.flatnonzero((steps - sign * unit >= 0) & (steps - sign * unit <= longest))
            for start in starts.tolist():
                end = next((int(row) for row in ends if 0 < row - start <= SETTINGS.carried_rows), None)
                if end is not None:
                    rows = known[start + 1 : end + 1]
                    corrected[rows] += sign * unit
                    moved.extend(rows.tolist())
    if not moved or (np.diff(corrected[known]) < 0).any():
        return t, ""
    first = min(moved)
    return corrected, (
        "time stamps are a whole second or minute early or late, because the logger reads seconds and fraction at"
        f" different instants: {len(moved)} corrected, the first from {t[first]:.10g} to {corrected[first]:.10g} s"
    )


def varies(column: Array) -> bool:
    """Check whether the values of a column differ."""
    known = column[np.isfinite(column)]
    return bool(len(known) and np.ptp(known) > 0.0)


def runs(column: Array) -> bool:
    """Check whether a column increases in nearly equal steps."""
    steps = np.diff(column)
    return bool(len(steps) and (steps > 0).all() and np.median(steps) > 0.5 * np.mean(steps))


def never_falls(column: Array) -> bool:
    """Check whether a column never decreases and its last value exceeds the first, as for a time."""
    steps = np.diff(column)
    return bool(len(steps) and (steps >= 0).all() and column[-1] > column[0])


def different_times(columns: Mapping[str, Array]) -> dict[str, int]:
    """Count the different values of each column (n,) that never decreases; missing values are ignored.

    Other columns are omitted. A time with too few digits has the same value in several rows.
    """
    known = {name: column[np.isfinite(column)] for name, column in columns.items()}
    return {name: np.unique(column).size for name, column in known.items() if never_falls(column)}


def shares_times(t: Array, readings: Mapping[str, Array]) -> Flags:
    """Return the (n - 1,) mask of rows with new readings but the previous time."""
    changed = np.logical_or.reduce([column[1:] != column[:-1] for column in readings.values()])
    return np.asarray(changed & (np.diff(t) == 0))


def even_times(t: Array, readings: Mapping[str, Array]) -> tuple[Array, str]:
    """Replace rounded times by evenly spaced ones; return times and a note.

    Other times are not changed.

    Args:
        t: (n,) times, s, not decreasing
        readings: (n,) readings of each axis
    """
    steps = np.diff(t)
    known = bool(np.isfinite(t).all())
    if not known or shares_times(t, readings).sum() <= SETTINGS.shared * len(t):
        return t, ""
    if np.count_nonzero(steps) < SETTINGS.times:
        return t, ""
    rows = np.arange(len(t), dtype=np.float64)
    for resolution in (np.full(len(t), steps[steps > 0].min()), _of_digits(t)):
        spacing, first = np.polyfit(rows, t, 1, w=1 / resolution).tolist()
        if np.ptp((t - first - spacing * rows) / resolution) <= SETTINGS.slack:
            note = (
                f"several rows share one time: its resolution is {resolution.max():g} s. Within this resolution the"
                f" rows are evenly spaced, at {1 / spacing:.5g} Hz, so the row number determines the times"
            )
            return first + spacing * rows, note
    return t, ""


def spread_times(t: Array, readings: Mapping[str, Array]) -> tuple[Array, str]:
    """Spread rows that share a time stamp evenly over the adjacent interruption; return times and a note.

    Only rows with new readings are spread. Rows are not spread if the interruption is too short for them, for example
    after a row that was written twice.

    Args:
        t: (n,) s, not decreasing
        readings: (n,) readings of each axis
    """
    shared = shares_times(t, readings)
    if not shared.any() or not np.isfinite(t).all():
        return t, ""
    usual = float(t[-1] - t[0]) / (len(t) - 1)
    steps = np.diff(t)
    if not (steps > 0).any() or steps[steps > 0].min() > SETTINGS.slack * usual:  # the times have too few digits
        return t, ""
    edges = np.flatnonzero(np.diff(t, prepend=-np.inf, append=np.inf))  # first row of each stamp, and the end
    spread, moved = t.copy(), 0
    for first, end in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
        rows = end - first
        if not shared[first : end - 1].any():
            continue
        before = t[first] - spread[first - 1] if first else 0.0
        after = t[end] - t[first] if end < len(t) else 0.0
        gap = max(before, after) / rows
        if gap >= SETTINGS.spacing * usual:
            places = np.arange(rows) if after >= before else np.arange(1 - rows, 1)
            spread[first:end] = t[first] + gap * places
            moved += rows - 1
    note = (
        f"{moved} rows next to an interruption have the time of the previous row but other readings: their times are"
        " spread evenly over the interruption"
    )
    return (spread, note) if moved else (t, "")


def _of_digits(t: Array) -> Array:
    """Compute the resolution (n,) of times, s.

    The times are assumed to be written with the fewest significant digits that represent all times.
    """
    size = np.abs(t)
    decade = np.floor(np.log10(np.where(size > 0, size, size[size > 0].min())))
    for digits in range(SETTINGS.digits):
        resolution = 10.0 ** (decade - digits)
        if np.allclose(t, np.round(t / resolution) * resolution, rtol=1e-9):
            return resolution
    return 10.0 ** (decade + 1 - SETTINGS.digits)


def stamps_at_gaps(t: Array, readings: Mapping[str, Array]) -> tuple[Array, str]:
    """Move stamps at an interruption to the side whose motion the reading continues; return times and a note.

    The reading next to an interruption is predicted from both sides, each by the parabola through the nearest rows.

    Args:
        t: (n,) times, s; known times increase
        readings: (n,) unwrapped readings of each axis
    """
    values = np.stack(list(readings.values()), axis=1)
    rows = np.flatnonzero(np.isfinite(t) & np.isfinite(values).all(axis=1))
    time, x = t[rows].copy(), values[rows]
    steps, n = np.diff(time), SETTINGS.fitted
    if len(rows) < 4 * n:
        return t, ""
    step = float(np.median(steps))
    gaps = np.flatnonzero(steps > SETTINGS.gap_steps * step).tolist() if step > 0 else []
    if not gaps:
        return t, ""
    predicted = np.unique(np.linspace(n, len(rows) - 1, SETTINGS.elsewhere).astype(int))
    errors = np.stack([_error(time, x, slice(i - n, i), i, float(time[i])) for i in predicted.tolist()])
    errors = errors[np.isfinite(errors).all(axis=1)]
    if not len(errors):
        return t, ""
    usual = np.maximum(np.quantile(errors, SETTINGS.usual, axis=0), np.finfo(np.float64).tiny)
    moved = []
    for gap in gaps:
        for row, same_side, other_side, instant in (
            (gap, slice(gap - n, gap), slice(gap + 1, gap + 1 + n), time[gap + 1] - step),
            (gap + 1, slice(gap + 2, gap + 2 + n), slice(gap + 1 - n, gap + 1), time[gap] + step),
        ):
            if min(same_side.start, other_side.start) < 0 or max(same_side.stop, other_side.stop) > len(rows):
                continue
            at_stamp = _error(time, x, same_side, row, time[row]) / usual
            beyond = _error(time, x, other_side, row, instant) / usual
            if at_stamp.max() >= SETTINGS.misfit and beyond.max() <= SETTINGS.fit:
                moved.append((int(rows[row]), float(instant)))
                break
    corrected = t.copy()
    for row, instant in moved:
        corrected[row] = instant
    if not moved:
        return t, ""
    first, instant = moved[0]
    return corrected, (
        f"time stamps on the wrong side of an interruption: {len(moved)}. The readings of these rows continue the"
        " motion on the other side of the interruption, so the rows are moved there, the first from"
        f" {t[first]:.7g} to {instant:.7g} s"
    )


def _error(t: Array, x: Array, fitted: slice, row: int, instant: float) -> Array:
    """Return the (columns,) absolute errors of readings predicted at an instant.

    The prediction is a parabola through other rows. The error is infinite if the instant is far from the rows.
    """
    duration = float(np.ptp(t[fitted]))
    if np.abs(t[fitted] - instant).max() > SETTINGS.far * duration or duration <= 0:
        return np.full(x.shape[1], np.inf)
    u = (t[fitted] - instant) / duration
    parabola = np.linalg.lstsq(np.stack([np.ones_like(u), u, u**2], axis=1), x[fitted], rcond=None)[0]
    return np.abs(x[row] - parabola[0])


def without_speed(columns: Mapping[str, Array], t: Array) -> list[str]:
    """Return the names of columns, or of only the angle if every other column is its speed.

    The steps of an angle are proportional to speed times time step, in any unit. The steps of the speed of a swing have
    the opposite sign of the angle. A table can have the raw and the filtered speed.
    """
    names, steps = list(columns), np.diff(t)
    angles = [
        angle
        for angle in names
        if all(
            correlation(np.diff(columns[angle]), steps * columns[speed][1:]) > SETTINGS.speed_correlation
            for speed in names
            if speed != angle
        )
    ]
    return angles if len(angles) == 1 else names
