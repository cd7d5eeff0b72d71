"""Known torques in the lanes: over a step each is its mean, so that the impulse is right whatever the step."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.lanes.workspace import LANES, ROW
from dpr_lab.kernels import njit
from dpr_lab.setup import Setup


class Drive(NamedTuple):
    """The torques of all runs end to end, as compiled code takes them."""

    t: NDArray[np.float64]
    """(K,) instants between which the impulse is linear, s since the release."""
    impulse: NDArray[np.float64]
    """(K, 2) up to each, on theta1 and theta2, N m s."""
    first: NDArray[np.int64]
    """(runs + 1,) where the runs begin."""


def drive_of(setups: Sequence[Setup]) -> Drive:
    """The torques of runs; a free swing has no instants."""
    none = np.zeros(0), np.zeros((0, 2))
    knots = [none if setup.torques is None else setup.torques.knots for setup in setups]
    first = np.cumsum([0, *(len(t) for t, _ in knots)])
    return Drive(np.concatenate([t for t, _ in knots]), np.concatenate([impulse for _, impulse in knots]), first)


@njit
def _impulse(drive: Drive, i: int, t: float, joint: int) -> float:
    """Up to the time t after the instant i, N m s."""
    share = (t - drive.t[i]) / (drive.t[i + 1] - drive.t[i])
    return drive.impulse[i, joint] + max(share, 0.0) * (drive.impulse[i + 1, joint] - drive.impulse[i, joint])


@njit
def push(w: NDArray[np.float64], drive: Drive, run: NDArray[np.int64], place: NDArray[np.int64]) -> None:
    """Mean torques of the step that each lane is about to take; `place` (LANES,) is where it was looked up last."""
    for k in range(LANES):
        first, last = int(drive.first[run[k]]), int(drive.first[run[k] + 1]) - 2
        if last < first:
            continue
        start = w[ROW.t + k]
        stop = w[ROW.until + k] if w[ROW.until + k] > start else start + w[ROW.step + k]
        start, stop = start - w[ROW.late + k], stop - w[ROW.late + k]
        i = int(place[k])
        if i < first or i > last or drive.t[i] > start:
            i = first
        while i < last and drive.t[i + 1] <= start:
            i += 1
        place[k], j = i, i
        while j < last and drive.t[j + 1] <= stop:
            j += 1
        passed = stop - start
        w[ROW.drive1 + k] = (_impulse(drive, j, stop, 0) - _impulse(drive, i, start, 0)) / passed
        w[ROW.drive2 + k] = (_impulse(drive, j, stop, 1) - _impulse(drive, i, start, 1)) / passed
