"""Runge-Kutta steps in vector lanes, with the physics of `dpr_lab.dynamics.step`.

Theory of operation. A track is one candidate along one segment. Tracks with the same active effects are integrated
together in one workspace, one in each lane, with a row of numbers for each quantity (`workspace`). Each part of a step
is a loop over the lanes that the compiler converts to vector instructions. These loops contain no branches or calls;
tanh, exp and sincos are therefore polynomials (`dpr_lab.effects.elementary`). Each effect is a separate loop, which is
skipped if the effect is off (`effects`). Such a loop reads the motion of the stage from the workspace and adds to five
rows of terms. Loops that only some effects need (the arm, joint forces, internal states) are skipped in the same way.

Each lane has its own time and its own step. Sums are not reassociated and lanes are independent, so the result of a
candidate is bit-identical in any block and for any number of threads.

An arm is held until the release. The loop of the arm checks each lane for this, but only in the few steps before the
last lane is released.
"""

from functools import cache
from typing import Any

import numpy as np

from dpr_lab.arrays import Flags
from dpr_lab.dynamics.arm import CLAMPED, FREE, arm_accelerations
from dpr_lab.dynamics.lanes.driving import add_prescribed
from dpr_lab.dynamics.lanes.dry_friction import accelerate_held, begin_dry, find_margin0, find_margins, let_go, settle
from dpr_lab.dynamics.lanes.effects import (
    add_arm_drives,
    add_arm_torques,
    add_drives,
    add_load_friction,
    add_torques,
    add_whole_torques,
    displaced,
)
from dpr_lab.dynamics.lanes.geared_motor import begin_gear, transmit
from dpr_lab.dynamics.lanes.workspace import (
    LaneWorkspace,
    arm_at,
    base_at,
    constants_at,
    copy_rows,
    lane_workspace,
    motion_at,
    terms_at,
    waits,
)
from dpr_lab.dynamics.rig_constants import UNKNOWN
from dpr_lab.dynamics.step import joint_forces
from dpr_lab.effects.effect_kernels import AT_RELEASE, STEPPED
from dpr_lab.effects.elementary import sincos
from dpr_lab.effects.quantities import HELD_ARM, NOTHING, RigConstants
from dpr_lab.effects.stages import Requirements
from dpr_lab.kernels import behind_pointer, subroutine

_AT_RELEASE = tuple(AT_RELEASE[list(STEPPED)])


@cache
def advance(lanes: int) -> Any:
    """Return the compiled function `_advance`, a Runge-Kutta step of a number of lanes.

    The function is passed to kernels as an argument and is compiled separately from them.
    """
    required, active = Requirements(*[False] * len(Requirements._fields)), np.zeros(1, dtype=np.bool_)
    return behind_pointer(_advance, lane_workspace(lanes), UNKNOWN, active, required, False)


def _advance(w: LaneWorkspace, rig: RigConstants, active: Flags, required: Requirements, held: bool) -> None:
    """Advance all lanes by one Runge-Kutta step.

    Args:
        w: workspace of the lanes
        rig: constants of the rig
        active: (effects,) mask of the active effects in these lanes
        required: quantities that these effects require
        held: whether any lane may be before the release, with its arm held
    """
    dry = required.dry1 or required.dry2 or required.dry0
    _begin(w)
    if required.arm:
        _begin_arm(w)
    if required.play0:
        begin_gear(w)
    resting = dry and begin_dry(w, required)
    for stage in range(4):
        ahead = 0.0 if stage == 0 else 1.0 if stage == 3 else 0.5
        weight = 2.0 if stage == 1 or stage == 2 else 1.0
        _place(w, ahead)
        if required.arm:
            _place_arm(w, ahead)
        _accelerate(w, rig, active, required, held, resting)
        if resting and stage == 0:
            exceeded = find_margins(w, active, w.first1, w.first2)
            if required.dry0:
                exceeded |= find_margin0(w, active, w.first0)
            if exceeded:
                let_go(w, rig, active, required)
                _accelerate(w, rig, active, required, held, resting)
                find_margins(w, active, w.first1, w.first2)
                if required.dry0:
                    find_margin0(w, active, w.first0)
        if resting and stage == 3:
            find_margins(w, active, w.last1, w.last2)
            if required.dry0:
                find_margin0(w, active, w.last0)
        _accumulate(w, weight, stage > 0)
        if required.arm:
            _accumulate_arm(w, weight, stage > 0)
    _finish(w)
    if required.arm:
        _finish_arm(w)
    if required.stepped:
        _move_internal(w, active)
        if held:
            _reset_held(w)
    if dry:
        settle(w, required, resting)


@subroutine
def _begin(w: LaneWorkspace) -> None:
    """Copy the state of each lane to the rows for the start of the step."""
    for k in range(len(w.t)):
        w.old_t[k] = w.t[k]
        w.old_theta1[k], w.old_theta2[k] = w.theta1[k], w.theta2[k]
        w.old_omega1[k], w.old_omega2[k] = w.omega1[k], w.omega2[k]


@subroutine
def _begin_arm(w: LaneWorkspace) -> None:
    for k in range(len(w.t)):
        w.old_theta0[k], w.old_omega0[k] = w.theta0[k], w.omega0[k]


@subroutine
def _place(w: LaneWorkspace, share: float) -> None:
    """Set the state of a stage at the fraction `share` of the step.

    The state follows from the speeds and accelerations of the previous stage. `share` is zero at the first stage.
    """
    for k in range(len(w.t)):
        ahead = share * w.h[k]
        p1, p2 = w.stage_omega1[k], w.stage_omega2[k]
        theta1, theta2 = w.theta1[k] + ahead * p1, w.theta2[k] + ahead * p2
        w.stage_t[k] = w.t[k] + ahead
        w.displacement1[k], w.displacement2[k] = ahead * p1, ahead * (p2 - p1)
        w.stage_theta1[k], w.stage_theta2[k] = theta1, theta2
        w.stage_omega1[k] = w.omega1[k] + ahead * w.alpha1[k]
        w.stage_omega2[k] = w.omega2[k] + ahead * w.alpha2[k]
        w.sin1[k], w.cos1[k] = sincos(theta1)
        w.sin2[k], w.cos2[k] = sincos(theta2)


@subroutine
def _place_arm(w: LaneWorkspace, share: float) -> None:
    for k in range(len(w.t)):
        ahead = share * w.h[k]
        w.displacement0[k] = ahead * w.stage_omega0[k]
        w.stage_theta0[k] = w.theta0[k] + w.displacement0[k]
        w.stage_omega0[k] = w.omega0[k] + ahead * w.alpha0[k]


@subroutine
def _accelerate(
    w: LaneWorkspace,
    rig: RigConstants,
    active: Flags,
    required: Requirements,
    held: bool,
    resting: bool,
) -> None:
    """Compute the accelerations of a stage.

    Load-dependent friction depends on joint forces, which are computed from the accelerations without this friction.
    """
    if not (required.torque or required.load or required.whole0 or resting):
        if not required.arm:
            _accelerate_bare(w)
            return
        if not held:
            _add_arm(w, rig, active, required)
            _accelerate_bare_rods(w, rig)
            return
    for k in range(len(w.t)):
        w.term_a[k], w.term_b[k], w.term_coupling[k] = 0.0, 0.0, 0.0
        w.torque1[k], w.torque2[k] = w.drive1[k], w.drive2[k]
    if required.torque:
        add_torques(w, rig, active)
    if required.drive:
        add_drives(w, active)
    if required.prescribed:
        add_prescribed(w, rig)
    if required.arm:
        _add_arm(w, rig, active, required)
    _accelerate_all(w, rig, required.arm, held, resting)
    if required.load:
        _find_forces(w, rig)
        add_load_friction(w, rig, active)
        _accelerate_all(w, rig, required.arm, held, resting)


@subroutine
def _add_arm(w: LaneWorkspace, rig: RigConstants, active: Flags, required: Requirements) -> None:
    """Compute the torques of drive and effects on the arm.

    The torques of the same effects on the rods are also computed.
    """
    for k in range(len(w.t)):
        w.torque0[k] = w.drive0[k]
    if required.drive0:
        add_arm_drives(w, active)
    if required.play0:
        transmit(w)
    if required.torque0:
        add_arm_torques(w, active)
    if required.whole0:
        add_whole_torques(w, rig, active)


@subroutine
def _accelerate_bare(w: LaneWorkspace) -> None:
    for k in range(len(w.t)):
        _, w.alpha1[k], w.alpha2[k] = arm_accelerations(motion_at(w, k), base_at(w, k), NOTHING, HELD_ARM, CLAMPED, 0.0)


@subroutine
def _accelerate_bare_rods(w: LaneWorkspace, rig: RigConstants) -> None:
    """Compute the accelerations with a moving arm and without effects on the rods."""
    for k in range(len(w.t)):
        w.alpha0[k], w.alpha1[k], w.alpha2[k] = arm_accelerations(
            motion_at(w, k), base_at(w, k), NOTHING, arm_at(w, k, rig), FREE, w.torque0[k]
        )


@subroutine
def _accelerate_all(w: LaneWorkspace, rig: RigConstants, arm: bool, held: bool, resting: bool) -> None:
    if resting:
        accelerate_held(w, rig, arm)
    elif not arm:
        for k in range(len(w.t)):
            _, w.alpha1[k], w.alpha2[k] = arm_accelerations(
                motion_at(w, k), base_at(w, k), terms_at(w, k), HELD_ARM, CLAMPED, 0.0
            )
    elif not held:
        for k in range(len(w.t)):
            w.alpha0[k], w.alpha1[k], w.alpha2[k] = arm_accelerations(
                motion_at(w, k), base_at(w, k), terms_at(w, k), arm_at(w, k, rig), FREE, w.torque0[k]
            )
    else:
        for k in range(len(w.t)):
            mode = CLAMPED if waits(w, k) else FREE
            w.alpha0[k], w.alpha1[k], w.alpha2[k] = arm_accelerations(
                motion_at(w, k), base_at(w, k), terms_at(w, k), arm_at(w, k, rig), mode, w.torque0[k]
            )


@subroutine
def _find_forces(w: LaneWorkspace, rig: RigConstants) -> None:
    for k in range(len(w.t)):
        alphas = w.alpha0[k], w.alpha1[k], w.alpha2[k]
        w.force1[k], w.force2[k] = joint_forces(motion_at(w, k), alphas, base_at(w, k), constants_at(w, k, rig))


@subroutine
def _accumulate(w: LaneWorkspace, weight: float, more: bool) -> None:
    for k in range(len(w.t)):
        w.turn1[k] = (w.turn1[k] if more else 0.0) + weight * w.stage_omega1[k]
        w.turn2[k] = (w.turn2[k] if more else 0.0) + weight * w.stage_omega2[k]
        w.sum1[k] = (w.sum1[k] if more else 0.0) + weight * w.alpha1[k]
        w.sum2[k] = (w.sum2[k] if more else 0.0) + weight * w.alpha2[k]


@subroutine
def _accumulate_arm(w: LaneWorkspace, weight: float, more: bool) -> None:
    for k in range(len(w.t)):
        w.turn0[k] = (w.turn0[k] if more else 0.0) + weight * w.stage_omega0[k]
        w.sum0[k] = (w.sum0[k] if more else 0.0) + weight * w.alpha0[k]


@subroutine
def _finish(w: LaneWorkspace) -> None:
    """Set the state at the end of the step, and the joint displacements."""
    for k in range(len(w.t)):
        h, sixth = w.h[k], w.h[k] / 6.0
        turn1, turn2 = w.turn1[k], w.turn2[k]
        w.t[k] += h
        w.theta1[k] += sixth * turn1
        w.theta2[k] += sixth * turn2
        w.omega1[k] += sixth * w.sum1[k]
        w.omega2[k] += sixth * w.sum2[k]
        w.displacement1[k], w.displacement2[k] = sixth * turn1, sixth * (turn2 - turn1)


@subroutine
def _finish_arm(w: LaneWorkspace) -> None:
    for k in range(len(w.t)):
        sixth = w.h[k] / 6.0
        w.displacement0[k] = sixth * w.turn0[k]
        w.theta0[k] += w.displacement0[k]
        w.omega0[k] += sixth * w.sum0[k]


@subroutine
def _move_internal(w: LaneWorkspace, active: Flags) -> None:
    copy_rows(w.internal, w.old_internal)
    displaced(w, active)
    copy_rows(w.moved, w.internal)


@subroutine
def _reset_held(w: LaneWorkspace) -> None:
    """Set the internal states before the release to the states of a rig at rest."""
    for k in range(len(w.t)):
        if waits(w, k):
            for i, at_release in enumerate(_AT_RELEASE):
                w.internal[i, k] = at_release
