"""Readings that their neighbours alone rule out: jumps no rod can make, and readings that stand still."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ImplausibleSettings:
    """Limits of the motion of a rod."""

    fastest: float = 200.0
    """rad/s; no rod of a laboratory turns thirty times a second."""
    moved: float = 8.0
    """Standard deviations a rod must have moved before a reading that did not is called repeated."""
    goes_on: float = 0.25
    """Share of what the rod moves a sample, by which it must move just before and after a repeated reading."""
    reach: int = 4
    """Samples on either side over which a speed is taken, so that one jittered instant does not make it."""


IMPLAUSIBLE = ImplausibleSettings()


def too_fast(t: Array, joints: Array, settings: ImplausibleSettings = IMPLAUSIBLE) -> NDArray[np.bool_]:
    """(n, 2) readings that lie further from both neighbours than a rod can turn in between: one, or a burst of them."""
    jumps = np.abs(np.diff(joints, axis=0)) > settings.fastest * np.diff(t)[:, None]
    edge = np.zeros((1, joints.shape[1]), dtype=bool)
    return np.concatenate([edge, jumps]) & np.concatenate([jumps, edge])


def repeated(
    t: Array, joints: Array, std: Array, jitter: float, period: float, settings: ImplausibleSettings = IMPLAUSIBLE
) -> NDArray[np.bool_]:
    """Readings equal to the one before although the rod moves by many standard deviations a sample.

    Jittered instants can bring one axis to a stand by chance, but hardly both; and a rod that turns back stands still
    between two samples on the same side.

    Args:
        t: (n,) instants, s
        joints: (n, 2) readings, rad
        std: (2,) standard deviation of a reading at rest, rad
        jitter: that of an instant, s
        period: nominal time between samples, s
        settings: when a rod moves

    Returns:
        (n, 2)
    """
    reach = settings.reach
    if len(t) <= 2 * reach:
        return np.zeros(joints.shape, dtype=bool)
    across = np.abs(joints[2 * reach :] - joints[: -2 * reach]) / (t[2 * reach :] - t[: -2 * reach])[:, None]
    speed = np.pad(across, ((reach, reach), (0, 0)), mode="edge")
    moved = speed * np.diff(t, prepend=t[0] - period)[:, None]
    step = np.diff(joints, axis=0, prepend=np.nan)
    stands = step == 0.0
    goes_on = _before(step) * _before(step[::-1])[::-1] > (settings.goes_on * moved) ** 2
    alone = stands & goes_on & (moved > settings.moved * np.hypot(std, jitter * speed))
    both = stands.all(axis=1)
    return alone | (both & (moved > settings.moved * std).any(axis=1))[:, None]


def _before(step: Array) -> Array:
    """(n, 2) the last step before each that is not zero; zero where there is none."""
    moves = np.where(np.nan_to_num(step) != 0.0, np.arange(len(step))[:, None], 0)
    last = np.maximum.accumulate(np.roll(moves, 1, axis=0) * (np.arange(len(step)) > 0)[:, None], axis=0)
    return np.nan_to_num(np.take_along_axis(step, last, axis=0))
