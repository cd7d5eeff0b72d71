"""Flat workspace of the lanes: one array with a row of `LANES` numbers for each quantity.

Row offsets are constants, so the compiler knows that rows do not overlap and converts a loop over the lanes to vector
instructions. Kernels read lane k of a row as `w[At.theta1 + k]`.
"""

import math
from enum import IntEnum, auto

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import SIZE
from dpr_lab.effects.effect_kernels import STEPPED
from dpr_lab.effects.quantities import ArmModel, BaseParameters, Joint, Motion, RigConstants, Terms
from dpr_lab.kernels import inlined

LANES = 16
"""Number of lanes: two registers of eight doubles hide the latency of a division with few spare lanes."""


_WIDE = "old_internal", "moved", "internal", "params"
"""Last rows, which contain more: three for each internal state that moves with a joint, and the last for each
parameter.
"""


class At(IntEnum):
    """First number of each row in the workspace; as enumeration members they are constants for the compiler."""

    @staticmethod
    def _generate_next_value_(name: str, start: int, count: int, last_values: list[int]) -> int:
        wide = _WIDE.index(name) if name in _WIDE else 0
        return LANES * (count + wide * (len(STEPPED) - 1))

    # constant along a track: base parameters, lengths and masses of the mounted parts, the arm, length of a step
    a = auto()
    b = auto()
    d = auto()
    e1 = auto()
    e2 = auto()
    c1 = auto()
    c2 = auto()
    L1 = auto()
    L2 = auto()
    m1 = auto()
    m2 = auto()
    mb = auto()
    inertia = auto()
    friction = auto()
    stiffness = auto()
    step = auto()
    # the current step, the state, and the state at the start of the step
    h = auto()
    t = auto()
    theta0 = auto()
    theta1 = auto()
    theta2 = auto()
    omega0 = auto()
    omega1 = auto()
    omega2 = auto()
    old_t = auto()
    old_theta0 = auto()
    old_theta1 = auto()
    old_theta2 = auto()
    old_omega0 = auto()
    old_omega1 = auto()
    old_omega2 = auto()
    # one stage of the step: state, rotation of the joints since its start, accelerations
    stage_t = auto()
    stage_theta0 = auto()
    stage_theta1 = auto()
    stage_theta2 = auto()
    stage_omega0 = auto()
    stage_omega1 = auto()
    stage_omega2 = auto()
    sin1 = auto()
    cos1 = auto()
    sin2 = auto()
    cos2 = auto()
    displacement1 = auto()
    displacement2 = auto()
    alpha0 = auto()
    alpha1 = auto()
    alpha2 = auto()
    # directions of sliding joints; for joints at rest the torque, its limit, and the margin at both ends
    direction1 = auto()
    direction2 = auto()
    push1 = auto()
    push2 = auto()
    limit1 = auto()
    limit2 = auto()
    forward1 = auto()
    forward2 = auto()
    first1 = auto()
    first2 = auto()
    last1 = auto()
    last2 = auto()
    # end of the whole step, number of events, time to the next event, and its kind: 1 with a joint, 2 or 3
    until = auto()
    events = auto()
    ahead = auto()
    cut = auto()
    # weighted sums of speeds and of accelerations over the stages
    turn0 = auto()
    turn1 = auto()
    turn2 = auto()
    sum0 = auto()
    sum1 = auto()
    sum2 = auto()
    # contributions of effects, known torques on both rods over the step and their delay, and joint forces for some
    # effects
    term_a = auto()
    term_b = auto()
    term_coupling = auto()
    torque1 = auto()
    torque2 = auto()
    drive1 = auto()
    drive2 = auto()
    late = auto()
    force1 = auto()
    force2 = auto()
    # arm with prescribed motion: mean acceleration and mean squared speed over the step
    prescribed = auto()
    squared = auto()
    # a free or driven arm: its known torque over the step, all torques on it, the lead of its readings, its rotation
    # since the start of the step, and the rows above that describe sliding and resting joints
    drive0 = auto()
    torque0 = auto()
    late0 = auto()
    displacement0 = auto()
    direction0 = auto()
    push0 = auto()
    limit0 = auto()
    forward0 = auto()
    first0 = auto()
    last0 = auto()
    # readings: next samples of joints 1 and 2, their share of the step, angles there, angle held by backlash
    due1 = auto()
    due2 = auto()
    share = auto()
    angle0 = auto()
    angle1 = auto()
    angle2 = auto()
    hold = auto()
    handed = auto()
    # internal states that move with a joint: at the start of the step, after a displacement, and current
    old_internal = auto()
    moved = auto()
    internal = auto()
    # parameters of all effects
    params = auto()


WORKSPACE = At.params + LANES * SIZE
"""Number of values in a workspace; those of one track fit in the first-level cache."""


@inlined
def base_at(w: NDArray[np.float64], k: int) -> BaseParameters:
    """Base parameters of lane k."""
    return BaseParameters(w[At.a + k], w[At.b + k], w[At.d + k], w[At.e1 + k], w[At.e2 + k], w[At.c1 + k], w[At.c2 + k])


@inlined
def constants_at(w: NDArray[np.float64], k: int, rig: RigConstants) -> RigConstants:
    """Constants of lane k: those of the rig with the mounted parts."""
    return RigConstants(
        rig.L0, w[At.L1 + k], w[At.L2 + k], rig.g, w[At.m1 + k], w[At.m2 + k], w[At.mb + k],
        rig.counts_per_rev1, rig.counts_per_rev2, rig.relative2, rig.counts_per_rev0,
    )  # fmt: skip


@inlined
def arm_at(w: NDArray[np.float64], k: int, rig: RigConstants) -> ArmModel:
    """Inertia, friction and stiffness of the arm of lane k."""
    return ArmModel(w[At.inertia + k], rig.L0 / rig.g, w[At.friction + k], w[At.stiffness + k])


@inlined
def motion_at(w: NDArray[np.float64], k: int) -> Motion:
    """The motion of lane k at the stage."""
    return Motion(
        w[At.stage_t + k],
        w[At.stage_theta0 + k], w[At.stage_theta1 + k], w[At.stage_theta2 + k],
        w[At.stage_omega0 + k], w[At.stage_omega1 + k], w[At.stage_omega2 + k],
        w[At.sin1 + k], w[At.cos1 + k], w[At.sin2 + k], w[At.cos2 + k],
        w[At.displacement1 + k], w[At.displacement2 + k], w[At.force1 + k], w[At.force2 + k],
        w[At.direction1 + k], w[At.direction2 + k], w[At.displacement0 + k], w[At.direction0 + k],
    )  # fmt: skip


@inlined
def joint0_at(w: NDArray[np.float64], k: int) -> Joint:
    """The arm's joint of lane k, as `joint0` of its motion, without loading unused values."""
    return Joint(
        w[At.stage_t + k], w[At.stage_theta0 + k], w[At.stage_omega0 + k], w[At.displacement0 + k], 0.0,
        w[At.direction0 + k],
    )  # fmt: skip


@inlined
def joint1_at(w: NDArray[np.float64], k: int) -> Joint:
    """Joint 1 of lane k, as `joint1` of its motion, without loading unused values."""
    return Joint(
        w[At.stage_t + k], w[At.stage_theta1 + k] - math.pi, w[At.stage_omega1 + k],
        w[At.displacement1 + k], w[At.force1 + k], w[At.direction1 + k],
    )  # fmt: skip


@inlined
def joint2_at(w: NDArray[np.float64], k: int) -> Joint:
    """Joint 2 of lane k, in the same way."""
    return Joint(
        w[At.stage_t + k],
        w[At.stage_theta2 + k] - w[At.stage_theta1 + k], w[At.stage_omega2 + k] - w[At.stage_omega1 + k],
        w[At.displacement2 + k], w[At.force2 + k], w[At.direction2 + k],
    )  # fmt: skip


@inlined
def terms_at(w: NDArray[np.float64], k: int) -> Terms:
    """Terms of the effects of lane k at the stage."""
    return Terms(w[At.term_a + k], w[At.term_b + k], w[At.term_coupling + k], w[At.torque1 + k], w[At.torque2 + k])


@inlined
def waits(w: NDArray[np.float64], k: int) -> bool:
    """Whether a step of lane k that starts at `old_t` is before the release."""
    return not w[At.old_t + k] > -0.5 * w[At.step + k]
