"""Known torques and motions of the arm in the lanes: means over each step, so that impulses are exact.

An arm with the motion theta0(t) exerts these torques on the rods, docs/theory.md (15):

    tau_i = omega0^2 lever_i - (L0 / g) e_i cos(theta_i) alpha0,    lever_1 = (a sin1 + d sin2) cos1, lever_2 likewise.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.arm import levers
from dpr_lab.dynamics.lanes.workspace import LANES, At
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.kernels import subroutine
from dpr_lab.setup import Setup


class Drive(NamedTuple):
    """Known torques and arm motions of all runs in sequence, as arrays for compiled code."""

    t: NDArray[np.float64]
    """(K,) instants between which the impulse is linear, s since the release."""
    impulse: NDArray[np.float64]
    """(K, 2) impulse up to each instant, on theta1 and theta2, N m s."""
    first: NDArray[np.int64]
    """(runs + 1,) beginnings of the runs."""
    arm_t: NDArray[np.float64]
    """(A,) instants between which the arm's speed is linear, s."""
    arm_omega: NDArray[np.float64]
    """(A,) speeds of the arm, rad/s."""
    arm_first: NDArray[np.int64]
    """(runs + 1,) beginnings of the runs in these arrays."""
    torque0_t: NDArray[np.float64]
    """(B,) instants between which the impulse on a driven arm is linear, s."""
    torque0: NDArray[np.float64]
    """(B,) impulse up to each, N m s."""
    torque0_first: NDArray[np.int64]
    """(runs + 1,) beginnings of the runs in these arrays."""


def drive_of(setups: Sequence[Setup]) -> Drive:
    """Known torques and arm motions of runs; a free swing has no instants."""
    no_torques = np.zeros(0), np.zeros((0, 2))
    knots = [setup.torques.knots if setup.torques and setup.torques.on_joints else no_torques for setup in setups]
    first = np.cumsum([0, *(len(t) for t, _ in knots)])
    empty = np.zeros(0)
    arms = [(empty, empty) if setup.arm is None else (setup.arm.t, setup.arm.omega) for setup in setups]
    driven = [(empty, empty) if setup.torques is None else setup.torques.arm_knots for setup in setups]
    return Drive(
        np.concatenate([t for t, _ in knots]),
        np.concatenate([impulse for _, impulse in knots]),
        first,
        np.concatenate([t for t, _ in arms]),
        np.concatenate([omega for _, omega in arms]),
        np.cumsum([0, *(len(t) for t, _ in arms)]),
        np.concatenate([t for t, _ in driven]),
        np.concatenate([impulse for _, impulse in driven]),
        np.cumsum([0, *(len(t) for t, _ in driven)]),
    )


@subroutine
def _interval(t: NDArray[np.float64], first: int, last: int, start: float) -> int:
    """Index from `first` to `last` of the interval that contains the time `start`, by bisection."""
    i, beyond = first, last + 1
    while beyond - i > 1:
        middle = (i + beyond) // 2
        if t[middle] <= start:
            i = middle
        else:
            beyond = middle
    return i


@subroutine
def _impulse(drive: Drive, i: int, t: float, joint: int) -> float:
    """Impulse up to the time t after the instant i, N m s."""
    share = (t - drive.t[i]) / (drive.t[i + 1] - drive.t[i])
    return drive.impulse[i, joint] + max(share, 0.0) * (drive.impulse[i + 1, joint] - drive.impulse[i, joint])


@subroutine
def set_torques(w: NDArray[np.float64], drive: Drive, run: NDArray[np.int64], knot: NDArray[np.int64]) -> None:
    """Mean known torques over the next step of each lane; `knot` (LANES,) is the last used interval."""
    for k in range(LANES):
        first, last = int(drive.first[run[k]]), int(drive.first[run[k] + 1]) - 2
        if last < first:
            continue
        start = w[At.t + k]
        stop = w[At.until + k] if w[At.until + k] > start else start + w[At.step + k]
        start, stop = start - w[At.late + k], stop - w[At.late + k]
        i = int(knot[k])
        if i < first or i > last or drive.t[i] > start:
            i = _interval(drive.t, first, last, start)
        while i < last and drive.t[i + 1] <= start:
            i += 1
        knot[k], j = i, i
        while j < last and drive.t[j + 1] <= stop:
            j += 1
        duration = stop - start
        w[At.drive1 + k] = (_impulse(drive, j, stop, 0) - _impulse(drive, i, start, 0)) / duration
        w[At.drive2 + k] = (_impulse(drive, j, stop, 1) - _impulse(drive, i, start, 1)) / duration


@subroutine
def set_arm_torque(w: NDArray[np.float64], drive: Drive, run: NDArray[np.int64], knot: NDArray[np.int64]) -> None:
    """Mean known torque on the arm over the next step of each lane, as in `set_torques`."""
    for k in range(LANES):
        first, last = int(drive.torque0_first[run[k]]), int(drive.torque0_first[run[k] + 1]) - 2
        if last < first:
            continue
        start = w[At.t + k]
        stop = w[At.until + k] if w[At.until + k] > start else start + w[At.step + k]
        start, stop = start - w[At.late + k], stop - w[At.late + k]
        i = int(knot[k])
        if i < first or i > last or drive.torque0_t[i] > start:
            i = _interval(drive.torque0_t, first, last, start)
        while i < last and drive.torque0_t[i + 1] <= start:
            i += 1
        knot[k], j = i, i
        while j < last and drive.torque0_t[j + 1] <= stop:
            j += 1
        w[At.drive0 + k] = (_arm_impulse(drive, j, stop) - _arm_impulse(drive, i, start)) / (stop - start)


@subroutine
def _arm_impulse(drive: Drive, i: int, t: float) -> float:
    """Impulse on the arm up to the time t after the instant i, N m s."""
    share = (t - drive.torque0_t[i]) / (drive.torque0_t[i + 1] - drive.torque0_t[i])
    return drive.torque0[i] + max(share, 0.0) * (drive.torque0[i + 1] - drive.torque0[i])


@subroutine
def _arm_speed(drive: Drive, first: int, last: int, t: float) -> float:
    """Speed of the arm between the instants `first` and `last`, rad/s."""
    i, beyond = first, last + 1
    while i < beyond:  # bisection: numpy's own in a kernel would import all of scipy.linalg with it
        middle = (i + beyond) // 2
        if drive.arm_t[middle] < t:
            i = middle + 1
        else:
            beyond = middle
    if i == first or i > last:
        return drive.arm_omega[min(i, last)]
    share = (t - drive.arm_t[i - 1]) / (drive.arm_t[i] - drive.arm_t[i - 1])
    return drive.arm_omega[i - 1] + share * (drive.arm_omega[i] - drive.arm_omega[i - 1])


@subroutine
def prescribe_arm(w: NDArray[np.float64], drive: Drive, run: NDArray[np.int64]) -> None:
    """Mean acceleration and squared speed of the arm over the next step of each lane."""
    for k in range(LANES):
        first, last = int(drive.arm_first[run[k]]), int(drive.arm_first[run[k] + 1]) - 1
        if last < first:
            continue
        start = w[At.t + k]
        stop = w[At.until + k] if w[At.until + k] > start else start + w[At.step + k]
        u, v = _arm_speed(drive, first, last, start), _arm_speed(drive, first, last, stop)
        w[At.prescribed + k], w[At.squared + k] = (v - u) / (stop - start), (u * u + u * v + v * v) / 3.0
        w[At.alpha0 + k] = w[At.prescribed + k]


@subroutine
def add_prescribed(w: NDArray[np.float64], rig: RigConstants) -> None:
    """Add the torques due to a prescribed motion of the arm to the terms of a stage."""
    for k in range(LANES):
        sin1, cos1, sin2, cos2 = w[At.sin1 + k], w[At.cos1 + k], w[At.sin2 + k], w[At.cos2 + k]
        squared, pull = w[At.squared + k], w[At.prescribed + k] * rig.L0 / rig.g
        lever1, lever2 = levers(sin1, cos1, sin2, cos2, w[At.a + k], w[At.b + k], w[At.d + k])
        w[At.torque1 + k] += squared * lever1 - pull * w[At.e1 + k] * cos1
        w[At.torque2 + k] += squared * lever2 - pull * w[At.e2 + k] * cos2
