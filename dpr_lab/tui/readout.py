"""What the operator reads while placing the rods: each angle beside the one wanted, rest, latch, losses."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from textual.content import Content

from dpr_lab.gate import MAX_REST_SPEED
from dpr_lab.holding import RestReading

GOOD, BAD, UNKNOWN = "✔", "✘", "?"
BAR = 21
"""Cells of a bar; the tolerance takes the middle third."""
TOLERANCES = 3.0
"""How many tolerances the bar reaches to either side."""


@dataclass(frozen=True, slots=True)
class Placement:
    """The rods and the pose they should be in."""

    wanted: tuple[float, float]
    """Angles of inner and outer rod, rad."""
    error: tuple[float, float]
    """How far they are off, whole turns aside, rad."""
    tolerance: float


def placement_text(placement: Placement) -> Content:
    """Two lines for each rod: the angle, and how far and which way to turn it."""
    lines = [
        line
        for name, wanted, error in zip(("inner θ1", "outer θ2"), placement.wanted, placement.error, strict=True)
        for line in _rod(name, wanted, error, placement.tolerance)
    ]
    return Content("\n").join(lines)


def _rod(name: str, wanted: float, error: float, tolerance: float) -> tuple[Content, Content]:
    inside = abs(error) <= tolerance
    angles = f"{name} {math.degrees(wanted + error):+7.1f}°  wanted {math.degrees(wanted):+7.1f}°"
    hint = "inside" if inside else f"turn {-math.degrees(error):+.1f}°"
    said = f"{bar(error, tolerance)} {GOOD if inside else BAD} {hint}"
    return Content.styled(angles, "bold"), Content.styled(said, _tone(inside))


def bar(error: float, tolerance: float) -> str:
    """Where an error lies: `[ ]` is the tolerance, the mark changes inside it, arrows show that it is off the bar."""
    half = BAR // 2
    edge = round(half / TOLERANCES)
    cells = ["─"] * BAR
    cells[half - edge - 1], cells[half + edge + 1] = "[", "]"
    cells[half - edge : half + edge + 1] = " " * (2 * edge + 1)
    place = half + round(error / tolerance * half / TOLERANCES)
    inside = abs(error) <= tolerance
    mark = "◆" if inside else "◀" if place < 0 else "▶" if place >= BAR else "●"
    place = min(max(place, half - edge if inside else 0), half + edge if inside else BAR - 1)
    cells[place] = mark
    return "".join(cells)


def rest_text(rest: RestReading | None) -> Content:
    """Whether the rods are at rest."""
    if rest is None:
        return Content.styled(f"rest   {UNKNOWN} looked at once they are in place", "dim")
    said = "still" if rest.ok else f"moving (limit {MAX_REST_SPEED} rad/s)"
    return Content.styled(f"rest   {GOOD if rest.ok else BAD} {said}, {rest.speed:.3f} rad/s", _tone(rest.ok))


def latch_text(latched: bool | None) -> Content:
    """Whether the latch holds the rods."""
    if latched is None:
        return Content.styled(f"latch  {UNKNOWN}", "dim")
    return Content("latch  ■ CLOSED, the rods are held" if latched else "latch  □ OPEN, the rods are free")


def lost_text(lost: Mapping[str, int], samples: int | None) -> Content:
    """Samples and losses by cause."""
    counted = "" if samples is None else f"{samples} samples, "
    causes = ", ".join(f"{n} {cause.replace('_', ' ')}" for cause, n in lost.items() if n)
    said = f"lost   {BAD if causes else GOOD} {counted}{causes or 'none lost'}"
    return Content.styled(said, "$error" if causes else "")


def degrees(theta: Sequence[float]) -> str:
    """Three angles, short; 0 is upright and 180 hanging."""
    return "  ".join(f"θ{joint} {math.degrees(angle):+.1f}°" for joint, angle in enumerate(theta))


def _tone(good: bool) -> str:
    return "$success" if good else "$warning"
