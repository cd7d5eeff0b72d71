"""Simulated loggers with wrong time stamps or repeated readings."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Log:
    """Record of n readings."""

    taken: Array
    """Times (n,) at which the readings were taken, s."""
    stamps: Array
    """Time stamps (n,) of the readings, s, increasing."""
    sent: NDArray[np.int64]
    """Index (n,) of the reading that is sent instead of each reading."""


def _late(log: Log, period: float, rng: np.random.Generator) -> Log:
    cycle = int(rng.integers(5, 41))
    late = np.arange(len(log.taken)) % cycle == int(rng.integers(cycle))
    return replace(log, taken=log.taken + rng.uniform(0.5, 3.0) * period * late)


def _stale(log: Log, period: float, rng: np.random.Generator) -> Log:
    cycle = int(rng.integers(5, 41))
    return replace(log, sent=log.sent - (log.sent % cycle == cycle - 1))


def _busy(log: Log, period: float, rng: np.random.Generator) -> Log:
    repeated = rng.random(len(log.sent)) < rng.uniform(0.01, 0.05)
    return replace(log, sent=np.maximum.accumulate(np.where(repeated, 0, log.sent)))


def _host_stamps(log: Log, period: float, rng: np.random.Generator) -> Log:
    arrived = log.taken + rng.uniform(0.1, 1.0) * period * rng.exponential(1.0, len(log.taken))
    ordered = np.maximum.accumulate(arrived)
    return replace(log, stamps=ordered + 1e-7 * np.arange(len(ordered)))


def _uneven(log: Log, period: float, rng: np.random.Generator) -> Log:
    taken = np.sort(log.taken + rng.uniform(0.1, 0.4) * period * rng.uniform(-1.0, 1.0, len(log.taken)))
    return replace(log, taken=taken, stamps=taken)


def _repeated_frames(log: Log, period: float, rng: np.random.Generator) -> Log:
    n, every = len(log.sent), int(rng.integers(3, 8))
    first, last = np.sort(rng.integers(0, n, 2))
    inside = (log.sent >= first) & (log.sent < last)
    return replace(log, sent=log.sent - (inside & (log.sent % every == every - 1)))


FAULTS: dict[str, Callable[[Log, float, np.random.Generator], Log]] = {
    "late": _late,
    "stale": _stale,
    "busy": _busy,
    "host_stamps": _host_stamps,
    "uneven": _uneven,
    "repeated_frames": _repeated_frames,
}


def log(fault: str, t: Array, period: float, rng: np.random.Generator) -> Log:
    """Log readings at evenly spaced instants t (n,) by a logger with a fault; an empty name means no fault."""
    even = Log(t, t, np.arange(len(t)))
    return FAULTS[fault](even, period, rng) if fault else even
