"""Warn if rows were lost although the times are even.

A camera or a logger may lose frames and afterwards number or stamp the remaining rows evenly, for example at the mean
rate of the file. Then the step of all angles over a lost frame is twice as long as the steps before and after it. The
numbers n_i of frames per step are those for which the speeds v_i = s_i / n_i change most smoothly:

    sum over i of  |v_(i-1) - 2 v_i + v_(i+1)|^2 / (mean of |v|^2 in the three steps + floor^2)  +  price (n_i - 1)

This is a shortest path over the pairs (n_(i-1), n_i). Noise and uneven exposures do not lengthen steps by whole
numbers. Therefore most of the sum remains for them, whereas about a twentieth remains for lost frames. Steps of a few
encoder counts are always whole multiples of each other, so they are not examined.
"""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.storage.tables.interpreted import InterpretedTable, TableQuestion


@dataclass(frozen=True, slots=True)
class LostFrameSettings:
    """Limits for the detection of lost frames."""

    frames: int = 3
    """Maximum number of frames per step."""
    even: float = 0.3
    """Maximum relative deviation of a sampling interval from the median interval."""
    counts: float = 6.0
    """Minimum median step of an angle, in units of its smallest change."""
    rounding_rad: float = 1e-9
    """Largest change that counts as an error of the arithmetic, rad."""
    floor: float = 0.2
    """Floor of the speed that normalises a change, in units of the rms step: at turning points the speed is zero."""
    most: float = 1.0
    """Maximum of a normalised change, so that a single false reading counts little."""
    price: float = 0.05
    """Price of a lost frame."""
    rows: int = 8
    """Minimum number of successive even steps that are examined."""
    fewest: int = 5
    """Minimum number of long steps."""
    majority: float = 0.4
    """Maximum share of long steps. Exposures that are uneven by 40 % of a step reach one half."""
    remainder: float = 0.1
    """Maximum ratio of the sum with several frames per step to the sum with one frame per step. It is 0.046 for a film
    with every fourth frame lost, and above 0.2 for 717 parts of simulated and real recordings. None of 1800 simulated
    complete films, with noise and uneven exposures, is below the limit."""
    rough: float = 0.05
    """Minimum mean change with one frame per step; a smooth motion has less than 0.02."""


LOST = LostFrameSettings()


def lost_frame_questions(table: InterpretedTable) -> list[TableQuestion]:
    """Warn about steps that take two or three frames, according to the angles but not to the times."""
    rows = table.looked_at
    long, steps = long_steps(table.t[rows], table.theta[rows])
    if not long:
        return []
    return [
        TableQuestion(
            f"{long} of {steps} steps of the angles are two or three times as long as the steps around them, but the"
            " times are even: frames or rows were lost without an interruption of the times. Use the times at which the"
            " frames were taken, or the numbers of the frames (a column 'frame' and --rate-hz)"
        )
    ]


def long_steps(t: Array, theta: Array) -> tuple[int, int]:
    """Return the number of steps of two or more frames, and of all steps.

    The first number is zero without evidence of lost frames. Steps over uneven times are not examined.

    Args:
        t: (n,) times, s
        theta: (n, m) angles, rad
    """
    moved = np.diff(theta[:, _fine(theta)], axis=0)
    if not moved.size:
        return 0, 0
    times = np.diff(t)
    even = np.abs(times - np.median(times)) <= LOST.even * np.median(times)
    floor = LOST.floor * float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
    long = steps = changes = 0
    before = after = 0.0
    for part in np.split(np.arange(len(moved)), np.flatnonzero(~even)):
        regular = part[even[part]]
        if len(regular) < LOST.rows:
            continue
        frames, single, chosen = _smoothest(moved[regular], floor)
        long += int((frames > 1).sum())
        steps += len(frames)
        changes += len(single)
        before += float(single.sum())
        after += float(chosen.sum())
    evident = LOST.fewest <= long <= LOST.majority * steps and before > LOST.rough * changes
    return (long, steps) if evident and after < LOST.remainder * before else (0, steps)


def _fine(theta: Array) -> Flags:
    """Return a mask of the angles whose usual change is several times the smallest one (the resolution)."""
    size = np.abs(np.diff(theta, axis=0))
    smallest = np.where(size > LOST.rounding_rad, size, np.inf).min(axis=0, initial=np.inf)
    return np.asarray(np.median(size, axis=0) > LOST.counts * smallest) if len(size) else np.zeros(theta.shape[1], bool)


def _smoothest(moved: Array, floor: float) -> tuple[Integers, Array, Array]:
    """Return the number of frames of each step, and the relative changes of speed before and after.

    A change is the squared second difference of the speed, divided by its mean square. The first changes are those with
    one frame per step, the second those with the returned numbers.

    Args:
        moved: (n, m) steps of the angles, rad
        floor: lower limit of the speed in the denominator, rad per frame
    """
    numbers = np.arange(1, LOST.frames + 1)
    speeds = moved[:, None, :] / numbers[:, None]
    first, middle, last = speeds[:-2, :, None, None], speeds[1:-1, None, :, None], speeds[2:, None, None, :]
    size = ((first**2).sum(axis=-1) + (middle**2).sum(axis=-1) + (last**2).sum(axis=-1)) / 3
    change = np.minimum(((first - 2 * middle + last) ** 2).sum(axis=-1) / (size + floor**2), LOST.most)
    price = LOST.price * (numbers - 1)
    cost, cheapest = price[:, None] + price, []
    for after_pair in change:
        total = cost[:, :, None] + after_pair + price
        cheapest.append(total.argmin(axis=0))
        cost = total.min(axis=0)
    path = [int(index) for index in np.unravel_index(cost.argmin(), cost.shape)][::-1]
    for previous in reversed(cheapest):
        path.append(int(previous[path[-1], path[-2]]))
    taken = np.array(path[::-1])
    rows = np.arange(len(change))
    return numbers[taken], change[:, 0, 0, 0], change[rows, taken[:-2], taken[1:-1], taken[2:]]
