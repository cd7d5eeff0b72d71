"""The flat workspace of the lanes: a row of `LANES` numbers for each quantity, in one array.

Row offsets are constants, so that the compiler sees that rows do not overlap and turns a loop over the lanes into
vector instructions. Kernels read lane k of a row as `w[ROW.theta1 + k]`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import SIZE
from dpr_lab.effects.effect_kernels import STEPPED
from dpr_lab.effects.quantities import ArmModel, BaseParameters, Motion, RigConstants, Terms
from dpr_lab.kernels import inlined

LANES = 16
"""Two registers of eight doubles: enough independent work to hide the latency of a division, and few spare lanes."""


class Rows(NamedTuple):
    """Where each row begins in the workspace."""

    # what a track keeps: base parameters, lengths and masses of what hangs there, the arm, the length of a step
    a: int
    b: int
    d: int
    e1: int
    e2: int
    c1: int
    c2: int
    L1: int
    L2: int
    m1: int
    m2: int
    mb: int
    inertia: int
    friction: int
    stiffness: int
    step: int
    # the step that is taken, the state, and what it was at the start of the step
    h: int
    t: int
    theta0: int
    theta1: int
    theta2: int
    omega0: int
    omega1: int
    omega2: int
    old_t: int
    old_theta0: int
    old_theta1: int
    old_theta2: int
    old_omega0: int
    old_omega1: int
    old_omega2: int
    # one stage of the step: state, what the joints have turned since its start, accelerations
    stage_t: int
    stage_theta0: int
    stage_theta1: int
    stage_theta2: int
    stage_omega0: int
    stage_omega1: int
    stage_omega2: int
    sin1: int
    cos1: int
    sin2: int
    cos2: int
    displacement1: int
    displacement2: int
    alpha0: int
    alpha1: int
    alpha2: int
    # which way joints slide, what pushes those at rest, up to which limit they hold, what is to spare at either end
    direction1: int
    direction2: int
    push1: int
    push2: int
    limit1: int
    limit2: int
    forward1: int
    forward2: int
    first1: int
    first2: int
    last1: int
    last2: int
    # where the whole step ends, its events, how far to go first, and what ends there: 1 with a joint, 2 or 3
    until: int
    events: int
    ahead: int
    cut: int
    # weighted sums over the stages, of speeds and of accelerations
    turn0: int
    turn1: int
    turn2: int
    sum0: int
    sum1: int
    sum2: int
    # what effects add, known torques on either rod over the step and how much later they act, and the joint forces that
    # some effects need
    term_a: int
    term_b: int
    term_coupling: int
    torque1: int
    torque2: int
    drive1: int
    drive2: int
    late: int
    force1: int
    force2: int
    # an arm that moves as it is known to: its acceleration and squared speed, means over the step
    carried: int
    whirl: int
    # reading: when the next samples of joints 1 and 2 are due, their share of the step, angles there, what a play holds
    due1: int
    due2: int
    share: int
    angle1: int
    angle2: int
    hold: int
    handed: int
    # internal states that move with a joint: at the start of the step, after a displacement, and now
    old_internal: int
    moved: int
    internal: int
    # the parameters of all effects
    params: int


_SIZES = [
    len(STEPPED) if name in ("old_internal", "moved", "internal") else SIZE if name == "params" else 1
    for name in Rows._fields
]

ROW = Rows(*(LANES * sum(_SIZES[:i]) for i in range(len(_SIZES))))

WORKSPACE = LANES * sum(_SIZES)
"""Numbers of a workspace; those of one track stay in the first-level cache."""


@inlined
def base_at(w: NDArray[np.float64], k: int) -> BaseParameters:
    """Base parameters of lane k."""
    return BaseParameters(
        w[ROW.a + k], w[ROW.b + k], w[ROW.d + k], w[ROW.e1 + k], w[ROW.e2 + k], w[ROW.c1 + k], w[ROW.c2 + k]
    )


@inlined
def constants_at(w: NDArray[np.float64], k: int, rig: RigConstants) -> RigConstants:
    """Constants of lane k: the rig's, of what hangs there."""
    return RigConstants(
        rig.L0, w[ROW.L1 + k], w[ROW.L2 + k], rig.g, w[ROW.m1 + k], w[ROW.m2 + k], w[ROW.mb + k],
        rig.counts_per_rev1, rig.counts_per_rev2, rig.relative2,
    )  # fmt: skip


@inlined
def arm_at(w: NDArray[np.float64], k: int, rig: RigConstants) -> ArmModel:
    """What holds the arm of lane k."""
    return ArmModel(w[ROW.inertia + k], rig.L0 / rig.g, w[ROW.friction + k], w[ROW.stiffness + k])


@inlined
def motion_at(w: NDArray[np.float64], k: int) -> Motion:
    """The motion of lane k at the stage."""
    return Motion(
        w[ROW.stage_t + k],
        w[ROW.stage_theta0 + k], w[ROW.stage_theta1 + k], w[ROW.stage_theta2 + k],
        w[ROW.stage_omega0 + k], w[ROW.stage_omega1 + k], w[ROW.stage_omega2 + k],
        w[ROW.sin1 + k], w[ROW.cos1 + k], w[ROW.sin2 + k], w[ROW.cos2 + k],
        w[ROW.displacement1 + k], w[ROW.displacement2 + k], w[ROW.force1 + k], w[ROW.force2 + k],
        w[ROW.direction1 + k], w[ROW.direction2 + k],
    )  # fmt: skip


@inlined
def terms_at(w: NDArray[np.float64], k: int) -> Terms:
    """What the effects of lane k add at the stage."""
    return Terms(w[ROW.term_a + k], w[ROW.term_b + k], w[ROW.term_coupling + k], w[ROW.torque1 + k], w[ROW.torque2 + k])


@inlined
def waits(w: NDArray[np.float64], k: int) -> bool:
    """Whether a step of lane k that begins at `old_t` lies before the release."""
    return not w[ROW.old_t + k] > -0.5 * w[ROW.step + k]
