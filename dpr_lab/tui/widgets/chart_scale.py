"""Scales of a chart: ranges, views, ticks."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.report.envelope import trace

Range = tuple[float, float]
"""Smallest and largest value on an axis."""


@dataclass(frozen=True, slots=True)
class ViewSettings:
    """Settings of zoom and pan."""

    zoom: float = 1.5
    """Factor by which one press of the zoom key changes the width of a view."""
    pan: float = 0.1
    """Shift of a view by one press of the pan key, as a share of its width."""
    narrowest: float = 1e-9
    """Minimum width of a view relative to its values. In a narrower view ticks look equal and rounding becomes
    visible."""


SETTINGS = ViewSettings()


def range_of(values: Iterator[Array] | Sequence[Array]) -> Range:
    """Return the smallest and the largest finite value.

    If both are equal, the range is widened. If there are no finite values, the range is 0 to 1.
    """
    finite = [finite_values for array in values if len(finite_values := array[np.isfinite(array)])]
    if not finite:
        return 0.0, 1.0
    low, high = min(float(a.min()) for a in finite), max(float(a.max()) for a in finite)
    return (low, high) if high - low > smallest(low, high) else (low - 0.5, high + 0.5)


def smallest(low: float, high: float) -> float:
    """Return the width of the narrowest view whose tick values are distinct floating-point numbers."""
    return SETTINGS.narrowest * max(abs(low), abs(high), SETTINGS.narrowest)


def zoomed(view: Range, direction: int) -> Range:
    """Scale a view about its middle by one zoom step."""
    middle, half = (view[0] + view[1]) / 2, (view[1] - view[0]) / 2 * SETTINGS.zoom**-direction
    return (middle - half, middle + half) if half > smallest(*view) else view


def moved(view: Range, direction: int) -> Range:
    """Move a view by one pan step, a share of its width."""
    step = direction * SETTINGS.pan * (view[1] - view[0])
    return view[0] + step, view[1] + step


def visible(x: Array, y: Array, x_view: Range, columns: int) -> tuple[Array, Array]:
    """Return the visible part of a line, with at most two points per column.

    The points of a column are its extremes. NaN separates the pieces of a broken line.
    """
    first, last = np.searchsorted(x, x_view)
    shown = slice(max(int(first) - 1, 0), int(last) + 1)
    return trace(x[shown], y[shown], points=2 * columns)


def even_ticks(low: float, high: float, most: int) -> list[float]:
    """Return round numbers in even steps within a view.

    The result contains at most `most` numbers, but at least two.
    """
    power = 10.0 ** math.floor(math.log10(max((high - low) / max(most, 2), 1e-300)))
    for step in (power, 2 * power, 5 * power, 10 * power, 20 * power):
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        if last - first + 1 <= max(most, 2):
            return [min(max(number * step, low), high) for number in range(first, last + 1)]
    return []


def pieces(y: Array) -> Iterator[slice]:
    """Return the sections of a line between its NaN values."""
    edges = np.flatnonzero(np.diff(np.isfinite(y), prepend=False, append=False))
    return (slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True))
