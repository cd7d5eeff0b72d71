"""Convert points that were tracked in a video to the angles of the rods.

The points are from Tracker, DeepLabCut, or columns of x and y. The inner rod is the line from pivot to elbow, and the
outer rod is the line from elbow to tip:

    theta1 = pi + atan2(x1, -y1),  (x1, y1) = elbow - pivot
    theta2 = pi + atan2(x2, -y2),  (x2, y2) = tip - elbow

where y points upwards. A table with one moving point contains a single rod, from the pivot to this point.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.errors import RunError
from dpr_lab.progress import OnImport, unwatched
from dpr_lab.run import FilmNoise
from dpr_lab.shown import counted, percent
from dpr_lab.storage.readers.circle import SETTINGS as CIRCLE
from dpr_lab.storage.readers.circle import most_of_a_circle, radius_error
from dpr_lab.storage.readers.coordinates import OTHER, coordinate, in_plane, only_coordinate
from dpr_lab.storage.readers.downwards import points_downwards
from dpr_lab.storage.readers.exchanged import exchanged
from dpr_lab.storage.readers.rod_lengths import WANTED, rod_length
from dpr_lab.storage.tables.columns import is_time
from dpr_lab.storage.tables.questions.frame_numbers import numbers
from dpr_lab.storage.tables.table import Column, Table, own_name, read_table
from dpr_lab.storage.tables.time_stamps import never_falls, runs, varies


@dataclass(frozen=True, slots=True)
class PointSettings:
    """Limits for tracked points."""

    likelihood: float = 0.6
    """Minimum likelihood of a tracked point. The plots of DeepLabCut use the same limit (its pcutoff)."""
    at_rest: float = 0.05
    """Maximum motion of a point that counts as a fixed pivot, relative to the motion of another point."""
    at_origin: float = 1.5
    """Maximum ratio for which the origin counts as the pivot. The ratio is the scatter of the distances to the origin,
    divided by the scatter of the distances to the centre of the fitted circle. Users of Tracker often place the axes at
    the pivot."""
    near_origin: float = 0.1
    """Maximum distance of the centre from the origin, relative to the length of the rod, for a note about the origin.
    Such a distance is rarely a coincidence: probably the user placed the axes at the pivot."""
    repeats: float = 0.2
    """Maximum ratio of the motion in a frame to the motion in the neighbouring frames for which the frame counts as a
    repetition of the previous frame."""
    share_of_repeats: float = 0.1
    """Minimum share of repeated frames for which they are removed. In a slow motion, noise makes a few frames look
    repeated."""
    straight: float = 1e-3
    """Maximum second difference of a point in an interpolated frame, relative to the median of all second
    differences."""
    fine: float = 20.0
    """Minimum median of the second differences, in units of the resolution of the table, for the test of interpolated
    points. Coarser coordinates, such as whole pixels, lie on straight lines by chance."""
    chance: float = 3.0
    """Minimum excess of the number of frames on straight lines over the number expected by chance, in standard
    deviations."""


SETTINGS = PointSettings()
PLAIN = "table of points"
PARTS = {1: ("pivot", "tip"), 2: ("pivot", "elbow", "tip")}
_ANGLE = re.compile(r"theta|(?<![a-z])th(?![a-z])|phi|angle|^q\d|joint")
_NO_POINT = re.compile(r"acc|gyro|omega|vel|speed|rate|force|torque|cmd|command|^(a|v|w|f|d|mag|d*dot)\d?$")
"""Pattern of vectors in the plane that are no positions, for example `acc` for the columns `accX` and `accY`."""

_REPEATED = (
    "repeat the previous frame while the rods move, as in a video that was converted from fewer frames per second"
)
_INTERPOLATED = (
    "are interpolated on a straight line in equal steps, as by trackers that fill frames in which they lost a point"
)


@dataclass(frozen=True, slots=True)
class _Point:
    name: str
    xy: Array
    """(n, 2) coordinates, x to the right and y upwards; NaN if the point was not detected."""
    doubt: str = ""
    """Warning about an estimated or corrected point; empty if there is none."""


def read_text(path: Path, take: Sequence[str], on_progress: OnImport = unwatched, *, points: bool = True) -> Table:
    """Read a text table, and convert points to angles unless `points` is false and `take` is empty.

    Raises:
        RunError: as for `dpr_lab.storage.tables.table.read_table`, or the points are not the ends of one or two rods.
    """
    table = read_table(path, on_progress)
    if not (points or take):
        return table
    kind, tracked, note = _points(table)
    if not tracked:
        if take:
            raise RunError(f"{path}: is a single table without parts: remove --take")
        note = (
            "the coordinates of points are not used, because the table also contains angles. If the angles do not refer"
            " to the pivot, remove them from the table: then the coordinates are imported"
        )
        unused = _points(table, despite_angles=True)[1]
        if any(all(map(varies, point.xy.T)) and not _NO_POINT.search(point.name) for point in unused):
            table = replace(table, notes=(*table.notes, note))
        return _without_copies(table)
    return _angles(replace(table, kind=kind, notes=(*table.notes, note) if note else table.notes), tracked, take)


def _without_copies(table: Table) -> Table:
    """Remove columns that repeat the name and values of an earlier column."""
    columns = [
        column
        for place, column in enumerate(table.columns)
        if not any(
            column.name == other.name and np.array_equal(column.values, other.values, equal_nan=True)
            for other in table.columns[:place]
        )
    ]
    return replace(table, columns=tuple(columns))


def _points(table: Table, despite_angles: bool = False) -> tuple[str, list[_Point], str]:
    """Return the kind of a table, its points, and a possibly empty note.

    Points of a table that also contains angles are omitted, unless `despite_angles` is true.
    """
    rows = {row[0].lower(): row for row in table.heading if row and len(row) == len(table.names)}
    if "bodyparts" in rows and "coords" in rows:
        columns = zip(rows["bodyparts"], (coord.lower() for coord in rows["coords"]), strict=True)
        return "table of points by DeepLabCut", list(_upwards(table, list(columns)[1:], 1, -1.0)), ""
    names = [own_name(name).lower() for name in table.names]
    if names.count("x") > 1 and names.count("x") == names.count("y"):
        columns = list(zip(_groups(table), names, strict=True))
        return "table of points by Tracker", list(_upwards(table, columns, 0, 1.0)), ""
    ungrouped = [own_name(name) for name in table.names]
    # a program that did not compute the angle writes the same value in all rows
    angles = not despite_angles and any(
        _ANGLE.search(name.lower()) and varies(column) for name, column in zip(ungrouped, table.values, strict=True)
    )
    alone, axes, note = in_plane([only_coordinate(name) for name in ungrouped], table.values)
    timed = len(ungrouped) > 2 and any(map(is_time, table.names))
    # x is the time, as in a plot of one quantity
    x = (column for (_, axis), column in zip(alone, table.values, strict=True) if axis == "x")
    plotted = not timed and any(map(never_falls, x))
    if sorted(axis for _, axis in alone if axis) == ["x", "y"] and (plotted or not angles):
        return ("", [], "") if plotted else (_of_plane(axes), list(_upwards(table, alone, 0, -1.0)), note)
    columns, axes, note = in_plane([coordinate(name) for name in ungrouped], table.values)
    pairs = {name for name, _ in columns if {(name, "x"), (name, "y")} <= set(columns)}
    if not pairs or angles:
        return "", [], ""
    return _of_plane(axes), list(_upwards(table, [c if c[0] in pairs else OTHER for c in columns], 0, -1.0)), note


def _of_plane(axes: str) -> str:
    return f"{PLAIN}, of which the coordinates {axes} are used" if axes else PLAIN


def _groups(table: Table) -> list[str]:
    """Return the name of the point for each column of a Tracker table.

    In the row above the header, the name of a point is above the first column of the point. Points without a name are
    numbered.
    """
    above = [row for row in table.heading if row != table.names and any(row)]
    row = (above[-1] if above else ()) + ("",) * len(table.names)
    groups, current, number, has_x = [], "", 0, False
    for name, label in zip(table.names, row, strict=False):
        if label:
            current, has_x = label, False
        if name.lower() == "x":
            number += 1
            current = f"point {number}" if has_x or not current else current
            has_x = True
        groups.append(current)
    return groups


def _upwards(table: Table, columns: list[tuple[str, str]], first: int, up: float) -> Iterator[_Point]:
    column_of = {}
    for k, column in enumerate(columns):
        if column[1] in ("x", "y", "likelihood") and column_of.setdefault(column, k + first) != k + first:
            raise RunError(
                f"{table.path}: two columns of {column[1]} for the point {column[0]!r}: export the points of only"
                " one animal"
            )
    for name in dict.fromkeys(name for name, _ in columns):
        if (name, "x") not in column_of or (name, "y") not in column_of:
            continue
        x, y = (table.values[column_of[name, axis]] for axis in "xy")
        point = np.column_stack([x, up * y])
        if (name, "likelihood") in column_of:
            point[~(table.values[column_of[name, "likelihood"]] >= SETTINGS.likelihood)] = np.nan
        yield _Point(name, point)


def _angles(table: Table, points: list[_Point], take: Sequence[str]) -> Table:
    pivot, *ends = _chosen(table, points, take)
    rods = [end.xy - start.xy for start, end in pairwise([pivot, *ends])]
    upside_down = table.kind.startswith(PLAIN) and points_downwards(rods)
    again, filled = _repeats(ends), _interpolated(ends)
    removed = [
        f"{percent(float(mask.mean()))} of the frames {words}: these frames are removed"
        for mask, words in ((again, _REPEATED), (filled, _INTERPOLATED))
        if mask.any()
    ]
    if removed:
        real = ~(again | filled)
        table = replace(table, frames=numbers(table)).rows(real, *removed)
        rods = [rod[real] for rod in rods]
    if upside_down:
        rods = [rod * (1, -1) for rod in rods]
    used = ", ".join(f"{part} = {point.name}" for part, point in zip(PARTS[len(ends)], [pivot, *ends], strict=True))
    axes = ("theta1", "theta2")[: len(rods)]
    angles = [_direction(rod) for rod in rods]
    lengths = [rod_length(table.path, axis, rods[: k + 1]) for k, axis in enumerate(axes)]
    choice = "--take selects other points; `--take origin,NAME` takes the origin of the coordinates as pivot"
    notes = [f"points used: {used} ({choice})", *filter(None, [point.doubt for point in (pivot, *ends)])]
    for axis, angle, length in zip(axes, angles, lengths, strict=True):
        if length.wrong.any():
            angle[length.wrong] = np.nan
            notes.append(
                f"{axis}: in {counted(int(length.wrong.sum()), 'frame')} the length of the rod is wrong, so the"
                " tracker followed another object: these readings are excluded"
            )
        notes.append(f"{axis}: noise {length.std:.2g} rad, from the scatter of the rod's length in the picture")
        if length.varies:
            notes.append(
                f"the length of the rod of {axis} in the picture changes by {percent(length.varies)} with the pose: the"
                " camera does not look along the joint axes"
            )
    std = tuple(length.std for length in lengths)
    # a table of several points may repeat the time for each point
    times = {column.name: replace(column, strange="") for column in reversed(table.columns) if is_time(column.name)}
    clocks = list(times.values())[::-1] or [column for column in table.columns if runs(column.values)]
    return replace(
        table,
        columns=(*clocks, *map(Column, axes, angles)),
        notes=(*table.notes, *notes),
        settled=True,
        film_noise=FilmNoise(std, float(np.mean([length.correlation for length in lengths]))) if min(std) > 0 else None,
    )


def _repeats(ends: list[_Point]) -> Flags:
    """Detect frames that repeat the previous frame, apart from tracking noise.

    In a repeated frame, the points hardly move, although they move in the same direction before and after this frame.
    The result is a mask (n,) of the frames; it is all False if few frames are repeated.
    """
    steps = np.diff(np.concatenate([end.xy for end in ends], axis=1), axis=0)
    sizes = np.sqrt((steps**2).sum(axis=1))
    again = np.zeros(len(ends[0].xy), dtype=np.bool_)
    if len(steps) < 3:
        return again
    onwards = (steps[:-2] * steps[2:]).sum(axis=1) > 0
    again[2:-1] = onwards & (sizes[1:-1] < SETTINGS.repeats * np.minimum(sizes[:-2], sizes[2:]))
    return again if again.mean() > SETTINGS.share_of_repeats else np.zeros_like(again)


def _interpolated(ends: list[_Point]) -> Flags:
    """Detect frames in which a moving point is interpolated linearly between other frames.

    The result is a mask (n,) of the frames. Both coordinates of the point have equal steps before and after such a
    frame, to the last digits. Points that are tracked to a whole pixel and then scaled have some such frames by chance.
    The expected number of these frames is computed as if the coordinates were independent.
    """
    unreal = np.zeros(len(ends[0].xy), dtype=np.bool_)
    for end in ends:
        steps = np.diff(end.xy, axis=0)
        bends = np.abs(np.diff(steps, axis=0))
        known = bends[np.isfinite(bends).all(axis=1)]
        if len(known) < 3:
            continue
        usual = np.median(known, axis=0)
        values = [np.unique(column[np.isfinite(column)]) for column in end.xy.T]
        resolution = np.array([np.diff(column).min(initial=np.inf) for column in values])
        if (usual > SETTINGS.fine * resolution).all():
            equal = bends <= SETTINGS.straight * usual + 2 * resolution
            straight, by_chance = equal.all(axis=1), len(equal) * float(equal.mean(axis=0).prod())
            if straight.sum() <= by_chance + SETTINGS.chance * np.sqrt(by_chance + 1):
                continue
            unreal[1:-1] |= straight & (np.abs(steps[1:]) > SETTINGS.straight * usual + 2 * resolution).any(axis=1)
    return unreal


def _chosen(table: Table, points: list[_Point], take: Sequence[str]) -> list[_Point]:
    """Select the pivot and the ends of the rods, in this order.

    The points named in `take` are used; `origin` is the origin of the coordinates. If `take` is empty, all points are
    used. They are sorted by the numbers at the end of their names; without such numbers, the order of the table is
    kept. A missing pivot is estimated.
    """
    origin = _Point("(the origin)", np.zeros(points[0].xy.shape))
    by_name = {"origin": origin} | {point.name.lower(): point for point in points}
    available = ", ".join(point.name for point in points)
    unknown = [name for name in take if name.lower() not in by_name]
    if unknown:
        raise RunError(
            f"{table.path}: has no point {unknown[0]!r}; its points: {available}; the pivot may also be origin, the"
            " origin of the coordinates"
        )
    chosen = [by_name[name.lower()] for name in take] or _by_number(points)
    if any(point is origin for point in chosen[1:] or chosen):
        raise RunError(
            f"{table.path}: the origin of the coordinates can only be the pivot, followed by other points:"
            " --take origin,NAME"
        )
    if len(chosen) > 3:
        raise RunError(f"{table.path}: contains the points {available}: select with --take {WANTED}")
    if len(chosen) == 1 or (len(chosen) == 2 and _moved(chosen[0]) > SETTINGS.at_rest * _moved(chosen[1])):
        ends = _put_back(chosen, None)
        return [_pivot_of(table, ends[0]), *ends]
    pivot = np.nanmedian(chosen[0].xy, axis=0)  # the pivot rests, so its noise differs from that of the rods
    return [_Point(chosen[0].name, np.broadcast_to(pivot, chosen[0].xy.shape)), *_put_back(chosen[1:], pivot)]


def _put_back(ends: list[_Point], pivot: Array | None) -> list[_Point]:
    """Exchange elbow and tip again in the frames in which the tracker exchanged them."""
    if len(ends) != 2:
        return ends
    elbow, tip = ends
    mask = exchanged(elbow.xy, tip.xy, pivot)
    if not mask.any():
        return ends
    doubt = (
        f"the points {elbow.name} and {tip.name} are exchanged in {counted(int(mask.sum()), 'frame')}, as by a"
        " tracker that detects two equal marks: they were put back, so that the elbow moves on a circle and both points"
        " move little from frame to frame"
    )
    swap = mask[:, None]
    return [
        _Point(elbow.name, np.where(swap, tip.xy, elbow.xy), doubt),
        _Point(tip.name, np.where(swap, elbow.xy, tip.xy)),
    ]


def _by_number(points: list[_Point]) -> list[_Point]:
    """Sort points by the number at the end of their names, if possible."""
    numbered = all(re.search(r"\d$", point.name) for point in points)
    return sorted(points, key=lambda point: int(re.findall(r"\d+", point.name)[-1])) if numbered else points


def _moved(point: _Point) -> float:
    """Return the extent of a point's motion between its 5 % and 95 % quantiles."""
    valid = point.xy[np.isfinite(point.xy).all(axis=1)]
    return float(np.hypot(*np.ptp(np.quantile(valid, [0.05, 0.95], axis=0), axis=0))) if len(valid) else 0.0


def _pivot_of(table: Table, end: _Point) -> _Point:
    """Estimate the pivot of a rod.

    The pivot is the origin, or the centre of the circle on which the end of the rod moves.
    """
    valid = end.xy[np.isfinite(end.xy).all(axis=1)]
    if len(valid) < 3:
        raise RunError(f"{table.path}: the point {end.name!r} was detected in too few frames")
    circle = most_of_a_circle(valid)
    if circle is None:
        raise RunError(f"{table.path}: the point {end.name!r} does not move on a circle: also track the pivot")
    centre, near = circle
    scatter, about_origin = (float(np.std(np.hypot(*(valid[near] - c).T))) for c in (centre, np.zeros(2)))
    if about_origin <= SETTINGS.at_origin * scatter:
        return _Point("(the origin)", np.zeros(end.xy.shape))
    distance = float(np.hypot(*centre) / np.median(np.hypot(*(valid[near] - centre).T)))
    doubt = ""
    if radius_error(valid[near], centre) > CIRCLE.short_arc:
        doubt = f"the arc of {end.name} is too short for its centre: track the pivot, or use --take origin,{end.name}"
    elif distance < SETTINGS.near_origin:
        doubt = (
            f"the origin of the coordinates is {percent(distance)} of the rod's length from this centre: if the axes"
            f" were placed at the pivot, use --take origin,{end.name}"
        )
    return _Point(f"(centre of the circle of {end.name})", np.broadcast_to(centre, end.xy.shape), doubt)


def _direction(rod: Array) -> Array:
    """Compute the unwrapped angle (n,) of a rod, rad; 0 = upright, pi = hanging."""
    swung = np.arctan2(rod[:, 0], -rod[:, 1])
    valid = np.isfinite(swung)
    swung[valid] = np.unwrap(swung[valid])
    return np.pi + swung
