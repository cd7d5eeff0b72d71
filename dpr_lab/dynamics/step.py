"""Runge-Kutta step of the rig with all effects: the right-hand side of the simulator."""

import math
from typing import NamedTuple

from dpr_lab.arrays import Array, Flags
from dpr_lab.dynamics.arm import CLAMPED, FREE, ReducedRods, push_on_arm, reduced_rods
from dpr_lab.dynamics.dry_friction import direction_of, held, pushes, slides, slides_with_arm
from dpr_lab.dynamics.events import EVENTS, JointMotion, Three, correction, first_event, of_joints, stopped
from dpr_lab.effects.effect_kernels import (
    active_effects,
    arm_drives,
    arm_model,
    arm_torques,
    dry_limit0,
    dry_limits,
    effect_torques,
    free_arm_model,
    internal_after,
    load_torques,
    required_by,
    whole_torques,
)
from dpr_lab.effects.quantities import NOTHING, ArmModel, BaseParameters, Motion, RigConstants, Terms, plus, torques
from dpr_lab.effects.stages import Requirements
from dpr_lab.kernels import subroutine


class RigModel(NamedTuple):
    """Rig with its effects, as a tuple for compiled code."""

    base: BaseParameters
    constants: RigConstants
    arm: ArmModel
    params: Array
    """(SIZE,) parameters of all effects."""
    active: Flags
    """(effects,) mask of the active effects."""
    required: Requirements
    """Quantities that the active effects require."""


class RigState(NamedTuple):
    """State of a rig, with the internal states of effects that move with a joint.

    Angles are in rad, speeds in rad/s.
    """

    theta0: float
    theta1: float
    theta2: float
    omega0: float
    omega1: float
    omega2: float
    internal: tuple[float, ...]
    """Internal states in the order of `dpr_lab.effects.effect_kernels.STEPPED`."""


def model_with(base: BaseParameters, constants: RigConstants, arm: ArmModel, params: Array) -> RigModel:
    """Return the model of the rig with the effects of a parameter vector (SIZE,).

    `arm` is the model of the arm without effects.
    """
    active = active_effects(params)
    required = Requirements(*map(bool, required_by(active)))
    if required.arm:
        arm = free_arm_model(constants, arm_model(constants, arm, params, active), params, active)
    return RigModel(base, constants, arm, params, active, required)


@subroutine
def motion_of(
    t: float,
    thetas: Three,
    omegas: Three,
    displacements: tuple[float, float],
    forces: tuple[float, float],
    directions: tuple[float, float],
) -> Motion:
    """Return the motion at time t, s, from angles and speeds of theta0, theta1, theta2."""
    theta0, theta1, theta2 = thetas
    omega0, omega1, omega2 = omegas
    sin1, cos1, sin2, cos2 = math.sin(theta1), math.cos(theta1), math.sin(theta2), math.cos(theta2)
    return Motion(
        t, theta0, theta1, theta2, omega0, omega1, omega2, sin1, cos1, sin2, cos2,
        displacements[0], displacements[1], forces[0], forces[1], directions[0], directions[1], 0.0, 0.0,
    )  # fmt: skip


@subroutine
def with_arm(motion: Motion, displacement0: float, direction0: float) -> Motion:
    """Return the motion with the rotation of the arm in this step, rad, and the direction of the arm."""
    return Motion(
        motion.t, motion.theta0, motion.theta1, motion.theta2, motion.omega0, motion.omega1, motion.omega2,
        motion.sin1, motion.cos1, motion.sin2, motion.cos2, motion.displacement1, motion.displacement2, motion.force1,
        motion.force2, motion.direction1, motion.direction2, displacement0, direction0,
    )  # fmt: skip


@subroutine
def under_load(motion: Motion, force1: float, force2: float) -> Motion:
    """Return the motion with the forces on joints 1 and 2, N."""
    return Motion(
        motion.t, motion.theta0, motion.theta1, motion.theta2, motion.omega0, motion.omega1, motion.omega2,
        motion.sin1, motion.cos1, motion.sin2, motion.cos2, motion.displacement1, motion.displacement2, force1, force2,
        motion.direction1, motion.direction2, motion.displacement0, motion.direction0,
    )  # fmt: skip


@subroutine
def _length(x: float, y: float) -> float:
    return math.sqrt(x * x + y * y)  # the branches of math.hypot would prevent vector instructions in the lanes


@subroutine
def joint_forces(motion: Motion, alphas: Three, base: BaseParameters, constants: RigConstants) -> tuple[float, float]:
    """Return the magnitudes of the forces on joints 1 and 2, N.

    A force is the sum of mass times acceleration minus weight over all parts that hang on the joint. Only the
    components in the plane of the rods are included. The component along the arm, which is zero for a held arm, is
    neglected.
    """
    alpha0, alpha1, alpha2 = alphas
    whirl1, whirl2 = motion.omega1 * motion.omega1, motion.omega2 * motion.omega2
    across1, up1 = motion.cos1 * alpha1 - motion.sin1 * whirl1, -motion.sin1 * alpha1 - motion.cos1 * whirl1
    across2, up2 = motion.cos2 * alpha2 - motion.sin2 * whirl2, -motion.sin2 * alpha2 - motion.cos2 * whirl2
    moment1, moment2, carried = base.e1 / constants.g, base.e2 / constants.g, constants.m2 * constants.L1
    whole, tip = constants.m1 + constants.m2 + constants.mb, constants.L0 * alpha0 if alpha0 != 0.0 else 0.0
    force1 = _length(
        moment1 * across1 + moment2 * across2 + whole * tip, moment1 * up1 + moment2 * up2 + whole * constants.g
    )
    force2 = _length(
        carried * across1 + moment2 * across2 + constants.m2 * tip,
        carried * up1 + moment2 * up2 + constants.m2 * constants.g,
    )
    return force1, force2


@subroutine
def accelerations_at(
    t: float, x: RigState, displacement1: float, displacement2: float, model: RigModel, mode: int, drive: float
) -> Three:
    """Return the accelerations (alpha0, alpha1, alpha2) of arm and rods, rad/s^2.

    `displacement1` and `displacement2` are the displacements of the joints since the last update of the internal
    states, rad.
    """
    directions = directions_at(t, x, model, mode, drive)
    rods = _stage(t, x, (0.0, displacement1, displacement2), model, mode, drive, directions).rods
    return held(rods, directions[0], directions[1])


class SteppedStage(NamedTuple):
    """Stage of a step: the motion, contributions of effects, and equations of motion of the rods."""

    motion: Motion
    rods: ReducedRods
    terms: Terms
    torque0: float
    """Torque of drive and effects on a free arm, N m."""


@subroutine
def _stage(
    t: float,
    x: RigState,
    displacements: Three,
    model: RigModel,
    mode: int,
    drive: float,
    directions: Three,
) -> SteppedStage:
    """Return one stage of a Runge-Kutta step with prescribed sliding directions.

    The directions of joint 1, joint 2 and the arm are the signs of their speeds, and 0 for a joint that friction holds.
    """
    motion = motion_of(
        t,
        (x.theta0, x.theta1, x.theta2),
        (x.omega0, x.omega1, x.omega2),
        (displacements[1], displacements[2]),
        (0.0, 0.0),
        (directions[0], directions[1]),
    )
    motion = with_arm(motion, displacements[0], directions[2])
    base, constants, terms, torque0 = model.base, model.constants, NOTHING, drive
    if model.required.torque:
        terms = effect_torques(motion, base, constants, x.internal, model.params, model.active)
    if mode == FREE:
        if model.required.drive0:
            torque0 = arm_drives(motion, torque0, model.params, model.active)
        if model.required.torque0:
            torque0 = arm_torques(motion, torque0, x.internal, model.params, model.active)
        if model.required.whole0:
            torque0, torque1, torque2 = whole_torques(motion, base, constants, torque0, model.params, model.active)
            terms = plus(terms, torques(torque1, torque2))
    mode = CLAMPED if directions[2] == 0.0 else mode
    rods = reduced_rods(motion, base, terms, model.arm, mode, torque0)
    if model.required.load:
        alphas = held(rods, directions[0], directions[1])
        motion = under_load(motion, *joint_forces(motion, alphas, base, constants))
        terms = plus(terms, load_torques(motion, base, constants, x.internal, model.params, model.active))
        rods = reduced_rods(motion, base, terms, model.arm, mode, torque0)
    return SteppedStage(motion, rods, terms, torque0)


@subroutine
def directions_at(t: float, x: RigState, model: RigModel, mode: int, drive: float) -> Three:
    """Return the directions in which joint 1, joint 2 and the arm continue.

    A direction is 1 or -1, or 0 if Coulomb friction holds the joint.
    """
    directions = _directions(x, model, mode)
    if directions[0] != 0.0 and directions[1] != 0.0 and directions[2] != 0.0:
        return directions
    stage = _stage(t, x, (0.0, 0.0, 0.0), model, mode, drive, directions)
    motion, rods = stage.motion, stage.rods
    forward = dry_limits(motion, 1.0, 1.0, model.params, model.active)
    backward = dry_limits(motion, -1.0, -1.0, model.params, model.active)
    of_rods = directions[0], directions[1]
    if directions[2] == 0.0:
        limits0 = (
            dry_limit0(motion, 1.0, model.params, model.active),
            dry_limit0(motion, -1.0, model.params, model.active),
        )
        direction0, direction1, direction2 = slides_with_arm(
            motion, model.base, stage.terms, model.arm, stage.torque0, of_rods, (limits0, forward, backward)
        )
        return direction1, direction2, direction0
    direction1, direction2 = slides(rods, of_rods, forward, backward)
    return direction1, direction2, directions[2]


@subroutine
def _directions(x: RigState, model: RigModel, mode: int) -> Three:
    """Return the directions of joint 1, joint 2 and the arm: the signs of their speeds.

    The direction of a joint without Coulomb friction is nan.
    """
    first = direction_of(x.omega1) if model.required.dry1 else math.nan
    second = direction_of(x.omega2 - x.omega1) if model.required.dry2 else math.nan
    return first, second, direction_of(x.omega0) if model.required.dry0 and mode == FREE else math.nan


@subroutine
def _margins(stage: SteppedStage, model: RigModel, directions: Three) -> Three:
    """Return the margins (limit of friction minus torque) of joints at rest, N m, and inf for other joints."""
    motion, rods = stage.motion, stage.rods
    push1, push2 = pushes(rods, directions[0], directions[1])
    limit1, limit2 = dry_limits(motion, push1, push2, model.params, model.active)
    margin1 = limit1 - abs(push1) if directions[0] == 0.0 else math.inf
    margin2 = limit2 - abs(push2) if directions[1] == 0.0 else math.inf
    if directions[2] != 0.0:
        return margin1, margin2, math.inf
    _, alpha1, alpha2 = held(rods, directions[0], directions[1])
    push0 = push_on_arm(motion, model.base, model.arm, stage.torque0, (alpha1, alpha2))
    return margin1, margin2, dry_limit0(motion, push0, model.params, model.active) - abs(push0)


class TriedStep(NamedTuple):
    """Trial step with unchanged sliding directions.

    It contains the state and the accelerations at the end of the step, and the margins (`_margins`) at its first and
    last stage.
    """

    end: RigState
    alphas: Three
    first: Three
    last: Three


@subroutine
def _runge_kutta(
    t: float, x: RigState, h: float, model: RigModel, mode: int, drive: float, directions: Three
) -> TriedStep:
    """Return one classical Runge-Kutta step of length h.

    The accelerations and margins at the end of the step are those of the last stage.
    """
    resting = directions[0] == 0.0 or directions[1] == 0.0 or directions[2] == 0.0
    reached = _stage(t, x, (0.0, 0.0, 0.0), model, mode, drive, directions)
    first = _margins(reached, model, directions) if resting else (math.inf, math.inf, math.inf)
    k0, k1, k2 = held(reached.rods, directions[0], directions[1])
    p0, p1, p2 = x.omega0, x.omega1, x.omega2
    turn0, turn1, turn2, sum0, sum1, sum2 = p0, p1, p2, k0, k1, k2
    for stage in range(3):
        ahead, weight = (0.5 * h, 2.0) if stage < 2 else (h, 1.0)
        displacements = ahead * p0, ahead * p1, ahead * (p2 - p1)
        state = RigState(
            x.theta0 + ahead * p0, x.theta1 + ahead * p1, x.theta2 + ahead * p2,
            x.omega0 + ahead * k0, x.omega1 + ahead * k1, x.omega2 + ahead * k2, x.internal,
        )  # fmt: skip
        p0, p1, p2 = state.omega0, state.omega1, state.omega2
        reached = _stage(t + ahead, state, displacements, model, mode, drive, directions)
        k0, k1, k2 = held(reached.rods, directions[0], directions[1])
        turn0, turn1, turn2 = turn0 + weight * p0, turn1 + weight * p1, turn2 + weight * p2
        sum0, sum1, sum2 = sum0 + weight * k0, sum1 + weight * k1, sum2 + weight * k2
    last = _margins(reached, model, directions) if resting else (math.inf, math.inf, math.inf)
    sixth = h / 6.0
    internal = internal_after(
        x.internal, sixth * turn0, sixth * turn1, sixth * (turn2 - turn1), model.params, model.active
    )
    end = RigState(
        x.theta0 + sixth * turn0, x.theta1 + sixth * turn1, x.theta2 + sixth * turn2,
        x.omega0 + sixth * sum0, x.omega1 + sixth * sum1, x.omega2 + sixth * sum2, internal,
    )  # fmt: skip
    return TriedStep(end, (k0, k1, k2), first, last)


@subroutine
def _stopped(x: RigState, joint: int, directions: Three, later: float, alphas: Three) -> RigState:
    """Return the state at the instant at which a joint stops.

    The joint stops `later` seconds after the state `x`. The angles are advanced by this time, and the speed of the
    joint is set to zero.
    """
    thetas, omegas = (x.theta0, x.theta1, x.theta2), (x.omega0, x.omega1, x.omega2)
    thetas, omegas = stopped(thetas, omegas, alphas, joint, later, directions[1] == 0.0)
    return RigState(thetas[0], thetas[1], thetas[2], omegas[0], omegas[1], omegas[2], x.internal)


@subroutine
def _joint_motion(x: RigState, trial: TriedStep, directions: Three) -> JointMotion:
    """Return the motion of the joints in a trial step from the state x."""
    y = trial.end
    before, after = of_joints((x.omega0, x.omega1, x.omega2)), of_joints((y.omega0, y.omega1, y.omega2))
    return JointMotion(directions, before, after, of_joints(trial.alphas))


@subroutine
def advanced(
    t: float, x: RigState, h: float, events: int, model: RigModel, mode: int, drive: float
) -> tuple[RigState, float, bool]:
    """Advance the state by a step of length h, or to the first friction event.

    Args:
        t: time since the release, s
        x: state at t
        h: length of the step, s
        events: number of previous events in the whole step
        model: rig with its effects
        mode: mode of the arm
        drive: input of the arm

    Returns:
        the state, the elapsed time (s), and whether the elapsed time equals h
    """
    directions = math.nan, math.nan, math.nan
    dry = model.required.dry1 or model.required.dry2 or model.required.dry0
    if dry:
        directions = directions_at(t, x, model, mode, drive) if events < EVENTS.most else _directions(x, model, mode)
    trial = _runge_kutta(t, x, h, model, mode, drive, directions)
    if not dry:
        return trial.end, h, True
    last = trial.last if events < EVENTS.most else (math.inf, math.inf, math.inf)
    share, joint = first_event(h, _joint_motion(x, trial, directions), trial.first, last)
    if not share < 1.0:
        return trial.end, h, True
    if share < EVENTS.shortest:
        return (_stopped(x, joint, directions, 0.0, trial.alphas) if joint else x), 0.0, False
    part = share * h
    trial = _runge_kutta(t, x, part, model, mode, drive, directions)
    if joint == 0:
        return trial.end, part, False
    joints = _joint_motion(x, trial, directions)
    later = min(correction(joints.after[joint - 1], joints.accelerations[joint - 1], part), h - part)
    return _stopped(trial.end, joint, directions, later, trial.alphas), part + later, False


@subroutine
def stepped(t: float, x: RigState, h: float, model: RigModel, mode: int, drive: float) -> RigState:
    """Advance the state by a step of length h, divided at events of Coulomb friction."""
    time, events, whole = t, 0, False
    while not whole:
        x, passed, whole = advanced(time, x, t + h - time if events else h, events, model, mode, drive)
        time, events = time + passed, events + 1
    return x
