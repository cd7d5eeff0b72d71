"""Two cursors in a chart, and the values of the lines at the cursors."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from rich.text import Text

from dpr_lab.arrays import Array

NAMES = ("A", "B")


@dataclass(frozen=True, slots=True)
class Cursors:
    """Positions of the two cursors, and the number of the active cursor."""

    at: tuple[float, float]
    """Positions on the x axis."""
    moving: int = 0
    """Active cursor: 0 or 1."""

    def moved(self, by: float) -> "Cursors":
        """Return a copy in which the active cursor is moved."""
        a, b = self.at
        return replace(self, at=(a + by, b) if self.moving == 0 else (a, b + by))

    def second(self) -> "Cursors":
        """Return a copy in which the second cursor is active."""
        return replace(self, moving=1)


def first_cursors(x_view: tuple[float, float]) -> Cursors:
    """Return the initial cursors, at one and two thirds of the view."""
    low, high = x_view
    return Cursors((low + (high - low) / 3, high - (high - low) / 3))


def readings(cursors: Cursors, x_label: str, lines: Sequence[tuple[str, Array, Array]], colours: Sequence[str]) -> Text:
    """Return a text with cursor positions, the values there, and their differences.

    Args:
        cursors: positions of the cursors
        x_label: quantity on the x axis
        lines: name, x and y of each line
        colours: colours of the cursors in the notation of Rich
    """
    text = Text(no_wrap=True, overflow="ellipsis")
    for number, (name, x) in enumerate(zip(NAMES, cursors.at, strict=True)):
        mark = "▸" if number == cursors.moving else " "
        text.append(f"{mark}{name} ", f"bold {colours[number]}").append(f"{x:.4g}  ")
    text.append(f"{_difference(*cursors.at)}   {x_label}")
    values = [(label, _at(cursors, x, y)) for label, x, y in lines]
    for label, (a, b) in values:
        text.append(f"\n{label}: A {_number(a)}  B {_number(b)}  {_difference(a, b)}")
    if len(values) == 2:
        (first_label, first), (other_label, second) = values
        a, b = (_number(after - before) for before, after in zip(first, second, strict=True))
        text.append(f"\n{other_label} − {first_label}: A {a}  B {b}")
    return text


def _at(cursors: Cursors, x: Array, y: Array) -> tuple[float, float]:
    """Interpolate a line linearly at both cursors; return NaN outside its points."""
    if not len(x):
        return float("nan"), float("nan")
    a, b = np.interp(cursors.at, x, y, left=np.nan, right=np.nan).tolist()
    return a, b


def _number(value: float) -> str:
    return "–" if np.isnan(value) else f"{value:.4g}"


def _difference(a: float, b: float) -> str:
    return "B−A –" if np.isnan(b - a) else f"B−A {b - a:+.4g}"
