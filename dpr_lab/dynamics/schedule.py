"""Divide sampling intervals into Runge-Kutta steps, in the same way for all integrators."""

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array, Integers

MAX_STEP = 1e-3
"""Default of the longest Runge-Kutta step, s.

On the rig of the paper its error is below 2e-8 rad over the first 2 s from any pose. This is far below a count of an
encoder.
"""


def steps_between(t: ArrayLike, max_step: float = MAX_STEP) -> tuple[Array, Integers]:
    """Divide each interval between successive times into equal steps of at most `max_step`.

    Args:
        t: (n,) increasing times, s
        max_step: longest step, s

    Returns:
        (n,) length of the steps before each instant, s, and (n,) number of these steps; both 0 for the first instant

    Raises:
        ValueError: the times do not increase, or `max_step` is not positive.
    """
    t = np.asarray(t, dtype=np.float64)
    if t.ndim != 1 or not len(t):
        raise ValueError(f"t must be a one-dimensional array of at least one instant, not of shape {t.shape}")
    if not max_step > 0:
        raise ValueError(f"max_step must be positive, not {max_step}")
    interval = np.diff(t)
    if not (np.isfinite(t).all() and (interval > 0).all()):
        raise ValueError("t must be finite and strictly increasing")
    return sample_steps(t, np.array([0, len(t)]), np.array([max_step]))


def sample_steps(t: Array, offsets: Integers, longest: Array) -> tuple[Array, Integers]:
    """Return the equal steps from each sample of a segment to the next.

    Args:
        t: (N,) times of all segments in sequence, increasing within each, s
        offsets: (S + 1,) index of the first time of each segment, then N
        longest: (S,) longest step of each segment, s

    Returns:
        (N,) step before each sample, s, and (N,) number of these steps; both 0 at the first sample of a segment
    """
    first, interval = offsets[:-1], np.diff(t, prepend=t[0])
    # The tolerance divides an interval of five longest steps into five steps in spite of rounding.
    needed = np.ceil(interval / np.repeat(longest, np.diff(offsets)) - 1e-9)
    needed[first] = 1.0
    count = np.maximum(1, needed).astype(np.int64)
    step = interval / count
    step[first], count[first] = 0.0, 0
    return step, count
