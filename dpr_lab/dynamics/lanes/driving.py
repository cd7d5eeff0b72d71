"""Known torques and arm motions in the lanes, averaged over each step.

Impulses are therefore exact. An arm with the motion theta0(t) exerts these torques on the rods, docs/theory.md (15):

    tau_i = omega0^2 lever_i - (L0 / g) e_i cos(theta_i) alpha0

where lever_1 = (a sin1 + d sin2) cos1, lever_2 = (b sin2 + d sin1) cos2, sin_i = sin(theta_i) and cos_i = cos(theta_i).
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.dynamics.arm import levers
from dpr_lab.dynamics.lanes.workspace import LaneWorkspace
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.kernels import subroutine
from dpr_lab.setup import Setup


class Knots(NamedTuple):
    """Functions of time of all runs in sequence, each linear between its knots."""

    t: Array
    """(K,) knots, s since the release."""
    values: Array
    """(K, columns) values of the functions at the knots."""
    first: Integers
    """(runs + 1,) index of the first knot of each run, then K."""


class Drive(NamedTuple):
    """Known torques and arm motions of all runs; a free swing has no knots."""

    rods: Knots
    """Impulses of the known torques on theta1 and theta2 from the start to each knot, N m s."""
    arm: Knots
    """Impulse of the known torque on a driven arm from the start to each knot, N m s."""
    prescribed: Knots
    """Speed of an arm with prescribed motion, rad/s."""


@lru_cache(maxsize=16)
def drive_of(setups: tuple[Setup, ...]) -> Drive:
    """Return the known torques and arm motions of runs.

    The result is cached, because every prediction of segments of these runs needs it.
    """
    no_torques, nothing = (np.zeros(0), np.zeros((0, 2))), (np.zeros(0), np.zeros(0))
    return Drive(
        rods=_in_sequence([s.torques.knots if s.torques and s.torques.on_joints else no_torques for s in setups]),
        arm=_in_sequence([nothing if s.torques is None else s.torques.arm_knots for s in setups]),
        prescribed=_in_sequence([nothing if s.arm is None else (s.arm.t, s.arm.omega) for s in setups]),
    )


def _in_sequence(runs: Sequence[tuple[Array, Array]]) -> Knots:
    """Concatenate the knots of all runs.

    The knots of a run are given as times (K,) and values (K,) or (K, columns).
    """
    values = np.concatenate([values for _, values in runs])
    t = np.concatenate([t for t, _ in runs])
    return Knots(t, values if values.ndim > 1 else values[:, None], np.cumsum([0, *(len(t) for t, _ in runs)]))


@subroutine
def _interval(knots: Knots, run: int, i: int, t: float, near: int = 16) -> int:
    """Return the index of the knot of a run that starts the interval containing t.

    The index is -1 for a run without knots. The `near` intervals after interval i are searched in sequence, all others
    by bisection.
    """
    first, last = int(knots.first[run]), int(knots.first[run + 1]) - 2
    if i < first or i > last or knots.t[i] > t or (i + near < last and knots.t[i + near] <= t):
        i, beyond = first, last + 1
        while beyond - i > 1:  # bisection
            middle = (i + beyond) // 2
            if knots.t[middle] <= t:
                i = middle
            else:
                beyond = middle
    while i < last and knots.t[i + 1] <= t:
        i += 1
    return i if first <= last else -1


@subroutine
def _value(knots: Knots, i: int, t: float, column: int) -> float:
    """Return the value at time t of a function that is linear in interval i.

    Before the first knot the value is constant.
    """
    share = (t - knots.t[i]) / (knots.t[i + 1] - knots.t[i])
    return knots.values[i, column] + max(share, 0.0) * (knots.values[i + 1, column] - knots.values[i, column])


@subroutine
def _next_step(w: LaneWorkspace, k: int) -> tuple[float, float]:
    """Return the start and the end of the next step of lane k, s."""
    start = w.t[k]
    return start, w.until[k] if w.until[k] > start else start + w.step[k]


@subroutine
def _look_up(w: LaneWorkspace, k: int, rods: Knots, run: int, knot: Integers, t: float) -> bool:
    """Set the impulses of known torques on lane k until time t; return whether its run has known torques."""
    i = _interval(rods, run, knot[0, k], t)
    if i < 0:
        return False
    knot[0, k], w.known_until[k] = i, t
    w.impulse1[k], w.impulse2[k] = _value(rods, i, t, 0), _value(rods, i, t, 1)
    return True


@subroutine
def set_torques(w: LaneWorkspace, drive: Drive, run: Integers, knot: Integers) -> None:
    """Set the mean known torques over the next step of each lane.

    `knot` (2, lanes) contains the intervals that were used last. A lane that takes the same step of the same run as the
    previous lane copies its torques. The impulses until the end of a step are reused if the next step starts there.
    """
    rods, arm, before, start, stop = drive.rods, drive.arm, -1, 0.0, 0.0
    for k in range(len(w.t)):
        last_start, last_stop = start, stop
        start, stop = _next_step(w, k)
        start, stop = start - w.late[k], stop - w.late[k]
        if run[k] == before and start == last_start and stop == last_stop:
            w.drive0[k], w.drive1[k], w.drive2[k] = w.drive0[k - 1], w.drive1[k - 1], w.drive2[k - 1]
            knot[0, k], knot[1, k] = knot[0, k - 1], knot[1, k - 1]
            continue
        before = run[k]
        if start != w.known_until[k]:
            _look_up(w, k, rods, run[k], knot, start)
        impulse1, impulse2 = w.impulse1[k], w.impulse2[k]
        if _look_up(w, k, rods, run[k], knot, stop):
            w.drive1[k] = (w.impulse1[k] - impulse1) / (stop - start)
            w.drive2[k] = (w.impulse2[k] - impulse2) / (stop - start)
        i = _interval(arm, run[k], knot[1, k], start)
        if i >= 0:
            knot[1, k], j = i, _interval(arm, run[k], i, stop)
            w.drive0[k] = (_value(arm, j, stop, 0) - _value(arm, i, start, 0)) / (stop - start)


@subroutine
def _arm_speed(knots: Knots, first: int, last: int, t: float) -> float:
    """Return the speed of a prescribed arm at time t, rad/s.

    The speed is linear between the knots `first` to `last`, and constant outside of them.
    """
    i, beyond = first, last + 1
    while i < beyond:  # bisection, because numpy's function in a kernel would import all of scipy.linalg
        middle = (i + beyond) // 2
        if knots.t[middle] < t:
            i = middle + 1
        else:
            beyond = middle
    if i == first or i > last:
        return knots.values[min(i, last), 0]
    return _value(knots, i - 1, t, 0)


@subroutine
def prescribe_arm(w: LaneWorkspace, drive: Drive, run: Integers) -> None:
    """Set the mean acceleration and mean squared speed of the arm over the next step."""
    knots = drive.prescribed
    for k in range(len(w.t)):
        first, last = int(knots.first[run[k]]), int(knots.first[run[k] + 1]) - 1
        if last < first:
            continue
        start, stop = _next_step(w, k)
        u, v = _arm_speed(knots, first, last, start), _arm_speed(knots, first, last, stop)
        w.prescribed[k], w.squared[k] = (v - u) / (stop - start), (u * u + u * v + v * v) / 3.0
        w.alpha0[k] = w.prescribed[k]


@subroutine
def add_prescribed(w: LaneWorkspace, rig: RigConstants) -> None:
    """Add the torques due to a prescribed arm motion to the torques of a Runge-Kutta stage."""
    for k in range(len(w.t)):
        sin1, cos1, sin2, cos2 = w.sin1[k], w.cos1[k], w.sin2[k], w.cos2[k]
        squared, pull = w.squared[k], w.prescribed[k] * rig.L0 / rig.g
        lever1, lever2 = levers(sin1, cos1, sin2, cos2, w.a[k], w.b[k], w.d[k])
        w.torque1[k] += squared * lever1 - pull * w.e1[k] * cos1
        w.torque2[k] += squared * lever2 - pull * w.e2[k] * cos2
