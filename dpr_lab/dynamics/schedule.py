"""How the time between samples is cut into Runge-Kutta steps; one rule for every integrator of the package."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

MAX_STEP = 1e-3
"""Longest Runge-Kutta step unless asked otherwise, s.

On the paper's rig it errs by less than 2e-8 rad over the first 2 s from any pose, far below an encoder's step.
"""


def steps_between(t: ArrayLike, max_step: float = MAX_STEP) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Equal steps, none longer than `max_step`, from each instant to the next.

    Args:
        t: (n,) increasing instants, s
        max_step: longest step, s

    Returns:
        (n,) step before each instant, s, and (n,) number of such steps; both 0 for the first instant

    Raises:
        ValueError: instants that do not increase, or a step that is not positive.
    """
    t = np.asarray(t, dtype=np.float64)
    if t.ndim != 1 or not len(t):
        raise ValueError(f"t must be a one-dimensional array of at least one instant, not of shape {t.shape}")
    if not max_step > 0:
        raise ValueError(f"max_step must be positive, not {max_step}")
    interval = np.diff(t)
    if not (np.isfinite(t).all() and (interval > 0).all()):
        raise ValueError("t must be finite and strictly increasing")
    # The tolerance keeps an interval of 5 * max_step, up to rounding, at five steps.
    count = np.maximum(1, np.ceil(interval / max_step - 1e-9)).astype(np.int64)
    return np.concatenate([[0.0], interval / count]), np.concatenate([[0], count])
