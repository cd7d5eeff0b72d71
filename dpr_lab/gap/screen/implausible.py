"""Readings that are inconsistent with their neighbours: impossible jumps, and repeated readings."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Flags


@dataclass(frozen=True, slots=True)
class ImplausibleSettings:
    """Limits of plausible readings, from the motion of a rod."""

    fastest: float = 200.0
    """Maximum speed of a rod, rad/s; no laboratory rod rotates thirty times per second."""
    moved: float = 8.0
    """Minimum motion of the rod since the reading last changed, in standard deviations of a reading, for an unchanged
    reading that counts as repeated."""
    late: float = 12.0
    """Minimum motion that repeated readings miss before late readings, in standard deviations of a reading.

    With a limit of 8, readings of a vibrating rod counted as late.
    """
    goes_on: float = 0.25
    """Minimum change of the readings before and after repeated readings, relative to the motion of the rod per
    sample."""
    catches_up: float = 0.6
    """Minimum change of the first new reading after repeated readings, relative to the motion since the last new
    reading.

    After repeated readings, this change contains the motion that they missed. After a true rest, a vibrating rod
    continues from its last position. For late readings, the limit is relative to the missed motion.
    """
    reach: int = 4
    """Number of samples on either side for the estimate of the speed; one wrong instant then has little influence.

    It is also the maximum number of late readings after repeated readings.
    """


IMPLAUSIBLE = ImplausibleSettings()


def too_fast(t: Array, joints: Array) -> Flags:
    """Return the (n, 2) mask of the readings with an impossible speed.

    Such a reading differs from both neighbours by more than a rod can move between two samples.
    """
    jumps = np.abs(np.diff(joints, axis=0)) > IMPLAUSIBLE.fastest * np.diff(t)[:, None]
    edge = np.zeros((1, joints.shape[1]), dtype=bool)
    return np.concatenate([edge, jumps]) & np.concatenate([jumps, edge])


def repeated(t: Array, joints: Array, std: Array, jitter: float, period: float) -> Flags:
    """Detect readings that equal the previous reading although the rod moves.

    The rod moves if three conditions hold: its path since the reading last changed is many standard deviations of a
    reading, the readings before and after change in the same direction, and the next change contains the missed motion.
    Consecutive repeated readings are classified together. The jump after them is not a missed count.

    In a queue, the readings after a repeated reading are late until one change contains the missed motion. These
    readings are marked if the rod moves regularly apart from this jump.

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
    step = np.diff(joints, axis=0, prepend=np.nan)
    stands = step == 0.0
    goes_on = _before(step) * _before(step[::-1])[::-1] > (IMPLAUSIBLE.goes_on * path) ** 2
    row = np.arange(len(t))[:, None]
    last_new = np.maximum.accumulate(np.where(stands, 0, row), axis=0)
    next_new = np.minimum.accumulate(np.where(stands, len(t) - 1, row)[::-1], axis=0)[::-1]
    travelled = np.cumsum(path, axis=0)
    before, last, after = (np.take_along_axis(travelled, rows, axis=0) for rows in (last_new, next_new - 1, next_new))
    change = np.take_along_axis(joints, next_new, axis=0) - np.take_along_axis(joints, last_new, axis=0)
    catches_up = change * (after - before) > IMPLAUSIBLE.catches_up * (after - before) ** 2
    error, missing = np.hypot(std, jitter * np.abs(velocity)), last - before
    held = stands & goes_on & (np.abs(missing) > IMPLAUSIBLE.moved * error)
    stale = held & catches_up
    queued = held & ~catches_up & (np.abs(missing) > IMPLAUSIBLE.late * error) & ~np.roll(stands, 1, axis=0)
    irregular, unexpected = 1 - IMPLAUSIBLE.catches_up, step - path
    for first, axis in np.argwhere(queued).tolist():
        next_row, surplus = int(next_new[first, axis]), unexpected[:, axis] / missing[first, axis]
        earlier, later = surplus[max(first - reach, 0) : first], surplus[next_row : next_row + reach + 1]
        jump = int(np.argmax(np.abs(later) > irregular))
        if jump > 0 and abs(later[jump] - 1) < irregular and (np.abs(earlier) < irregular).all():
            stale[first : next_row + jump, axis] = True
    return stale


def _before(step: Array) -> Array:
    """Return the (n, 2) last non-zero change of a reading before each sample; zero if there is none."""
    moves = np.where(np.nan_to_num(step) != 0.0, np.arange(len(step))[:, None], 0)
    last = np.maximum.accumulate(np.roll(moves, 1, axis=0) * (np.arange(len(step)) > 0)[:, None], axis=0)
    return np.nan_to_num(np.take_along_axis(step, last, axis=0))
