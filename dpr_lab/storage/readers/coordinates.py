"""Find the coordinates of points by column names, and the plane of a swing in three dimensions."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.storage.readers.circle import most_of_a_circle

_COORDINATE = r"(?:(?P<c1>[xyz])[\W_]*(?P<n1>\w+)|(?P<n2>\w+?)[\W_]*(?P<c2>[xyz]))"
_UNIT = r"([\W_]*(px|pixels?|mm|cm|m)\W*)?"
_BY_NAME = re.compile(rf"{_COORDINATE}{_UNIT}", re.I)
_WORDS = r"[\W_]*(?:coordinate|coord|position|pos)[\W_]*(?:(?:for|of)\b[\W_]*)?(?:the\b[\W_]*)?"
_IN_WORDS = re.compile(rf"(?P<axis>[xyz]){_WORDS}(?P<point>.+?){_UNIT}", re.I)
"""Pattern of a column name in words, such as "x coordinate of the elbow"."""
_ALONE = re.compile(rf"([xyz]){_UNIT}", re.I)
OTHER = ("", "")
"""Point and axis of a column that contains no coordinate."""


@dataclass(frozen=True, slots=True)
class PlaneSettings:
    """Limits for the plane of a swing."""

    far: float = 20.0
    """Maximum radius of the circle on which a point swings, relative to the range of the point. The ratio is 5.7 for
    amplitudes of 5 degrees. A straight line fits a circle of large radius."""
    scatter: float = 0.1
    """Maximum scatter of the distances to the centre of the fitted circle, relative to the range of the point.
    Simulated points (amplitudes of 0.1 to 1.5 rad, noise up to 1 % of the radius, sideways swing of up to 0.3 of the
    amplitude) scatter by at most 0.047 in the correct plane. In a wrong plane, their path is no circle or scatters by
    0.037 to 0.12, always more than in the correct plane."""


SETTINGS = PlaneSettings()


def coordinate(name: str) -> tuple[str, str]:
    """Return the point and the axis that the name of a column states.

    For other columns, both texts are empty.
    """
    if match := _IN_WORDS.fullmatch(name):
        return match["point"].lower(), match["axis"].lower()
    match = _BY_NAME.fullmatch(name)
    return ((match["n1"] or match["n2"]).lower(), (match["c1"] or match["c2"]).lower()) if match else OTHER


def only_coordinate(name: str) -> tuple[str, str]:
    """Return point and axis of a column whose name contains only the axis."""
    match = _ALONE.fullmatch(name)
    return ("point", match[1].lower()) if match else OTHER


def in_plane(columns: Sequence[tuple[str, str]], values: Sequence[Array]) -> tuple[list[tuple[str, str]], str, str]:
    """Replace three coordinates of points by two coordinates in the plane of the swing.

    A point swings on a circle in this plane. The axis with the largest range is horizontal. The other axis of the plane
    is the one for which the distances to the centre of the circle scatter least.

    Args:
        columns: point and axis of each column
        values: values of each column

    Returns:
        Three values. The first is the point and the axis of each column, where x is the horizontal axis and y the other
        axis of the plane. The second is the original names of the two axes. If no plane was found, the columns x and y
        are kept and the second value is empty. The third is a note if points have three coordinates but no plane was
        found; otherwise it is empty.
    """
    place = {column: values[k] for k, column in enumerate(columns)}
    names = dict.fromkeys(name for name, _ in columns)
    points = [name for name in names if {(name, axis) for axis in "xyz"} <= set(place)]
    planes = [plane for name in points if (plane := _plane({axis: place[name, axis] for axis in "xyz"}))]
    if not planes:
        unknown = f"no plane of the swing was found in x, y, z of {', '.join(points)}: the coordinates x and y are used"
        return [OTHER if axis == "z" else (name, axis) for name, axis in columns], "", unknown if points else ""
    _, across, up = min(planes)
    renamed = {(name, axis): (name, new) for name in points for axis, new in ((across, "x"), (up, "y"))}
    return [renamed.get(column, OTHER) for column in columns], f"{across} and {up}", ""


def _plane(point: dict[str, Array]) -> tuple[float, str, str] | None:
    """Find the plane in which a point swings on a circle.

    Return the relative scatter about the circle and the names of the two axes, or None if there is no such plane.
    """
    coordinates = np.column_stack(list(point.values()))
    coordinates = coordinates[np.isfinite(coordinates).all(axis=1)]
    if len(coordinates) < 3:
        return None
    ranges = np.ptp(np.quantile(coordinates, [0.05, 0.95], axis=0), axis=0)  # a tracker may follow another object
    across = int(np.argmax(ranges))
    planes = []
    for up in {0, 1, 2} - {across}:
        path = coordinates[:, [across, up]]
        if (circle := most_of_a_circle(path)) is not None:
            centre, near = circle
            distances, moved = np.hypot(*(path[near] - centre).T), float(np.ptp(path[near, 0]))
            if float(np.median(distances)) <= SETTINGS.far * moved:
                planes.append((float(np.std(distances)) / moved, "xyz"[across], "xyz"[up]))
    best = min(planes, default=None)
    return best if best is not None and best[0] <= SETTINGS.scatter else None
