"""Interpret a table: columns, units, zeros, release, and warnings.

The rows are not resampled: uneven steps and interruptions are kept. Rows without a value and rows with the same time as
the previous row are removed, counted and reported. Times change only if they wrap, or by
`dpr_lab.storage.tables.time_stamps`.
"""

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dpr_lab.arrays import Array
from dpr_lab.errors import RunError
from dpr_lab.estimation.arm_motion import refuse_still_arm
from dpr_lab.estimation.counted_rows import edge_rows
from dpr_lab.estimation.held_rods import FreePart, RodMotion, free_part, rest_fault
from dpr_lab.estimation.repeated_readings import new_readings
from dpr_lab.progress import OnImport, unwatched
from dpr_lab.rig import Rig
from dpr_lab.run import as_mounted
from dpr_lab.storage.readers import read_any
from dpr_lab.storage.readers.merged import rows_of_angles
from dpr_lab.storage.tables.angles import angles, in_radians
from dpr_lab.storage.tables.arm_input import cart_note, known_inputs, stated_arm, unused_input
from dpr_lab.storage.tables.clock_wrap import check_forwards, summed_durations, unwrapped_times
from dpr_lab.storage.tables.columns import AXES, NO_ROD, TO_SECONDS, find_columns, stated_columns
from dpr_lab.storage.tables.interpreted import InterpretedTable, TableQuestion
from dpr_lab.storage.tables.options import ImportOptions, date_in, parse_recorded_at
from dpr_lab.storage.tables.plausible import (
    PLAUSIBLE,
    check_spacing,
    drop_outliers,
    frame_notes,
    gap_notes,
    recorded_by_stamps,
    refuse_converter,
    refuse_missing,
    turn_notes,
    turn_of_hanging,
    without_wraps,
    wrap_notes,
)
from dpr_lab.storage.tables.questions.frame_numbers import counted_frames, frame_step_note, numbers
from dpr_lab.storage.tables.questions.questions import questions, refuse_push
from dpr_lab.storage.tables.table import Table
from dpr_lab.storage.tables.time_stamps import carried_times, even_times, shares_times, spread_times, stamps_at_gaps
from dpr_lab.storage.tables.torques import PASSIVE, find_torques, sign_of_drive, torque_column, unnumbered
from dpr_lab.storage.tables.understood import Understood

_RATE = re.compile(r"--rate-hz \d|Hz \(--rate-hz\)")
"""Pattern of a warning that states another rate."""


def understand(
    file: Path | str, rig: Rig, options: ImportOptions | None = None, on_progress: OnImport = unwatched
) -> Understood:
    """Interpret a table; see `import_csv` for arguments and errors."""
    options = options or ImportOptions()
    if options.pose is not None and options.pose not in rig.poses:
        raise RunError(f"{file}: the rig has no pose {options.pose!r}; its poses: {', '.join(rig.poses) or 'none'}")
    path = Path(file)
    named_angles = not set(AXES).isdisjoint(options.columns)
    table = read_any(path, options.take, on_progress, points=not named_angles)
    table, stated, options = stated_columns(table, options, rig.rods.mounted != "both")
    columns = find_columns(table, stated, options)
    recorded = [name for name, column in table.named if name != NO_ROD and not np.isnan(column).all()]
    table = rows_of_angles(table, [name for axis, name in columns.names.items() if axis != "t" and name != NO_ROD])
    unit_stated = options.unit is not None or not options.scale.keys().isdisjoint(AXES)
    options = replace(options, unit=columns.unit, time_unit=columns.time_unit)
    options = stated_arm(rig, options, path, columns.names, recorded)
    _refuse_conventions(table, options)
    t, readings, notes = _readings(table, columns.names, rig, options)
    timed = options.rate_hz is None
    begins = np.searchsorted(table.lines, () if timed else table.repeated)
    sections = tuple(t[begins[begins < len(t)]].tolist())
    of_cart, cart = cart_note(table, columns.names, rig, options)
    inputs = known_inputs(recorded, table.other_lengths, rig, options, path)
    known = {name: torque_column(table, name) for pair in inputs.pairs.values() for name in pair}
    rows, removed = _rows_to_keep(path, t, {**readings, **known}, options)
    inputs.refuse_silent(known, rows, path)
    notes += [*of_cart, *unused_input(recorded, options.arm), *unnumbered(recorded, inputs.pairs, options)]
    drive = sign_of_drive(table, options.arm or "clamped")
    if drive and not inputs.pairs and options.arm == "clamped":
        notes.append(f"{drive}, but its torque is not known: record the torques of the motors, or a free swing")
    if inputs.pairs and not any(column[rows].any() for column in known.values()):
        inputs = replace(inputs, pairs={})
        if rig.rods.mounted == "both":  # two zeros may also fit driven rods by chance
            drive = drive or "the columns of the torques contain only zeros, although motors may drive the rods"
        notes.append(
            "all torques are zero, so the recording is treated as a free swing: if motors drive the rods, their torques"
            " are not in this table"
        )
    elif inputs.pairs:  # the torques that follow the set point are known
        drive = ""
    values = {axis: _scaled(column[rows], axis, rig, options) for axis, column in readings.items()}
    notes = [*table.notes, *columns.notes, *removed, *notes, *inputs.notes()]
    named = {axis: name for axis, name in columns.names.items() if axis == "t" or axis in values}
    ignored = _ignored(table, [*recorded, *table.other_lengths], options, rows)
    midnight = next((column.midnight for column in table.columns if column.name == named.get("t")), 0.0)
    torques = inputs.torques(known, t, rows)
    cart = None if cart is None or not np.isfinite(cart[rows]).all() else cart[rows]
    recorded_at, note = table.recorded_at, "".join(of_cart)
    read = _Rows(path, rows, t, values, torques, named, options, ignored, drive, midnight, recorded_at, cart, note)
    frames = ("", 1) if timed else counted_frames(table)
    read = replace(read, sections=sections, frames=frames, unit_stated=unit_stated)
    understood = replace(_understood(read, notes, rig, table.kind, inputs.pairs), film_noise=table.film_noise)
    return _at_edges(understood, rig)


def _readings(
    table: Table, names: Mapping[str, str], rig: Rig, options: ImportOptions
) -> tuple[Array, dict[str, Array], list[str]]:
    """Extract times, readings and notes from a table.

    The times (rows,) are in s. The readings (rows,) of each recorded axis are NaN for outliers.
    """
    t, carried = carried_times(_times(table, names, options))
    t, summed = summed_durations(t, names.get("t", ""))
    readings, empty = _recorded(table, {axis: table.column(names[axis]) for axis in AXES if axis in names}, options)
    check_forwards(table, t, options)
    t, rounded = even_times(t, readings)
    t, shared = spread_times(t, readings)
    outliers = drop_outliers(readings, rig, options, table.path)
    unwrapped = {axis: without_wraps(column, axis, rig, options) for axis, column in readings.items()}
    t, misplaced = stamps_at_gaps(t, unwrapped)
    stamps = filter(None, (carried, summed, rounded, shared, misplaced))
    return t, readings, [*outliers, *empty, *stamps]


@dataclass(frozen=True, slots=True)
class _Rows:
    """The rows of a table that are kept."""

    path: Path
    kept: NDArray[np.intp]
    t: Array
    """(all rows,) times, s, including removed rows."""
    values: Mapping[str, Array]
    torques: Mapping[str, Array]
    columns: Mapping[str, str]
    options: ImportOptions
    ignored: tuple[str, Array] | None
    """Kind and (kept rows, 2) torques that `--torque none` ignores, N m; None if no torques are ignored."""
    drive: str
    """Evidence in the table that an unknown torque drives the rods; empty if there is none."""
    midnight: float
    """Zero of times with dates, s since 1970; 0 for other times."""
    recorded_at: str
    """Date, or date and time, in the lines above the numbers; empty if unknown."""
    cart: Array | None
    """(kept rows,) column that may be the position of a cart that carries the rod, m; None if there is no column."""
    of_cart: str
    """Note on how to import this cart; empty if there is no column."""
    sections: tuple[float, ...] = ()
    """Times at which the header is repeated, in a table without times, s."""
    frames: tuple[str, int] = ("", 1)
    """Column that counts the frames of a table without times, and its step from row to row."""
    unit_stated: bool = False
    """Whether the options state the unit or a scale of the angles."""


def _ignored(
    table: Table, names: list[str], options: ImportOptions, rows: NDArray[np.intp]
) -> tuple[str, Array] | None:
    if options.torque != "none" or options.arm != "clamped":
        return None
    with suppress(RunError):
        for kind, pair in find_torques(names, None, options.columns, table.path).items():
            torques = np.stack([torque_column(table, name)[rows] for name in pair], axis=1)
            return (kind or "measured", torques) if np.isfinite(torques).all() and torques.any() else None
    return None


def _understood(
    read: _Rows, notes: list[str], rig: Rig, kind: str, driving: Mapping[str, tuple[str, str]]
) -> Understood:
    """Convert the kept rows to angles, find the free part, and collect the warnings."""
    path, options, time = read.path, read.options, read.t[read.kept]
    check_spacing(path, time - time[0])
    if options.unit == "rad":
        refuse_converter(read.values, read.columns, rig, path)
    theta, counts = angles(read.values, options, rig, path)
    if options.zero == "upright" and counts is None:  # loggers use -180 or 180 degrees for hanging rods
        theta[:, 1:] -= turn_of_hanging(theta[:, 1])
    if options.arm in ("free", "driven"):
        refuse_still_arm(theta[:, 0], options.arm, path)
    wraps = [] if counts is not None or options.wrap else wrap_notes(in_radians(read.values, options))
    of_turns = turn_notes(read.values) if options.unit == "rad" and not options.wrap else []
    notes += wraps + of_turns + gap_notes(time)
    origin = float(read.t[np.isfinite(read.t)][0])
    driven = next(iter(read.torques.values()), None)
    mounted = as_mounted(theta, rig.rods.mounting, str(path))
    arm = theta[:, 0] if options.arm != "clamped" else None
    motion = RodMotion(time, mounted[:, 1:], driven, arm, read.cart, origin)
    whole = FreePart(0, 0, len(time))
    part = whole if options.keep_rest else free_part(motion, str(path))
    pair = next(iter(driving.values()), (PASSIVE, PASSIVE))
    table = InterpretedTable(
        path, rig, options, read.columns, time, mounted, read.values, part, driven, pair, read.ignored, read.drive
    )
    name, every = read.frames
    table = replace(table, sections=read.sections, every=every, unit_stated=read.unit_stated)
    doubts = questions(table)
    if options.rate_hz and every > 1 and not any(_RATE.search(doubt.sentence) for doubt in doubts):
        notes.append(frame_step_note(name, every, options.rate_hz))
    if counts is None and not any("--angles" in doubt.mend for doubt in doubts):
        notes += frame_notes(options, rig)
    if not options.keep_rest:
        refuse_push(table, origin, read.cart, read.of_cart)
    if not rig.rig.on_earth(rig.g):
        doubts.append(TableQuestion(f"g = {rig.rig.compared_g}: correct g in the rig file"))
    if options.keep_rest and _seems_held(motion, whole):
        doubts.append(TableQuestion("the rods seem to be held in some rows: if this is so, remove --keep-rest"))
    fault = rest_fault(motion, part)
    notes += _cut_notes(time, part, fault)
    first, release = part.start if fault else part.rest, float(time[part.start])
    rows = slice(first, part.stop)
    recorded_at = options.recorded_at and parse_recorded_at(options.recorded_at)
    stamped = recorded_by_stamps(read.midnight + release) if options.rate_hz is None else ""
    return Understood(
        path,
        rig,
        # Decimals that need few characters in a run file; 1 ns and 1e-11 rad are far below the resolution of a logger.
        np.round(time[rows] - time[first], 9),
        part.start - first,
        np.round(theta[rows], 11) if counts is None else theta[rows],
        None if counts is None else counts[rows],
        release,
        read.columns,
        tuple(notes),
        options,
        kind,
        {name: torque[rows] for name, torque in read.torques.items()},
        driving,
        tuple(doubts),
        recorded_at or stamped or read.recorded_at or date_in(path.stem),
    )


def _at_edges(read: Understood, rig: Rig) -> Understood:
    """Correct the angles to count edges if the logger sent a row per count."""
    theta = read.theta
    encoders = np.column_stack([theta[:, 0], rig.encoders.joint_angles.of_rods(theta[:, 1:])])
    rows = edge_rows(encoders[:, : 1 + rig.rods.number])
    if rows is None:
        return read
    release = int(np.searchsorted(rows, read.release))
    later = read.since_first_s[rows[release]] - read.since_first_s[read.release]
    note = "a row is sent for each count: the angle of a row is the edge between its count and the previous count"
    return replace(
        read,
        since_first_s=np.round(read.since_first_s[rows] - read.since_first_s[rows[0]], 9),
        release=release,
        theta=0.5 * (theta[rows - 1] + theta[rows]),
        counts=None,
        t_offset_s=read.t_offset_s + float(later),
        notes=(*read.notes, note),
        torques={kind: torque[rows] for kind, torque in read.torques.items()},
        at_edges=True,
    )


def _seems_held(motion: RodMotion, whole: FreePart) -> bool:
    try:
        return free_part(motion, "") != whole
    except RunError:
        return True


def _cut_notes(t: Array, part: FreePart, fault: str) -> list[str]:
    """Return notes about removed rows and about a release before t = 0.

    Rows that were recorded while the rods were held are removed.
    """
    notes = []
    if part.start == 0 and t[0] < 0 < t[-1]:
        notes.append(
            f"the first row, at t = {t[0]:g} s, is treated as the release: if the release is at t = 0, add --start-s"
            f" {-t[0]:g}"
        )
    if part.start > 0:
        subject = f"the {t[part.start] - t[part.rest]:.4g} s of rest before it are"
        held = f"{subject} excluded, because {fault}" if fault else f"{subject} kept for the noise floor"
        reason = held if part.start > part.rest else "the rows before it are excluded"
        notes.append(
            f"starts at {t[part.start]:.7g} s, when the rods begin to move; {reason} (--keep-rest uses all rows)"
        )
    if part.stop < len(t):
        notes.append(
            f"ends at {t[part.stop - 1]:.7g} s, when the rods are held; the rows after it are excluded"
            f" (--keep-rest uses all rows; necessary if friction holds the rods)"
        )
    return notes


def _refuse_conventions(table: Table, options: ImportOptions) -> None:
    stated = {"--unit": options.unit, "--angles": options.angles, "--zero": options.zero}
    other = [f"{name} {value}" for name, value in stated.items() if value not in ("rad", "absolute", "upright")]
    if table.settled and other:
        raise RunError(
            f"{table.path}: angles from points are absolute, upright is 0, in rad: remove {' and '.join(other)}"
        )


def _times(table: Table, columns: Mapping[str, str], options: ImportOptions) -> Array:
    if options.rate_hz is not None:
        return numbers(table) / options.rate_hz
    assert options.time_unit is not None
    times = table.column(columns["t"])
    if options.time_wrap is not None:
        times = unwrapped_times(times, options.time_wrap, f"{table.path}: column {columns['t']!r}")
    return times * TO_SECONDS[options.time_unit]


def _scaled(column: Array, axis: str, rig: Rig, options: ImportOptions) -> Array:
    """Return the readings of a column: unwrapped, then scaled, then shifted."""
    return without_wraps(column, axis, rig, options) * options.scale.get(axis, 1.0) + options.offset.get(axis, 0.0)


def _recorded(table: Table, readings: dict[str, Array], options: ImportOptions) -> tuple[dict[str, Array], list[str]]:
    """Return the readings of the axes whose columns contain numbers, and a note about an empty column of a clamped arm.

    Raises:
        RunError: the column of a rod, or of an arm that is not clamped, is empty.
    """
    silent = [axis for axis, column in readings.items() if not np.isfinite(column).any()]
    for axis in silent:
        if axis != "theta0" or options.arm != "clamped":
            needed = "both rods are" if axis != "theta0" else f"the angle of a {options.arm} arm is"
            raise RunError(f"{table.path}: the column of {axis} is empty; {needed} required")
    recorded = {axis: column for axis, column in readings.items() if axis not in silent}
    return recorded, [f"{axis}: its column is empty, so this axis was not recorded" for axis in silent]


def _rows_to_keep(
    path: Path, t: Array, readings: Mapping[str, Array], options: ImportOptions
) -> tuple[NDArray[np.intp], list[str]]:
    known = t[np.isfinite(t)]
    if not len(known):
        raise RunError(f"{path}: the time column contains no number")
    start = known[0] + options.start_s
    stop = np.inf if options.duration_s is None else start + options.duration_s
    # A row without a time belongs to the same part as the row before it.
    instants = np.maximum.accumulate(np.where(np.isfinite(t), t, known[0]))
    inside = np.flatnonzero((instants >= start) & (instants < stop))
    whole = np.logical_and.reduce([np.isfinite(column[inside]) for column in (t, *readings.values())])
    empty = int(np.count_nonzero(~whole))
    refuse_missing(path, instants[inside] - known[0], whole)
    rows = inside[whole]
    if len(rows) == 0:
        part = f"after {start:g} s" if options.duration_s is None else f"between {start:g} s and {stop:g} s"
        raise RunError(f"{path}: no rows {part}; the table ends at {known[-1]:g} s")
    doubled = np.diff(t[rows], prepend=-np.inf) == 0
    _refuse_coarse_times(path, t[rows], {axis: column[rows] for axis, column in readings.items()})
    distinct = rows[~doubled]
    if len(distinct) < 2:
        raise RunError(f"{path}: only {len(distinct)} row remains: a run needs at least two instants")
    new, note = new_readings(t[distinct], [column[distinct] for column in readings.values()])
    notes = [f"rows without a value (NaN), treated as missing: {empty}" if empty else "", note]
    if doubled.any():
        notes.insert(1, f"rows with the same time as the previous row, removed: {doubled.sum()}")
    return distinct[new], list(filter(None, notes))


def _refuse_coarse_times(path: Path, t: Array, readings: Mapping[str, Array]) -> None:
    """Refuse a time column with too few digits."""
    shared = shares_times(t, readings).sum()
    if shared > PLAUSIBLE.doubled_share * len(t):
        raise RunError(
            f"{path}: {shared} of {len(t)} rows have the same time as the previous row but other"
            " readings: the time column has too few digits. Export more digits, or give the rate (--rate-hz)"
        )
