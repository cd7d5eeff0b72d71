"""Check the plausibility of a table: spacing, duration, wraps, outliers, speeds."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from dpr_lab.arrays import Array, Flags, correlation
from dpr_lab.errors import RunError
from dpr_lab.rig import Rig
from dpr_lab.storage.tables.columns import AXES, TO_RADIANS, TO_SECONDS
from dpr_lab.storage.tables.options import ImportOptions


@dataclass(frozen=True, slots=True)
class Plausible:
    """Limits beyond which a unit is wrong or the file is not a recording."""

    nan_share: float = 0.1
    """Maximum share of rows without a value. A larger share is accepted if these rows are scattered, for example
    because a tracker loses a point."""
    lost_share: float = 0.5
    """Maximum share of scattered rows without a value."""
    lost_rows: int = 10
    """Maximum number of consecutive rows without a value that count as scattered."""
    doubled_share: float = 0.1
    """Maximum share of rows with the same time as the previous row but other readings."""
    step_s: float = 10.0
    """Maximum median time between rows, s."""
    usual_step_s: float = 0.005
    """Usual time between the rows of a logger, s."""
    duration_s: float = 1e6
    """Maximum time from the first row to the last, s."""
    stamps_s: tuple[float, float] = (946_684_800.0, 4_102_444_800.0)
    """Range of times that are read as seconds since 1970: the years 2000 to 2100. A logger's own clock does not run for
    thirty years."""
    angle: float = 1e4
    """Maximum angle, rad. A larger angle would take hours of turning."""
    jump: float = 1.5 * np.pi
    """Minimum jump of an angle between two rows that counts as a wrap, rad. It is less than a turn, but larger than the
    motion of a rod between two rows."""
    outlier_rows: int = 3
    """Maximum number of consecutive rows that count as outliers because the angle jumps away and back."""
    window_slack: float = 0.2
    """Maximum excess of the range of wrapped angles over one turn, rad."""
    widths: tuple[float, ...] = (2.0**16, 2.0**32)
    """Periods of unsigned integers in which a logger may store a signed counter."""
    gap_steps: float = 1.51
    """Minimum step between two rows that is reported as an interruption, in median steps. It differs from 1.5, so that
    the rounding of the times has no influence."""
    speed: float = 100.0
    """Maximum speed of the faster rod, rad/s: sixteen turns per second. If nine of ten rows exceed it, degrees were
    probably read as radians."""
    back: float = 1.5
    """Maximum number of turns of a single rod between two turning points. If angles exceed this number, they cannot be
    in radians."""
    falls: float = -0.5
    """Maximum correlation of squared speed and height of a rod that falls from the upright pose. It is near -1 for a
    free rod whose zero is correct, and near 1 if hanging and upright are exchanged."""
    turns: tuple[tuple[float, str], ...] = ((1.0, "turns"), (2.0, "half turns"))
    """Periods at which angles in turns and in half turns wrap, and their units."""
    wrapped: tuple[float, int] = (0.4, 3)
    """Maximum step of a rod, in periods, and minimum number of wraps. The reading jumps by one period minus such a step
    at a wrap."""
    whole: float = 1e-6
    """Maximum difference from integers for which the steps of an angle count as integers."""
    typical_rows: int = 20_000
    """Maximum number of examined rows, evenly spaced over the table."""


PLAUSIBLE = Plausible()


def check_spacing(path: Path, t: Array) -> None:
    """Check the interval between rows and the duration of the table.

    Args:
        path: the table
        t: (n,) times since the first row, s, ascending

    Raises:
        RunError: a limit is exceeded; the unit of time is then probably wrong.
    """
    step = np.median(np.diff(t))
    if step > PLAUSIBLE.step_s:
        unit = min(TO_SECONDS, key=lambda name: abs(math.log(step * TO_SECONDS[name] / PLAUSIBLE.usual_step_s)))
        raise RunError(
            f"{path}: rows are {step:g} s apart, which is too far to follow a swing: the times are probably in"
            f" {unit}, and the rows then {step * TO_SECONDS[unit]:.3g} s apart (--time-unit {unit})"
        )
    if t[-1] > PLAUSIBLE.duration_s:
        raise RunError(
            f"{path}: the table lasts {t[-1]:g} s, which is too long for a swing: is the unit of time correct"
            " (--time-unit ms or us)?"
        )


def refuse_missing(path: Path, t: Array, whole: Flags) -> None:
    """Refuse a table in which too many rows have no value.

    The message names the longest complete part by `--start-s` and `--duration-s`.

    Args:
        path: the table
        t: (n,) times since the first row of the table, s, ascending
        whole: (n,) mask of the rows that have all values

    Raises:
        RunError: more than a tenth of the rows have no value, or more than half of them if these rows are scattered.
    """
    edges = np.flatnonzero(np.diff(whole, prepend=True, append=True))  # start and end of intervals without a value
    intervals = [(int(a), int(b)) for a, b in edges.reshape(-1, 2) if b - a > PLAUSIBLE.lost_rows]
    missing = float(np.mean(~whole)) if len(whole) else 0.0
    if missing <= (PLAUSIBLE.nan_share if intervals else PLAUSIBLE.lost_share):
        return
    begins, ends = [0, *(b for _, b in intervals)], [*(a for a, _ in intervals), len(t)]
    first, last = max(zip(begins, ends, strict=True), key=lambda part: part[1] - part[0])
    part = whole[first:last]
    option = "use a complete part (--start-s, --duration-s)"
    if not whole.any():
        option = "interpolate angles and torques to the same times if the logger writes them in separate rows"
    if intervals and part.sum() > PLAUSIBLE.lost_rows and np.mean(~part) <= PLAUSIBLE.lost_share:
        lasts = f" --duration-s {t[last] - t[first]:.6g}" if last < len(t) else ""
        option = f"use its longest part with values (--start-s {t[first]:.6g}{lasts})"
    raise RunError(
        f"{path}: {(~whole).sum()} of {len(whole)} rows have no value (NaN; in a film also points that the tracker lost"
        f" or confused): too many for a recording. Export it again, or {option}"
    )


def unwrapped(angles: Array) -> Array:
    """Unwrap angles that the logger wrapped.

    Angles count as wrapped if they all lie within one turn and jump by nearly one turn. Other angles are returned
    unchanged.
    """
    if np.ptp(angles) > 2 * np.pi + PLAUSIBLE.window_slack or not _jumps(angles):
        return angles
    return np.unwrap(angles, discont=PLAUSIBLE.jump)


def without_wraps(column: Array, axis: str, rig: Rig, options: ImportOptions) -> Array:
    """Unwrap a column at the period that the options state; missing values are kept.

    If the period is the width of an integer, the first value is within half a period of the zero of its axis: large
    values of a signed counter are readings below the zero. This matters if the width is not a whole number of turns.
    """
    known = np.isfinite(column)
    if options.wrap is None or not known.any():
        return column
    turned = column.copy()
    turned[known] = np.unwrap(column[known], period=options.wrap)
    if options.wrap not in PLAUSIBLE.widths:
        return turned
    zero = rig.encoders.zero_counts[AXES.index(axis)] if options.unit == "counts" else 0.0
    zero = (zero - options.offset.get(axis, 0.0)) / options.scale.get(axis, 1.0)
    return turned - options.wrap * np.round((turned[known][0] - zero) / options.wrap)


def turn_of_hanging(angle: Array) -> float:
    """Return the full turns, rad, between pi and the first hanging angle.

    The result is 0 if the rod also hangs at pi, or never hangs.

    Args:
        angle: (n,) angle of the rod, 0 = upright, rad
    """
    turns = np.round((angle[np.cos(angle) < 0.0] - np.pi) / (2 * np.pi))
    return 2 * np.pi * float(turns[0]) if len(turns) and turns.all() else 0.0


def wrap_notes(angles: Mapping[str, Array]) -> list[str]:
    """Return a note for each axis whose angle (n,), rad, was wrapped by the logger."""
    return [
        f"{axis}: the logger wrapped this angle; the import unwrapped it"
        for axis, x in angles.items()
        if unwrapped(x) is not x
    ]


def turn_notes(angles: Mapping[str, Array]) -> list[str]:
    """Return a note if angles (n,), read as radians, wrap like turns from 0 to 1 or half turns from -1 to 1."""
    step, fewest = PLAUSIBLE.wrapped
    leap = 1 - step
    for axis, x in angles.items():
        steps = np.abs(np.diff(x))
        for period, unit in PLAUSIBLE.turns:
            leaps = steps >= leap * period
            if (
                leap * period < np.ptp(x) <= period
                and leaps.sum() >= fewest
                and (leaps | (steps <= step * period)).all()
            ):
                factor = 2 * np.pi / period
                return [
                    f"{axis} jumps {leaps.sum()} times by almost {period:g} rad, like angles in {unit} that a logger"
                    f" wraps: if the angles are in {unit}, import with --wrap {period:g} --scale {factor:.6g}"
                ]
    return []


def outliers(angles: Array) -> Flags:
    """Return the mask (n,) of impossibly large angles, and of angles that jump away and back within a few rows."""
    wild = np.abs(angles) > PLAUSIBLE.angle
    if not wild.any() and not _jumps(angles):
        return wild
    for rows in range(1, PLAUSIBLE.outlier_rows + 1):
        plausible = np.flatnonzero(~wild)
        if len(plausible) < rows + 2:
            return wild
        wild[plausible[_leaps(angles[plausible], rows)]] = True
    return wild


def refuse_converter(read: Mapping[str, Array], columns: Mapping[str, str], rig: Rig, path: Path) -> None:
    """Refuse angles in rad that are probably whole numbers of an analog-to-digital converter.

    The largest number of the converter is less than half a turn of the encoder in the rig file.

    Raises:
        RunError: the message states how to convert the numbers.
    """
    for axis, column in read.items():
        least, most = float(column.min()), float(column.max())
        top = 1023 if most <= 1023 else 4095
        resolution = rig.encoders.counts_per_rev[AXES.index(axis)]
        if least >= 0 and 360 < most <= top and 2 * top < resolution and (column == np.round(column)).all():
            raise RunError(
                f"{path}: column {columns[axis]!r} contains whole numbers up to {most:g}. If they are readings of a"
                f" potentiometer from 0 to {top}, give the angle of one step in rad, for example --scale"
                f" {math.radians(300) / top:.3g} for 300 degrees in {top} steps, and the offset of the zero (--offset)."
                " If they are counts of an encoder: --unit counts, with counts_per_rev in the rig file"
            )


def frame_notes(options: ImportOptions, rig: Rig) -> list[str]:
    """Return a note if the table contains absolute angles, but the encoder of joint 2 is relative."""
    if options.angles != "absolute" or rig.rods.mounted != "both" or rig.encoders.joint2 == "absolute":
        return []
    return [
        'theta2 is absolute, but joint2 = "relative" in the rig file. If no relative encoder measured it (for example,'
        ' in a film), write joint2 = "absolute" and import the table again, so that its noise is independent of theta1'
    ]


def drop_outliers(readings: dict[str, Array], rig: Rig, options: ImportOptions, path: Path) -> list[str]:
    """Replace outliers by NaN, and return notes with the number of outliers.

    Raises:
        RunError: most values are impossible angles.
    """
    notes = []
    for axis, column in readings.items():
        counted = abs(rig.radians_per_count[AXES.index(axis)]) if options.unit == "counts" else None
        scale = (counted or TO_RADIANS[options.unit or "rad"]) * abs(options.scale.get(axis, 1.0))
        known = np.flatnonzero(np.isfinite(column))
        wild = known[outliers(without_wraps(column, axis, rig, options)[known] * scale)]
        if 2 * len(wild) > len(known):
            raise RunError(
                f"{path}: {len(wild)} of {len(known)} values of {axis} are impossible angles, for example"
                f" {column[wild[0]]:g}: is the column an angle (--columns), and is its unit correct (--unit, --scale)?"
            )
        if len(wild):
            column[wild] = np.nan
            notes.append(f"{axis}: outliers removed: {len(wild)}")
    return notes


def _jumps(angles: Array) -> bool:
    return bool((np.abs(np.diff(angles)) >= PLAUSIBLE.jump).any())


def _leaps(angles: Array, rows: int) -> Flags:
    """Return a mask (n,) of angles that jump away and back within `rows` rows.

    Wraps are not included.
    """
    # Both ends are extended so that the first and last rows can be outliers too.
    x = np.concatenate([angles[rows : rows + 1], angles, angles[-rows - 1 : -rows]])
    jump_there, back = x[1:-rows] - x[: -rows - 1], x[rows + 1 :] - x[rows:-1]
    implausible = (np.abs(jump_there) > PLAUSIBLE.jump) & (np.abs(back) > PLAUSIBLE.jump) & (jump_there * back < 0)
    implausible &= np.abs(x[rows + 1 :] - x[: -rows - 1]) < PLAUSIBLE.jump
    leaping = np.zeros(len(angles), dtype=np.bool_)
    for first in np.flatnonzero(implausible):
        leaping[first : first + rows] = True
    others = angles[~leaping]
    if not leaping.any() or not len(others):
        return leaping
    top, bottom = others.max(), others.min()
    turn = 2 * np.pi + PLAUSIBLE.window_slack
    wrapped = (angles >= top - turn) & (angles <= bottom + turn)
    return leaping & ~(wrapped & (top - bottom <= turn))


def gaps(t: Array) -> Array:
    """Return the lengths (k,) of the k interruptions between times (n,), s."""
    steps = np.diff(t)
    return steps[steps > PLAUSIBLE.gap_steps * np.median(steps)]


def gap_notes(t: Array) -> list[str]:
    """Return a note about the interruptions between times (n,), s, or an empty list if there are none."""
    long = gaps(t)
    return [f"interruptions kept: {len(long)}, the longest {long.max():.4g} s"] if len(long) else []


def odd_notes(t: Array, theta: Array, upright: bool, rods: int, in_radians: bool) -> list[str]:
    """Return notes about impossible motion and about rods that mostly point upwards.

    A single rod without a drive turns back only below the upright pose. Its motion between turning points is therefore
    less than one turn. A rod that falls from the upright pose points upwards for a long time, but is slow there.

    Args:
        t: (n,) times, s
        theta: (n, 3) angles of arm, inner and outer rod, rad
        upright: whether to check if the rods point upwards
        rods: number of rods
        in_radians: whether the angles of rods without a drive are interpreted as radians
    """
    rows = np.linspace(0, len(t) - 2, min(len(t) - 1, PLAUSIBLE.typical_rows)).astype(np.intp)
    steps, moved = t[rows + 1] - t[rows], np.abs(theta[rows + 1, 1:] - theta[rows, 1:])
    heights = np.cos(theta[rows, 1:])
    above = upright & (np.median(heights, axis=0) > 0)
    faster, higher = (moved[:, 0] / steps) ** 2, heights[:, 0]
    falls = rods == 1 and correlation(faster - faster.mean(), higher - higher.mean()) < PLAUSIBLE.falls
    speed = float(np.quantile(moved.max(axis=1) / steps, 0.1))
    turns, points = ("the rod turns", "the rod points") if rods == 1 else ("the rods turn", "both rods point")
    counted = in_radians and bool((np.abs(moved[:, :rods] - np.round(moved[:, :rods])) < PLAUSIBLE.whole).all())
    whole = (
        "whole numbers are usually degrees (--unit deg), or counts of an encoder (--unit counts, with counts_per_rev in"
        " the rig file)"
    )
    units = whole if counted else "are the units correct (--unit, --scale, --time-unit)?"
    fast = [f"{turns} at more than {speed:.3g} rad/s most of the time: {units}"]
    coarse = [f"{turns} in steps of whole radians: {whole}"]
    inverted = [f"{points} upwards most of the time: if the table's zero is hanging, import it with --zero hanging"]
    turned = _between_turning_points(theta[rows, 1]) if rods == 1 and in_radians else 0.0
    far = [
        f"the rod turns back after {turned / (2 * np.pi):.3g} turns, but gravity turns it back within one: are the"
        " angles in degrees (--unit deg)?"
    ]
    impossible = (
        fast if speed > PLAUSIBLE.speed else coarse if counted else far if turned > PLAUSIBLE.back * 2 * np.pi else []
    )
    return impossible + (inverted if above.all() and not falls else [])


def _between_turning_points(angle: Array) -> float:
    """Return the median angle between successive turning points of a rod, rad.

    The result is 0 with fewer than three turning points.
    """
    moving = angle[np.diff(angle, prepend=np.inf) != 0]
    steps = np.diff(moving)
    turning = moving[1:-1][steps[:-1] * steps[1:] < 0]
    return float(np.median(np.abs(np.diff(turning)))) if len(turning) > 2 else 0.0


def recorded_by_stamps(first_s: float) -> str:
    """Return date and time (UTC) of the first row if times are seconds since 1970; otherwise an empty text."""
    if not PLAUSIBLE.stamps_s[0] <= first_s <= PLAUSIBLE.stamps_s[1]:
        return ""
    return datetime.fromtimestamp(first_s, UTC).isoformat(timespec="seconds")
