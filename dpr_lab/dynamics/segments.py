"""Segments: pieces of swings that all candidates integrate over the same instants from the same start states."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpr_lab.dynamics.schedule import MAX_STEP, steps_between


@dataclass(frozen=True, slots=True)
class Segments:
    """Segments laid end to end; segment s owns the samples `offsets[s]` to `offsets[s + 1]`."""

    starts: NDArray[np.float64]
    """(segments, 4) theta1, theta2, omega1, omega2 at each segment's first sample, rad and rad/s."""
    offsets: NDArray[np.int64]
    """(segments + 1,) where the segments begin among all samples."""
    step: NDArray[np.float64]
    """(samples,) Runge-Kutta step on the way to each sample, s; 0 at a first sample."""
    count: NDArray[np.int64]
    """(samples,) number of such steps; 0 at a first sample."""

    def __len__(self) -> int:
        return len(self.starts)


def segments(times: Sequence[ArrayLike], starts: ArrayLike, max_step: float | Sequence[float] = MAX_STEP) -> Segments:
    """Segments from the instants of each.

    Args:
        times: for each segment (n,) increasing instants, s; the start state holds at the first
        starts: (segments, 4) start states, rad and rad/s
        max_step: longest Runge-Kutta step, s; of all segments or of each

    Raises:
        ValueError: shapes that do not fit, or instants that do not increase.
    """
    starts = np.ascontiguousarray(starts, dtype=np.float64)
    if starts.shape != (len(times), 4):
        raise ValueError(f"starts must have shape ({len(times)}, 4), not {starts.shape}")
    if not len(times):
        raise ValueError("there must be at least one segment")
    longest = np.broadcast_to(max_step, len(times))
    steps, counts = zip(*(steps_between(t, float(h)) for t, h in zip(times, longest, strict=True)), strict=True)
    offsets = np.cumsum([0, *(len(step) for step in steps)])
    return Segments(starts, offsets, np.concatenate(steps), np.concatenate(counts))
