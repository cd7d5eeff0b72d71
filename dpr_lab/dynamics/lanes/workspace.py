"""Workspace of the lanes: one record with a row of numbers for each quantity.

Rows are fields of the record, so the compiler knows that they do not overlap and converts a loop over the lanes to
vector instructions. Kernels read lane k of a row as `w.theta1[k]`.
"""

import math
from functools import cache
from typing import Any

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import SIZE
from dpr_lab.effects.effect_kernels import STEPPED
from dpr_lab.effects.quantities import ArmModel, BaseParameters, Joint, Motion, RigConstants, Terms
from dpr_lab.kernels import inlined

LANES = 16
"""Number of lanes; two registers of eight doubles hide the latency of a division with few spare lanes."""

FEW_LANES = 2
"""Number of lanes for one or two tracks with internal states.

Further lanes would be spare. A step of 2 lanes takes about half the time of a step of 16 lanes.
"""

Row = Array
"""(lanes,) one quantity in all lanes."""

Rows = Array
"""(count, lanes) one row for each internal state that moves with a joint, or for each parameter of the effects."""


class LaneWorkspace:
    """Rows of the workspace in the order of the record.

    Angles are in rad, times in s, torques in N m; all other quantities are in SI units.
    """

    # constants of a track: base parameters, lengths and masses of the mounted parts, the arm, length of a step
    a: Row
    b: Row
    d: Row
    e1: Row
    e2: Row
    c1: Row
    c2: Row
    L1: Row
    L2: Row
    m1: Row
    m2: Row
    mb: Row
    inertia: Row
    friction: Row
    stiffness: Row
    step: Row
    # the current step, the state, and the state at the start of the step
    h: Row
    t: Row
    theta0: Row
    theta1: Row
    theta2: Row
    omega0: Row
    omega1: Row
    omega2: Row
    old_t: Row
    old_theta0: Row
    old_theta1: Row
    old_theta2: Row
    old_omega0: Row
    old_omega1: Row
    old_omega2: Row
    # one stage of the step: state, rotation of the joints since its start, accelerations
    stage_t: Row
    stage_theta0: Row
    stage_theta1: Row
    stage_theta2: Row
    stage_omega0: Row
    stage_omega1: Row
    stage_omega2: Row
    sin1: Row
    cos1: Row
    sin2: Row
    cos2: Row
    displacement1: Row
    displacement2: Row
    alpha0: Row
    alpha1: Row
    alpha2: Row
    # directions of sliding joints; for joints at rest the torque, its limit, and the margin at both ends
    direction1: Row
    direction2: Row
    push1: Row
    push2: Row
    limit1: Row
    limit2: Row
    forward1: Row
    forward2: Row
    first1: Row
    first2: Row
    last1: Row
    last2: Row
    # end of the whole step, number of events, time to the next event, and its kind: 1 is the start of sliding, 2, 3
    # and 4 are stops of joint 1, joint 2 and the arm
    until: Row
    events: Row
    ahead: Row
    cut: Row
    # weighted sums of speeds and of accelerations over the stages
    turn0: Row
    turn1: Row
    turn2: Row
    sum0: Row
    sum1: Row
    sum2: Row
    # contributions of effects, known torques on both rods over the step and their delay, joint forces for some effects,
    # and the impulses of the known torques until the end of the last step that was looked up
    term_a: Row
    term_b: Row
    term_coupling: Row
    torque1: Row
    torque2: Row
    drive1: Row
    drive2: Row
    late: Row
    force1: Row
    force2: Row
    known_until: Row
    impulse1: Row
    impulse2: Row
    # arm with prescribed motion: mean acceleration and mean squared speed over the step
    prescribed: Row
    squared: Row
    # a free or driven arm: its known torque over the step, the torque of drive and effects, the delay of its readings,
    # its rotation since the start of the step, and the rows above that describe sliding and resting joints
    drive0: Row
    torque0: Row
    late0: Row
    displacement0: Row
    direction0: Row
    push0: Row
    limit0: Row
    forward0: Row
    first0: Row
    last0: Row
    # motor behind the backlash of the arm's gear: inertia and friction of arm and motor together; inertia, speed and
    # torque of the motor; whether it is inside the backlash; outstanding impulse of the gear on the arm, its first
    # moment, and the torque that transmits both; time for which the motor stays in contact after an impact; state at
    # the start of the step; speed of the arm; fraction of the step up to which the motor was followed; time after it
    geared_inertia: Row
    geared_friction: Row
    motor_inertia0: Row
    motor_speed0: Row
    motor_torque0: Row
    loose0: Row
    old_loose0: Row
    owed0: Row
    behind0: Row
    fed0: Row
    bonded0: Row
    old_hold0: Row
    old_motor_speed0: Row
    speed0: Row
    followed0: Row
    elapsed0: Row
    # readings: next samples of joints 1 and 2, their share of the step, angles there, and angles held by backlash
    due1: Row
    due2: Row
    share: Row
    angle0: Row
    angle1: Row
    angle2: Row
    hold0: Row
    hold1: Row
    hold2: Row
    handed: Row
    # internal states that move with a joint: at the start of the step, after a displacement, and current
    old_internal: Rows
    moved: Rows
    internal: Rows
    # parameters of all effects
    params: Rows


_COUNT = {"old_internal": len(STEPPED), "moved": len(STEPPED), "internal": len(STEPPED), "params": SIZE}
"""Number of rows of those fields that have several rows."""


@cache
def _record(lanes: int) -> Any:
    """Return the data type of a workspace."""
    names = LaneWorkspace.__annotations__
    fields = [(name, np.float64, (_COUNT[name], lanes) if name in _COUNT else (lanes,)) for name in names]
    return np.dtype((np.record, fields))


def lane_workspace(lanes: int = LANES) -> LaneWorkspace:
    """Create a workspace of zeros, which fits in the first-level cache."""
    return one_workspace(lanes)[0]


def one_workspace(lanes: int) -> Any:
    """Create an array of one workspace of zeros.

    At each call of a kernel, Numba determines the type of each argument. It does so fast for an array (in compiled
    code) and slowly for a record (in Python). NumPy fills a large record slowly, so the zeros come from a `bytearray`.
    """
    record = _record(lanes)
    return np.frombuffer(bytearray(record.itemsize), record)


@inlined
def copy_rows(source: Rows, target: Rows) -> None:
    """Copy the rows of `source` to `target`."""
    for i in range(len(source)):
        for k in range(source.shape[1]):
            target[i, k] = source[i, k]


@inlined
def base_at(w: LaneWorkspace, k: int) -> BaseParameters:
    """Return the base parameters of lane k."""
    return BaseParameters(w.a[k], w.b[k], w.d[k], w.e1[k], w.e2[k], w.c1[k], w.c2[k])


@inlined
def constants_at(w: LaneWorkspace, k: int, rig: RigConstants) -> RigConstants:
    """Return the rig constants of lane k, including the constants of the mounted parts."""
    return RigConstants(
        rig.L0, w.L1[k], w.L2[k], rig.g, w.m1[k], w.m2[k], w.mb[k],
        rig.counts_per_rev1, rig.counts_per_rev2, rig.relative2, rig.counts_per_rev0,
    )  # fmt: skip


@inlined
def arm_at(w: LaneWorkspace, k: int, rig: RigConstants) -> ArmModel:
    """Return the inertia, friction and stiffness of the arm of lane k."""
    return ArmModel(w.inertia[k], rig.L0 / rig.g, w.friction[k], w.stiffness[k])


@inlined
def motion_at(w: LaneWorkspace, k: int) -> Motion:
    """Return the motion of lane k at the current stage."""
    return Motion(
        w.stage_t[k],
        w.stage_theta0[k], w.stage_theta1[k], w.stage_theta2[k],
        w.stage_omega0[k], w.stage_omega1[k], w.stage_omega2[k],
        w.sin1[k], w.cos1[k], w.sin2[k], w.cos2[k],
        w.displacement1[k], w.displacement2[k], w.force1[k], w.force2[k],
        w.direction1[k], w.direction2[k], w.displacement0[k], w.direction0[k],
    )  # fmt: skip


@inlined
def joint0_at(w: LaneWorkspace, k: int) -> Joint:
    """Return the joint of the arm of lane k, with zero force."""
    return Joint(
        w.stage_t[k], w.stage_theta0[k], w.stage_omega0[k], w.displacement0[k], 0.0,
        w.direction0[k],
    )  # fmt: skip


@inlined
def joint1_at(w: LaneWorkspace, k: int) -> Joint:
    """Return joint 1 of lane k, as `joint1` does for a motion."""
    return Joint(
        w.stage_t[k], w.stage_theta1[k] - math.pi, w.stage_omega1[k],
        w.displacement1[k], w.force1[k], w.direction1[k],
    )  # fmt: skip


@inlined
def joint2_at(w: LaneWorkspace, k: int) -> Joint:
    """Return joint 2 of lane k, as `joint2` does for a motion."""
    return Joint(
        w.stage_t[k],
        w.stage_theta2[k] - w.stage_theta1[k], w.stage_omega2[k] - w.stage_omega1[k],
        w.displacement2[k], w.force2[k], w.direction2[k],
    )  # fmt: skip


@inlined
def terms_at(w: LaneWorkspace, k: int) -> Terms:
    """Return the contributions of the effects to the equation of motion of lane k at the current stage."""
    return Terms(w.term_a[k], w.term_b[k], w.term_coupling[k], w.torque1[k], w.torque2[k])


@inlined
def waits(w: LaneWorkspace, k: int) -> bool:
    """Return whether the current step of lane k, from `old_t` on, is before the release."""
    return not w.old_t[k] > -0.5 * w.step[k]
