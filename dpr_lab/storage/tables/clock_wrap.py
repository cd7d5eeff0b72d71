"""Times of a counter that wraps: a 32-bit counter of microseconds begins again after 4295 s."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import RunError


@dataclass(frozen=True, slots=True)
class CounterSettings:
    """The counters that boards have, and how one is known by its fall."""

    bits: tuple[int, ...] = (16, 24, 31, 32)
    ticks: tuple[float, ...] = (1.0, 1e3, 1e6)
    """In a unit of the column: it may hold the counter, or a counter of milli- or microseconds in larger units."""
    slack: float = 0.01
    """Of its width, by which a fall differs from it at most: the step from row to row."""


SETTINGS = CounterSettings()


def unwrapped_times(times: NDArray[np.float64], wrap: float, name: str) -> NDArray[np.float64]:
    """(n,) times that grow through each wrap, NaN where they are; `name` is what a sentence calls them.

    Raises:
        RunError: times further apart than the wrap, so that it is another one.
    """
    known = np.flatnonzero(np.isfinite(times))
    span = float(np.ptp(times[known])) if len(known) else 0.0
    if span >= wrap:
        raise RunError(f"{name}: spans {span:.10g}, more than the {wrap:.10g} given as its wrap (--time-wrap)")
    falls = np.diff(times[known], prepend=times[known[:1]]) < -wrap / 2
    grown = times.copy()
    grown[known] += wrap * np.cumsum(falls)
    return grown


def wrap_behind(before: float, after: float) -> float | None:
    """The width of the counter that fell from one value to the next; None where no counter does."""
    widths = sorted(2.0**bits / ticks for bits in SETTINGS.bits for ticks in SETTINGS.ticks)
    within = (width for width in widths if 0 <= after <= before < width)
    return next((width for width in within if abs(before - after - width) < SETTINGS.slack * width), None)
