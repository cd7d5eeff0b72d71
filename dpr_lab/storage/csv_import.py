"""Turn a logger's table of any kind (`dpr_lab.storage.readers`) into a run.

Times stay as the table has them: uneven steps and gaps are kept, nothing is resampled. Rows without a value and rows
with the time of the row before are left out, counted and reported in the run's notes.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dpr_lab.configs import sha256_of
from dpr_lab.errors import RunError
from dpr_lab.estimation.arm_motion import prescribed_arm
from dpr_lab.rig import Rig
from dpr_lab.run import Run, as_mounted
from dpr_lab.setup import ArmMotion
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.reader import full_turns, load_run
from dpr_lab.storage.readers import read_any
from dpr_lab.storage.tables.columns import AXES, TO_SECONDS, find_columns, find_torques, with_still_joint2
from dpr_lab.storage.tables.plausible import (
    PLAUSIBLE,
    check_spacing,
    early_notes,
    gap_notes,
    odd_notes,
    outliers,
    unwrapped,
)
from dpr_lab.storage.tables.table import Table
from dpr_lab.storage.writer import whole_run

Angles = Literal["absolute", "relative"]
Zero = Literal["upright", "hanging"]
Unit = Literal["rad", "deg", "counts"]
TimeUnit = Literal["s", "ms", "us"]
TorqueChoice = Literal["measured", "commanded", "none"]
ArmKind = Literal["clamped", "prescribed"]
TO_RADIANS = {"rad": 1.0, "deg": np.pi / 180}


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """How a table is to be read."""

    angles: Angles = "absolute"
    """Whether theta2 is the outer rod's own angle to the vertical, or its angle to the inner rod."""
    zero: Zero = "upright"
    """Where the rods point at angle 0."""
    unit: Unit | None = "rad"
    """`counts` are read by the rig's encoders; `angles` and `zero` then come from the rig as well. None: what the
    columns' names say, rad where they say nothing."""
    time_unit: TimeUnit | None = "s"
    """None: what the column's name says, s where it says nothing."""
    columns: Mapping[str, str] = field(default_factory=dict)
    """Column name (or number, without a header) of t, theta0, theta1, theta2, where the guess by name fails."""
    take: tuple[str, ...] = ()
    """What of the file: the topic of a bag, arrays or groups of a .mat, .npz or .h5, the points pivot, elbow, tip."""
    rate_hz: float | None = None
    """Rows a second of a table without time; a column of times is then not used."""
    wrap: float | None = None
    """At how much the logger wraps, in the table's unit: 360, 4096, ...; without it whole turns are noticed."""
    scale: Mapping[str, float] = field(default_factory=dict)
    """By axis, what a value of the table is multiplied by."""
    offset: Mapping[str, float] = field(default_factory=dict)
    """By axis, what is then added, in the table's unit."""
    start_s: float = 0.0
    """Rows earlier than this after the table's first row are left out."""
    duration_s: float | None = None
    """Length of the part to keep; None for all."""
    pose: str | None = None
    """Pose of the rig that was released from, where it is known."""
    note: str = ""
    torque: TorqueChoice | None = None
    """The only kind of torques to keep, or that torques which do not say it are of; `none`: none that it holds. None:
    all there are, of two kinds both."""
    input_delay_s: float = 0.0
    """How much later than they were logged they act, where that is known."""
    arm: ArmKind = "clamped"
    """Whether the arm was held, or moved as its encoder says."""

    def __post_init__(self) -> None:
        unknown = (set(self.columns) - {"t"} | set(self.scale) | set(self.offset)) - set(AXES)
        if unknown:
            raise ValueError(f"columns can be given for t, {', '.join(AXES)}, not for {', '.join(sorted(unknown))}")
        positive = [self.rate_hz, self.wrap]
        if not all(value is None or 0 < value < np.inf for value in positive) or 0.0 in self.scale.values():
            raise ValueError("rate_hz and wrap must be positive and finite, scale must not be 0")
        if not np.isfinite([*self.scale.values(), *self.offset.values()]).all():
            raise ValueError("scale and offset must be finite")
        if not abs(self.input_delay_s) <= PLAUSIBLE.input_delay_s:
            raise ValueError(f"input_delay_s must be within {PLAUSIBLE.input_delay_s:g} s, not {self.input_delay_s:g}")
        if not self.start_s >= 0 or (self.duration_s is not None and not self.duration_s > 0):
            raise ValueError("start_s must not be negative, duration_s must be positive")


@dataclass(frozen=True, slots=True)
class Understood:
    """What was understood of a table."""

    t: NDArray[np.float64]
    theta: NDArray[np.float64]
    counts: NDArray[np.int64] | None
    t_offset_s: float
    columns: Mapping[str, str]
    notes: tuple[str, ...]
    options: ImportOptions
    """With the units that were found."""
    kind: str
    torques: Mapping[str, NDArray[np.float64]] = field(default_factory=dict)
    """(n, 2) by kind, `measured` first; of no kind where their columns do not say it; none of a free swing."""
    torque_columns: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Of each kind, the columns of joint 1 and 2."""

    @property
    def rate_hz(self) -> float:
        """Rows a second, by the median step."""
        return round(float(1 / np.median(np.diff(self.t))), 6)


def import_csv(file: Path | str, rig: Rig, options: ImportOptions | None = None, out: Path | str | None = None) -> Run:
    """Read a table as a run, and write it as a run file when `out` is given.

    The run starts at t = 0 with the first row kept and has no rest before it.

    Args:
        file: the table, of a kind in `dpr_lab.storage.readers`; of a text one comma, semicolon, tab or blank between
            columns, `#`, `%` or `//` before comments
        rig: the rig it was recorded on
        options: what the table's numbers mean
        out: run file to write

    Raises:
        RunError: not a table of numbers, a column that cannot be found, time that runs backwards (with its line),
            more than 10 % of rows without a value, nothing left after the slice, or a joint that turns although no rod
            is said to hang on it.
    """
    swing = understand(file, rig, options)
    path = Path(file)
    run = run_of(path, rig, swing)
    if out is None:
        return run
    with whole_run(out, _metadata(path, rig, swing)) as writer:
        writer.table(swing.t, swing.theta, swing.counts, list(swing.torques.values()) or None)
        writer.finish(RunSummary(release_tick=0, notes=swing.notes))
    return load_run(out)


def understand(file: Path | str, rig: Rig, options: ImportOptions | None = None) -> Understood:
    """What a table is understood as, before it is a run; arguments and errors as of `import_csv`."""
    options = options or ImportOptions()
    if options.pose is not None and options.pose not in rig.poses:
        raise RunError(f"{file}: pose {options.pose!r} is not one of the rig's: {', '.join(rig.poses) or 'none'}")
    path = Path(file)
    table, given = read_any(path, options.take), dict(options.columns)
    if rig.rods.mounted != "both":
        table, given = with_still_joint2(table, given)
    columns = find_columns(table, given, options.unit, options.time_unit, options.rate_hz)
    options = replace(options, unit=columns.unit, time_unit=columns.time_unit)
    _refuse_conventions(table, options)
    t = _times(table, columns.names, options)
    found = {axis: table.column(columns.names[axis]) for axis in AXES if axis in columns.names}
    readings, unrecorded = _recorded(table, found)
    _check_forwards(table, t)
    outliers = _drop_outliers(readings, rig, options)
    driving = find_torques([*table.names, *table.other_lengths], options.torque, path)
    known = {name: _torque(table, name) for pair in driving.values() for name in pair}
    kept, notes = _rows_to_keep(path, t, {**readings, **known}, options)
    values = {axis: _scaled(column[kept], axis, options) for axis, column in readings.items()}
    time = t[kept] - t[kept][0]
    check_spacing(path, time)
    counts = _counts(path, values, rig) if options.unit == "counts" else None
    theta, unwrapped = (rig.theta(counts), []) if counts is not None else _theta(values, options)
    notes += outliers + unrecorded + unwrapped + early_notes(t[kept]) + gap_notes(time)
    notes += odd_notes(time, theta, options.zero == "upright" and options.unit != "counts")
    if driving and not any(column[kept].any() for column in known.values()):
        driving, notes = {}, [*notes, "its torques are zero throughout: a free swing"]
    torques = {kind: np.stack([known[name][kept] for name in pair], axis=1) for kind, pair in driving.items()}
    if torques:
        notes += [f"driven by {' and '.join(torques) or 'known'} torques, each held until the next row"]
    notes = (*table.notes, *columns.notes, *notes)
    first = float(t[kept][0])
    return Understood(time, theta, counts, first, columns.names, notes, options, table.kind, torques, driving)


def _refuse_conventions(table: Table, options: ImportOptions) -> None:
    said = (options.unit, options.angles, options.zero)
    if table.settled and said != ("rad", "absolute", "upright"):
        raise RunError(
            f"{table.path}: angles from points are absolute, upright is 0, in rad: leave out the options that say else"
        )


def _torque(table: Table, name: str) -> NDArray[np.float64]:
    if name in table.other_lengths:
        raise RunError(
            f"{table.path}: torques of another length: {table.other_lengths[name]:,} values of {name!r} for"
            f" {len(table.lines):,} rows"
        )
    return table.column(name)


def _times(table: Table, columns: Mapping[str, str], options: ImportOptions) -> NDArray[np.float64]:
    if options.rate_hz is not None:
        return np.arange(len(table.lines)) / options.rate_hz
    assert options.time_unit is not None
    return table.column(columns["t"]) * TO_SECONDS[options.time_unit]


def _scaled(column: NDArray[np.float64], axis: str, options: ImportOptions) -> NDArray[np.float64]:
    """What was read without wraps, scale and offset."""
    if options.wrap is not None:
        column = np.unwrap(column, period=options.wrap)
    return column * options.scale.get(axis, 1.0) + options.offset.get(axis, 0.0)


def _recorded(
    table: Table, readings: dict[str, NDArray[np.float64]]
) -> tuple[dict[str, NDArray[np.float64]], list[str]]:
    """The axes whose column holds a number, and a note for one that holds none; both rods are needed."""
    silent = [axis for axis, column in readings.items() if not np.isfinite(column).any()]
    for axis in silent:
        if axis != "theta0":
            raise RunError(f"{table.path}: the column of {axis} is empty throughout; both rods are needed")
    kept = {axis: column for axis, column in readings.items() if axis not in silent}
    return kept, [f"{axis}: its column is empty throughout, so this axis was not recorded" for axis in silent]


def _check_forwards(table: Table, t: NDArray[np.float64]) -> None:
    known = np.flatnonzero(np.isfinite(t))
    backwards = np.flatnonzero(np.diff(t[known]) < 0)
    if len(backwards):
        row, before = known[backwards[0] + 1], known[backwards[0]]
        raise RunError(
            f"{table.path}: {_line(table, int(row))}: time runs backwards, from {t[before]:g} s to {t[row]:g} s;"
            " cut the table there, each recording is a run of its own"
        )


def _line(table: Table, row: int) -> str:
    return f"{'line' if table.heading or table.kind == 'text table' else 'row'} {table.lines[row]}"


def _rows_to_keep(
    path: Path, t: NDArray[np.float64], readings: Mapping[str, NDArray[np.float64]], options: ImportOptions
) -> tuple[NDArray[np.intp], list[str]]:
    known = t[np.isfinite(t)]
    if not len(known):
        raise RunError(f"{path}: the time column holds no number")
    start = known[0] + options.start_s
    stop = np.inf if options.duration_s is None else start + options.duration_s
    # A row without a time belongs where the row before it does.
    at = np.maximum.accumulate(np.where(np.isfinite(t), t, known[0]))
    inside = np.flatnonzero((at >= start) & (at < stop))
    whole = np.isfinite(np.column_stack([t, *readings.values()])[inside]).all(axis=1)
    empty = int(np.count_nonzero(~whole))
    if empty > PLAUSIBLE.nan_share * len(inside):
        raise RunError(f"{path}: {empty} of {len(inside)} rows have no value (NaN): too many for a recording")
    rows = inside[whole]
    if len(rows) == 0:
        raise RunError(f"{path}: no rows between {start:g} s and {stop:g} s; the table ends at {known[-1]:g} s")
    doubled = np.diff(t[rows], prepend=-np.inf) == 0
    kept = rows[~doubled]
    if len(kept) < 2:
        raise RunError(f"{path}: only {len(kept)} row is left: a run needs at least two instants")
    return kept, _counted_notes(empty, int(doubled.sum()))


def _counted_notes(empty: int, doubled: int) -> list[str]:
    notes = [f"rows without a value (NaN), left out as gaps: {empty}"] if empty else []
    return notes + ([f"rows with the time of the row before, left out: {doubled}"] if doubled else [])


def _counts(path: Path, values: Mapping[str, NDArray[np.float64]], rig: Rig) -> NDArray[np.int64]:
    n = len(values["theta1"])
    still = (np.full(n, float(zero)) for zero in rig.encoders.zero_counts)
    columns = np.column_stack([values.get(axis, zero) for axis, zero in zip(AXES, still, strict=True)])
    if np.any(columns != np.round(columns)):
        raise RunError(f"{path}: unit counts needs whole numbers; these have fractions, so they are rad or deg")
    return columns.astype(np.int64)


def _theta(values: Mapping[str, NDArray[np.float64]], options: ImportOptions) -> tuple[NDArray[np.float64], list[str]]:
    assert options.unit is not None
    scaled = {axis: column * TO_RADIANS[options.unit] for axis, column in values.items()}
    smooth = scaled if options.wrap else {axis: unwrapped(column) for axis, column in scaled.items()}
    notes = [f"{axis}: wrapped by the logger, unwrapped" for axis in smooth if np.any(smooth[axis] != scaled[axis])]
    zero = np.pi if options.zero == "hanging" else 0.0
    theta1 = smooth["theta1"] + zero
    theta2 = smooth["theta2"] + (theta1 if options.angles == "relative" else zero)
    return np.column_stack([smooth.get("theta0", np.zeros_like(theta1)), theta1, theta2]), notes


def _drop_outliers(readings: dict[str, NDArray[np.float64]], rig: Rig, options: ImportOptions) -> list[str]:
    """Put NaN in place of readings that are none of the rod; notes how many."""
    notes = []
    for axis, column in readings.items():
        counted = abs(rig.radians_per_count[AXES.index(axis)]) if options.unit == "counts" else None
        scale = (counted or TO_RADIANS[options.unit or "rad"]) * abs(options.scale.get(axis, 1.0))
        known = np.flatnonzero(np.isfinite(column))
        turned = column[known] if options.wrap is None else np.unwrap(column[known], period=options.wrap)
        wild = known[outliers(turned * scale)]
        if len(wild):
            column[wild] = np.nan
            notes.append(f"{axis}: outliers left out: {len(wild)}")
    return notes


def _metadata(path: Path, rig: Rig, swing: Understood) -> RunMetadata:
    options, as_dicts = swing.options, ("columns", "scale", "offset")
    return RunMetadata(
        rig=rig,
        pose=options.pose,
        rate_hz=swing.rate_hz,
        source="import",
        time_source="table",
        url=path.name,
        note=options.note,
        extra={
            "file_sha256": sha256_of(path) if path.is_file() else "",
            "t_offset_s": repr(swing.t_offset_s),
            "columns": json.dumps(dict(swing.columns)),
            "torque_kind": next(iter(swing.torques), ""),
            "input_delay_s": repr(swing.options.input_delay_s),
            "arm": options.arm,
            "options": json.dumps(asdict(options) | {name: dict(getattr(options, name)) for name in as_dicts}),
        },
    )


def run_of(path: Path, rig: Rig, swing: Understood) -> Run:
    """The run that a table is understood as."""
    options, (kind, torques), (_, commanded) = swing.options, *[*swing.torques.items(), ("", None), ("", None)][:2]
    turns = full_turns(rig, options.pose, swing.t, swing.theta)
    return Run(
        name=path.stem,
        t=swing.t,
        theta=as_mounted(swing.theta - turns, rig.rods.mounting, str(path)),
        mounting=rig.rods.mounting,
        counts=swing.counts,
        torques=torques,
        torque_kind=kind,
        commanded=commanded,
        input_delay_s=options.input_delay_s,
        arm=_arm(path, rig, swing) if options.arm == "prescribed" else None,
        pose=options.pose,
        rig_name=rig.name,
        rig_sha256=rig.sha256,
        rate_hz=swing.rate_hz,
        notes=swing.notes,
    )


def _arm(path: Path, rig: Rig, swing: Understood) -> ArmMotion:
    read = "theta0" in swing.columns
    return prescribed_arm(swing.t, swing.theta[:, 0] if read else np.full(len(swing.t), np.nan), rig, str(path))
