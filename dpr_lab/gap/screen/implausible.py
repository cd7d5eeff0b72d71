"""Readings that contradict their neighbours: impossible jumps, and repeated readings."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Flags


@dataclass(frozen=True, slots=True)
class ImplausibleSettings:
    """Limits of the motion of a rod."""

    fastest: float = 200.0
    """Maximum speed of a rod, rad/s; no laboratory rod rotates thirty times per second."""
    moved: float = 8.0
    """Minimum motion per sample, in standard deviations of a reading, for which an unchanged reading counts as
    repeated."""
    goes_on: float = 0.25
    """Minimum motion of the rod just before and after a repeated reading, relative to the usual motion per sample."""
    catches_up: float = 0.6
    """Minimum change of the first new reading after repeated readings, relative to the motion since the last new
    reading.

    The change contains the motion that the repeated readings lack. In contrast, a vibrating rod that was at rest
    continues from its last position.
    """
    reach: int = 4
    """Number of samples on either side for the estimate of the speed; one wrong instant then has little influence."""


IMPLAUSIBLE = ImplausibleSettings()


def too_fast(t: Array, joints: Array) -> Flags:
    """Return a (n, 2) mask of implausible readings.

    Such a reading differs from both neighbours by more than a rod can move between two samples.
    """
    jumps = np.abs(np.diff(joints, axis=0)) > IMPLAUSIBLE.fastest * np.diff(t)[:, None]
    edge = np.zeros((1, joints.shape[1]), dtype=bool)
    return np.concatenate([edge, jumps]) & np.concatenate([jumps, edge])


def repeated(t: Array, joints: Array, std: Array, jitter: float, period: float) -> Flags:
    """Detect readings that equal the previous reading although the rod moves.

    The rod moves if its path per sample is many standard deviations of a reading. Wrong times may make the readings of
    one axis equal by chance, but rarely those of both axes. Two samples on either side of a turning point may be equal.
    Equal readings of an axis that reverses are therefore not evidence. Consecutive repeated samples are judged
    together, by the motion of both axes since the last new sample. A jump after repeated samples is not a missed count.

    Args:
        t: (n,) times, s
        joints: (n, 2) readings, rad
        std: (2,) standard deviation of a reading at rest, rad
        jitter: standard deviation of an instant, s
        period: nominal sampling interval, s

    Returns:
        (n, 2) mask
    """
    reach = IMPLAUSIBLE.reach
    if len(t) <= 2 * reach:
        return np.zeros(joints.shape, dtype=bool)
    across = (joints[2 * reach :] - joints[: -2 * reach]) / (t[2 * reach :] - t[: -2 * reach])[:, None]
    # odd reflection continues a decrease of the speed towards a turning point
    velocity = np.pad(across, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    path = velocity * np.diff(t, prepend=t[0] - period)[:, None]
    speed, moved = np.abs(velocity), np.abs(path)
    step = np.diff(joints, axis=0, prepend=np.nan)
    stands = step == 0.0
    goes_on = _before(step) * _before(step[::-1])[::-1] > (IMPLAUSIBLE.goes_on * moved) ** 2
    alone = stands & goes_on & (moved > IMPLAUSIBLE.moved * np.hypot(std, jitter * speed))
    all_axes = stands.all(axis=1)
    turning = np.flatnonzero((np.nan_to_num(step) != 0.0).any(axis=0))
    # only one rod moves: the other axis is constant, or has the same readings
    if len(turning) and all(np.array_equal(joints[:, k], joints[:, turning[0]], equal_nan=True) for k in turning):
        all_axes &= goes_on[:, turning[0]]
    last_new = np.maximum.accumulate(np.where(all_axes, 0, np.arange(len(t))))
    travelled = np.cumsum(path, axis=0)
    all_axes &= _catches_up(joints, travelled, all_axes)
    significance = np.sqrt(np.sum(((travelled - travelled[last_new]) / std) ** 2, axis=1))
    highest = np.zeros(len(t))
    np.maximum.at(highest, last_new, significance)
    return alone | (all_axes & (highest[last_new] > IMPLAUSIBLE.moved))[:, None]


def _catches_up(joints: Array, travelled: Array, held: Flags) -> Flags:
    """Return a (n,) mask of the rows after which a reading makes up for missing motion.

    The missing motion is the motion since the last new reading before the row.
    """
    n = np.arange(len(held))
    last_new = np.maximum.accumulate(np.where(held, 0, n))
    next_new = np.minimum.accumulate(np.where(held, len(held) - 1, n)[::-1])[::-1]
    change, missing = joints[next_new] - joints[last_new], travelled[next_new] - travelled[last_new]
    return np.sum(change * missing, axis=1) > IMPLAUSIBLE.catches_up * np.sum(missing**2, axis=1)


def _before(step: Array) -> Array:
    """Return the (n, 2) last non-zero change before each reading, or zero."""
    moves = np.where(np.nan_to_num(step) != 0.0, np.arange(len(step))[:, None], 0)
    last = np.maximum.accumulate(np.roll(moves, 1, axis=0) * (np.arange(len(step)) > 0)[:, None], axis=0)
    return np.nan_to_num(np.take_along_axis(step, last, axis=0))
