"""Turn a logger's text table into a run.

Times stay as the table has them: uneven steps and gaps are kept, nothing is resampled. Rows without a value and rows
with the time of the row before are left out, counted and reported in the run's notes.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dpr_lab.configs import sha256_of
from dpr_lab.errors import RunError
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.reader import full_turns, load_run
from dpr_lab.storage.table import Table, read_table
from dpr_lab.storage.writer import RunWriter

AXES = ("theta0", "theta1", "theta2")
MOST_NAN = 0.1
TO_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
TO_RADIANS = {"rad": 1.0, "deg": np.pi / 180}
SLOWEST_S, LONGEST_S = 10.0, 1e6
"""Median step between rows, and time from the first to the last, above which a table is no swing."""
GAP = 1.5  # steps longer than this many median steps are reported as gaps

_TIME_NAME = r"(t|time|timestamp)?({unit})?(?<=.)"
_TIME_SUFFIX = {"s": "s|sec|seconds", "ms": "ms|msec|milliseconds", "us": "us|usec|microseconds"}
_ANGLE_NAME = r"(theta|th|phi|q|angle|joint|pos|position|θ|φ){axis}(rad|radians?|deg|degrees?)?"
_COUNT_NAME = r"(counts?|enc|encoder){axis}(counts?|ticks?)?"
_SAID_TIME_UNIT = re.compile(r"(?<![a-z])(ms|us|s)(?![a-z])")
_SAID_UNIT = re.compile(r"(?<![a-z])(rad|deg|counts)(ians|rees)?(?![a-z])|(°)")


@dataclass(frozen=True, slots=True)
class ImportOptions:
    """How a table is to be read."""

    angles: Literal["absolute", "relative"] = "absolute"
    """Whether theta2 is the outer rod's own angle to the vertical, or its angle to the inner rod."""
    zero: Literal["upright", "hanging"] = "upright"
    """Where the rods point at angle 0."""
    unit: Literal["rad", "deg", "counts"] = "rad"
    """`counts` are read by the rig's encoders; `angles` and `zero` then come from the rig as well."""
    time_unit: Literal["s", "ms", "us"] = "s"
    columns: Mapping[str, str] = field(default_factory=dict)
    """Column name (or number, without a header) of t, theta0, theta1, theta2, where the guess by name fails."""
    start_s: float = 0.0
    """Rows earlier than this after the table's first row are left out."""
    duration_s: float | None = None
    """Length of the part to keep; None for all."""
    pose: str | None = None
    """Pose of the rig that was released from, where it is known."""
    note: str = ""

    def __post_init__(self) -> None:
        unknown = set(self.columns) - {"t", *AXES}
        if unknown:
            raise ValueError(f"columns can be given for t, {', '.join(AXES)}, not for {', '.join(sorted(unknown))}")
        if not self.start_s >= 0 or (self.duration_s is not None and not self.duration_s > 0):
            raise ValueError("start_s must not be negative, duration_s must be positive")


@dataclass(frozen=True, slots=True)
class _Swing:
    t: NDArray[np.float64]
    theta: NDArray[np.float64]
    counts: NDArray[np.int64] | None
    t_offset_s: float
    columns: dict[str, str]
    notes: tuple[str, ...]

    @property
    def rate_hz(self) -> float:
        return round(float(1 / np.median(np.diff(self.t))), 6)


def import_csv(file: Path | str, rig: Rig, options: ImportOptions | None = None, out: Path | str | None = None) -> Run:
    """Read a table as a run, and write it as a run file when `out` is given.

    The run starts at t = 0 with the first row kept and has no rest before it.

    Args:
        file: the table; comma, semicolon, tab or blank between columns, `#`, `%` or `//` before comments
        rig: the rig it was recorded on
        options: what the table's numbers mean
        out: run file to write

    Raises:
        RunError: not a table of numbers, a column that cannot be found, time that runs backwards (with its line),
            more than 10 % of rows without a value, or nothing left after the slice.
    """
    options = options or ImportOptions()
    if options.pose is not None and options.pose not in rig.poses:
        raise RunError(f"{file}: pose {options.pose!r} is not one of the rig's: {', '.join(rig.poses) or 'none'}")
    path = Path(file)
    swing = _read_swing(path, rig, options)
    if out is None:
        return _run(path, rig, options, swing)
    with RunWriter(out, _metadata(path, rig, options, swing)) as writer:
        writer.table(swing.t, swing.theta, swing.counts)
        writer.finish(RunSummary(release_tick=0, notes=swing.notes))
    return load_run(out)


def guess_columns(names: tuple[str, ...], unit: str = "rad", time_unit: str = "s") -> dict[str, str]:
    """Which column is what, by the names loggers use; quantities without exactly one match are left out."""
    patterns = {"t": re.compile(_TIME_NAME.format(unit=_TIME_SUFFIX[time_unit]))}
    for axis, quantity in enumerate(AXES):
        patterns[quantity] = re.compile((_COUNT_NAME if unit == "counts" else _ANGLE_NAME).format(axis=axis))
    found = {q: [n for n in names if p.fullmatch(_bare(n))] for q, p in patterns.items()}
    return {quantity: matches[0] for quantity, matches in found.items() if len(matches) == 1}


def _read_swing(path: Path, rig: Rig, options: ImportOptions) -> _Swing:
    table = read_table(path)
    columns = _columns(table, options)
    t = table.column(columns["t"]) * TO_SECONDS[options.time_unit]
    readings = {axis: table.column(columns[axis]) for axis in AXES if axis in columns}
    _check_forwards(table, t)
    kept, notes = _rows_to_keep(path, t, readings, options)
    values = {axis: column[kept] for axis, column in readings.items()}
    time = t[kept] - t[kept][0]
    _check_spacing(path, time)
    if options.unit == "counts":
        counts = _counts(path, values, rig)
        theta, unwrapped = rig.theta(counts), []
    else:
        counts = None
        theta, unwrapped = _theta(values, options)
    notes += unwrapped + _early_notes(t[kept]) + _gap_notes(time) + _upright_notes(theta)
    return _Swing(time, theta, counts, float(t[kept][0]), columns, (*table.notes, *notes))


def _columns(table: Table, options: ImportOptions) -> dict[str, str]:
    columns = guess_columns(table.names, options.unit, options.time_unit) | dict(options.columns)
    there = f"the table has: {', '.join(table.names)}"
    for quantity, name in options.columns.items():
        if table.names.count(name) != 1:
            raise RunError(f"{table.path}: {table.names.count(name)} columns are named {name!r} ({quantity}); {there}")
    missing = [quantity for quantity in ("t", "theta1", "theta2") if quantity not in columns]
    if missing:
        raise RunError(
            f"{table.path}: no single column found for {' and '.join(missing)}; {there}."
            f" Name it, for example columns {missing[0]}=NAME; both rods are needed"
        )
    _check_units(table, columns, options)
    return columns


def _check_units(table: Table, columns: Mapping[str, str], options: ImportOptions) -> None:
    for quantity, name in columns.items():
        pattern, given = (_SAID_TIME_UNIT, options.time_unit) if quantity == "t" else (_SAID_UNIT, options.unit)
        said = pattern.search(name.lower())
        if said and (said[1] or "deg") != given:
            raise RunError(f"{table.path}: column {name!r} says {said[0]}, but the unit given is {given}")


def _check_forwards(table: Table, t: NDArray[np.float64]) -> None:
    known = np.flatnonzero(np.isfinite(t))
    backwards = np.flatnonzero(np.diff(t[known]) < 0)
    if len(backwards):
        row, before = known[backwards[0] + 1], known[backwards[0]]
        raise RunError(
            f"{table.path}: line {table.lines[row]}: time runs backwards, from {t[before]:g} s to {t[row]:g} s;"
            " cut the table there, each recording is a run of its own"
        )


def _check_spacing(path: Path, t: NDArray[np.float64]) -> None:
    apart = float(np.median(np.diff(t)))
    if apart > SLOWEST_S:
        raise RunError(f"{path}: rows are {apart:g} s apart, too far to follow a swing: is the unit of time right?")
    if t[-1] > LONGEST_S:
        raise RunError(f"{path}: the table lasts {t[-1]:g} s, too long for a swing: is the unit of time right?")


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
    if empty > MOST_NAN * len(inside):
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
    scaled = {axis: column * TO_RADIANS[options.unit] for axis, column in values.items()}
    # A logger that wraps jumps by nearly a full turn between two rows, which no rod does.
    smooth = {axis: np.unwrap(column, discont=1.5 * np.pi) for axis, column in scaled.items()}
    notes = [f"{axis}: wrapped by the logger, unwrapped" for axis in smooth if np.any(smooth[axis] != scaled[axis])]
    zero = np.pi if options.zero == "hanging" else 0.0
    theta1 = smooth["theta1"] + zero
    theta2 = smooth["theta2"] + (theta1 if options.angles == "relative" else zero)
    return np.column_stack([smooth.get("theta0", np.zeros_like(theta1)), theta1, theta2]), notes


def _gap_notes(t: NDArray[np.float64]) -> list[str]:
    steps = np.diff(t)
    gaps = steps[steps > GAP * np.median(steps)]
    return [f"gaps kept: {len(gaps)}, the longest {gaps.max():.4g} s"] if len(gaps) else []


def _early_notes(t: NDArray[np.float64]) -> list[str]:
    early = (
        f"the first row, at t = {t[0]:g} s, was taken for the release: if that is t = 0, import with start_s {-t[0]:g}"
    )
    return [early] if t[0] < 0 < t[-1] else []


def _upright_notes(theta: NDArray[np.float64]) -> list[str]:
    above = np.median(np.cos(theta[:, 1:]), axis=0) > 0
    said = "both rods point upwards most of the time: if the table's zero is hanging, import it with zero hanging"
    return [said] if above.all() else []


def _metadata(path: Path, rig: Rig, options: ImportOptions, swing: _Swing) -> RunMetadata:
    return RunMetadata(
        rig=rig,
        pose=options.pose,
        rate_hz=swing.rate_hz,
        source="import",
        time_source="table",
        url=path.name,
        note=options.note,
        extra={
            "file_sha256": sha256_of(path),
            "t_offset_s": repr(swing.t_offset_s),
            "columns": json.dumps(swing.columns),
            "options": json.dumps({**asdict(options), "columns": dict(options.columns)}),
        },
    )


def _run(path: Path, rig: Rig, options: ImportOptions, swing: _Swing) -> Run:
    return Run(
        name=path.stem,
        t=swing.t,
        theta=swing.theta - full_turns(rig, options.pose, swing.t, swing.theta),
        counts=swing.counts,
        pose=options.pose,
        rig_name=rig.name,
        rig_sha256=rig.sha256,
        rate_hz=swing.rate_hz,
        notes=swing.notes,
    )


def _bare(name: str) -> str:
    return re.sub(r"[\W_]+", "", name.lower())
