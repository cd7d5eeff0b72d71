"""Unwrapping of times from a wrapping counter, for example of a 32-bit microsecond counter after 4295 s."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import RunError


@dataclass(frozen=True, slots=True)
class CounterSettings:
    """Common widths of counters, and criteria to detect a wrap."""

    bits: tuple[int, ...] = (16, 24, 31, 32)
    ticks: tuple[float, ...] = (1.0, 1e3, 1e6)
    """Widths in units of the column, which contains the counter, or a counter of milli- or microseconds in larger
    units.
    """
    slack: float = 0.01
    """Maximum relative difference between a drop and the width: the step from row to row."""


SETTINGS = CounterSettings()


def unwrapped_times(times: NDArray[np.float64], wrap: float, name: str) -> NDArray[np.float64]:
    """(n,) times with wraps removed, NaN unchanged; `name` is used in messages.

    Raises:
        RunError: times that span more than the given wrap, so the wrap is wrong.
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
    """Width of the counter that wrapped between two values; None if no counter matches."""
    widths = sorted(2.0**bits / ticks for bits in SETTINGS.bits for ticks in SETTINGS.ticks)
    within = (width for width in widths if 0 <= after <= before < width)
    return next((width for width in within if abs(before - after - width) < SETTINGS.slack * width), None)
