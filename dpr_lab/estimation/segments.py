"""Cut runs into short segments with free start states, so that chaos never decides a fit.

A start error of a release from near upright grows by 2e4 within 5 s; over a segment of 0.25 to 2 s it grows by little,
and the start state is estimated with the parameters (multiple shooting).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import RunError
from dpr_lab.run import Run

MIN_SAMPLES = 8  # four start states take four numbers; fewer than twice that says nothing about the model


@dataclass(frozen=True, slots=True)
class Segment:
    """Consecutive samples of one run and the state the rods start from."""

    run: int
    """Index of the run it was cut from."""
    t: NDArray[np.float64]
    """(n,) time since the run's release, s."""
    theta: NDArray[np.float64]
    """(n, 2) measured theta1, theta2, rad."""
    start: NDArray[np.float64]
    """(4,) theta1, theta2, omega1, omega2 at t[0], rad and rad/s."""
    max_step: float = 5e-3
    """Longest Runge-Kutta step, s; over half a second it errs by less than a microradian."""

    @property
    def duration(self) -> float:
        """From the first to the last sample, s."""
        return float(self.t[-1] - self.t[0])


def cut(index: int, run: Run, states: NDArray[np.float64], length: float) -> list[Segment]:
    """Segments of about equal length that cover a run from the release on; gaps stay where they are.

    Args:
        index: the run's index, kept in each segment
        run: the run
        states: (n, 4) state at each sample of `run.swing`, for the start states
        length: wanted length, s

    Raises:
        RunError: fewer than `MIN_SAMPLES` samples after the release.
    """
    swing = run.swing
    if len(swing.t) < MIN_SAMPLES:
        raise RunError(f"{run.name}: {len(swing.t)} samples after the release; at least {MIN_SAMPLES} are needed")
    count = max(1, round(swing.duration / length))
    edges = np.searchsorted(swing.t, np.linspace(swing.t[0], swing.t[-1], count + 1)[1:-1])
    bounds = _drop_short(np.concatenate([[0], edges, [len(swing.t)]]))
    rods = swing.theta[:, 1:]
    return [Segment(index, swing.t[i:j], rods[i:j], states[i].copy()) for i, j in pairwise(bounds)]


def _drop_short(bounds: NDArray[np.int64]) -> list[int]:
    kept = [int(bounds[0])]
    for edge in bounds[1:-1]:
        if edge - kept[-1] >= MIN_SAMPLES and bounds[-1] - edge >= MIN_SAMPLES:
            kept.append(int(edge))
    return [*kept, int(bounds[-1])]


def join(first: Segment, second: Segment) -> Segment:
    """Two neighbours of one run as one segment that starts where the first does."""
    t, theta = np.concatenate([first.t, second.t]), np.concatenate([first.theta, second.theta])
    return replace(first, t=t, theta=theta, max_step=min(first.max_step, second.max_step))


def split(segment: Segment, at: int, start: NDArray[np.float64]) -> tuple[Segment, Segment]:
    """The first `at` samples, and the others with their own (4,) start state."""
    head = replace(segment, t=segment.t[:at], theta=segment.theta[:at])
    return head, replace(segment, t=segment.t[at:], theta=segment.theta[at:], start=start)


def restart(segments: Sequence[Segment], starts: NDArray[np.float64]) -> list[Segment]:
    """The same segments from other start states, (segments, 4)."""
    return [replace(segment, start=start) for segment, start in zip(segments, starts, strict=True)]
