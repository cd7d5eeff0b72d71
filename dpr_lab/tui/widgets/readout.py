"""Texts of a capture: angles and targets of the rods, rest, latch, lost samples."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from textual.content import Content

from dpr_lab.acquisition.holding import RestReading
from dpr_lab.acquisition.settings import QUALITY_LIMITS
from dpr_lab.arrays import without_turns
from dpr_lab.report.angles import AngleUnit
from dpr_lab.rig import Rig
from dpr_lab.run import LOSS_WORDS
from dpr_lab.tui.recorder.sighting import Sighting

GOOD, BAD, UNKNOWN = "✔", "✘", "?"


@dataclass(frozen=True, slots=True)
class Placement:
    """Target angles of the rods and their errors."""

    wanted: tuple[float, ...]
    """Angles that the operator sets, inner rod first, rad."""
    error: tuple[float, ...]
    """Measured minus target angles without whole turns, rad."""
    tolerance: float


def placement_text(placement: Placement, unit: AngleUnit) -> Content:
    """Return two lines for each rod.

    The first line contains the angle of the rod and its target. The second line contains the remaining angle and the
    direction in which the rod must be turned.
    """
    names = ("inner θ1", "outer θ2") if len(placement.wanted) > 1 else ("rod θ1",)
    lines = [
        line
        for name, wanted, error in zip(names, placement.wanted, placement.error, strict=True)
        for line in _rod(name, wanted, error, placement.tolerance, unit)
    ]
    return Content("\n").join(lines)


def _rod(name: str, wanted: float, error: float, tolerance: float, unit: AngleUnit) -> tuple[Content, Content]:
    inside = abs(error) <= tolerance
    angles = f"{name} {unit.text(wanted + error):>9}  target {unit.text(wanted):>9}"
    hint = "inside" if inside else f"turn {unit.text(-error)}"
    text = f"{bar(error, tolerance)} {GOOD if inside else BAD} {hint}"
    return Content.styled(angles, "bold"), Content.styled(text, _tone(inside))


def bar(error: float, tolerance: float, cells_wide: int = 21, reach: float = 3.0) -> str:
    """Return a text bar that shows an error.

    The brackets `[ ]` mark the tolerance, and a character marks the error. An arrow stands for an error beyond the bar.

    Args:
        error: error, rad
        tolerance: permitted error, rad
        cells_wide: length of the bar, characters
        reach: range of the bar on each side, in tolerances
    """
    half = cells_wide // 2
    edge = round(half / reach)
    cells = ["─"] * cells_wide
    cells[half - edge - 1], cells[half + edge + 1] = "[", "]"
    cells[half - edge : half + edge + 1] = " " * (2 * edge + 1)
    place = half + round(error / tolerance * half / reach)
    inside = abs(error) <= tolerance
    mark = "◆" if inside else "◀" if place < 0 else "▶" if place >= cells_wide else "●"
    place = min(max(place, half - edge if inside else 0), half + edge if inside else cells_wide - 1)
    cells[place] = mark
    return "".join(cells)


def rest_text(rest: RestReading | None, rig: Rig, unit: AngleUnit) -> Content:
    """State whether the rods are at rest, and otherwise which limits are exceeded."""
    if rest is None:
        return Content.styled(f"rest   {UNKNOWN} checked when the rods are at the pose", "dim")
    limits = QUALITY_LIMITS.rest
    faults = []
    if rest.speed > limits.speed:
        faults.append(f"drift {unit.speed(rest.speed)} (limit {unit.speed(limits.speed)})")
    if rest.spread > limits.spread(rig):
        faults.append(f"vibration {unit.size(rest.spread)} (limit {unit.size(limits.spread(rig))})")
    text = "\n         ".join(faults) or f"still, drift {unit.speed(rest.speed)}"
    return Content.styled(f"rest   {GOOD if rest.ok else BAD} {text}", _tone(rest.ok))


def arm_text(rest: RestReading | None, rig: Rig, unit: AngleUnit) -> Content:
    """State whether a movable arm is at rest within its limits, or why not."""
    if rest is None:
        return Content.styled(f"arm    {UNKNOWN} checked when the rods are at the pose", "dim")
    within = ", within its limits" if rig.arm.limits else ""
    text = rest.arm or f"still at {unit.text(rest.theta[0])}{within}"
    return Content.styled(f"arm    {BAD if rest.arm else GOOD} {text}", _tone(not rest.arm))


def latch_text(latched: bool | None) -> Content:
    """Return the state of the latch as text; None is unknown."""
    if latched is None:
        return Content.styled(f"latch  {UNKNOWN} UNKNOWN", "bold $warning")
    return Content("latch  ■ CLOSED, the rods are held" if latched else "latch  □ OPEN, the rods are free")


def angles_text(theta: Sequence[float], unit: AngleUnit, number: int = 2) -> str:
    """Return the absolute angles of the arm and the mounted rods without whole turns.

    The angle of the arm is within half a turn of 0, those of the rods are between -90 and 270 degrees. Rods rest near
    180 degrees (hanging) or 0 (upright), far from the ends of this range.
    """
    arm, *rods = np.asarray(theta)[: 1 + number]
    return unit.all_of([_wrapped(arm, 0.0), *(_wrapped(rod, np.pi / 2) for rod in rods)])


def _wrapped(angle: float, middle: float) -> float:
    return float(middle + without_turns(angle - middle))


def ordered_text(ordered: float, now: float) -> Content:
    """Return a note about a release command whose result is unknown."""
    text = f"latch  {UNKNOWN} UNKNOWN\n       RELEASE was sent {now - ordered:.1f} s ago: the rods may be free"
    return Content.styled(text, "bold $warning")


def old_text(sighting: Sighting, ordered: float | None, now: float, unit: AngleUnit, number: int = 2) -> Content:
    """Return the last readings, marked as outdated; the latch may have moved since then."""
    lines = [latch_text(None) if ordered is None else ordered_text(ordered, now)]
    if sighting.latched is not None and ordered is None:
        was = "CLOSED" if sighting.latched else "OPEN"
        lines.append(Content.styled(f"       {was} when {sighting.ago(now)}", "dim"))
    if sighting.theta is not None:
        lines.append(Content.styled(f"{angles_text(sighting.theta, unit, number)}\n       {sighting.ago(now)}", "dim"))
    return Content("\n").join(lines)


def lost_text(lost: Mapping[str, int], samples: int | None) -> Content:
    """Return the number of samples, and of lost samples by cause, as text."""
    counted = "" if samples is None else f"{samples} samples, "
    return Content.styled(f"lost   {losses(lost, counted)}", "$error" if any(lost.values()) else "")


def losses(lost: Mapping[str, int], counted: str) -> str:
    """Return a mark and the number of lost samples by cause, after the text `counted`."""
    causes = ", ".join(f"{n} {LOSS_WORDS.get(cause, cause)}" for cause, n in lost.items() if n)
    return f"{BAD if causes else GOOD} {counted}{causes or 'none lost'}"


def _tone(good: bool) -> str:
    return "$success" if good else "$warning"
