"""Runge-Kutta steps with a motor behind the backlash of the arm's gear.

The physics is that of `dpr_lab.dynamics.lanes.geared_motor`, which contains the equations.
"""

from typing import NamedTuple

from dpr_lab.dynamics.lanes.geared_motor import fed
from dpr_lab.dynamics.step import RigModel, RigState, motion_of, stepped
from dpr_lab.effects.effect_kernels import arm_drives, geared_motor0
from dpr_lab.effects.quantities import ArmModel
from dpr_lab.kernels import subroutine


class GearedState(NamedTuple):
    """State of a rig with a motor behind the backlash of the arm's gear.

    The first seven fields are those of `RigState`. Then follow the angle, rad, and the speed, rad/s, of the motor,
    referred to the arm side of the gear, the impulse that the gear must still transmit, N m s, and its first moment, N
    m s^2. `bonded` is the time for which the motor stays in contact after an impact, s.
    """

    theta0: float
    theta1: float
    theta2: float
    omega0: float
    omega1: float
    omega2: float
    internal: tuple[float, ...]
    motor_angle: float
    motor_speed: float
    owed: float
    behind: float
    bonded: float


AnyState = RigState | GearedState
"""State of a rig with or without a motor behind backlash."""


@subroutine
def arm_of_gear(t: float, x: GearedState, model: RigModel, drive: float) -> tuple[RigModel, float, float, float, float]:
    """Return the rig model for a gear in contact or inside its backlash.

    Returns:
        the model, whose arm has the inertia and friction of the motor only in contact; torque of the gear on the arm
        and torque of the drive on the motor, N m; inertia of the motor, kg m^2; 1 inside the backlash, 0 in contact
    """
    arm, params, active = model.arm, model.params, model.active
    _, _, motor_inertia, loose = geared_motor0(
        x.theta0, x.omega0, x.motor_angle, x.motor_speed, 0.0, 0.0, arm.inertia, arm.friction, params, active
    )
    thetas, omegas = (x.theta0, x.theta1, x.theta2), (x.omega0, x.omega1, x.omega2)
    torque = arm_drives(motion_of(t, thetas, omegas, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)), drive, params, active)
    moved = ArmModel(arm.inertia - loose * motor_inertia, arm.reach, (1.0 - loose) * arm.friction, arm.stiffness)
    rig = RigModel(model.base, model.constants, moved, params, active, model.required)
    return rig, (1.0 - loose) * torque, torque, motor_inertia, loose


@subroutine
def stepped_with_gear(t: float, x: GearedState, h: float, model: RigModel, mode: int, drive: float) -> GearedState:
    """Advance the state by a step of length h, s, with the motor torque `drive`, N m.

    The effects of the drive act on the motor. `model.required` must therefore not include them.
    """
    rig, geared, torque, inertia, loose = arm_of_gear(t, x, model, drive)
    repaid, arm, params, active = fed(x.owed, x.behind, h), model.arm, model.params, model.active
    start = RigState(x.theta0, x.theta1, x.theta2, x.omega0, x.omega1, x.omega2, x.internal)
    y = stepped(t, start, h, rig, mode, geared + repaid)
    angle, speed, still_loose = x.motor_angle + (y.theta0 - x.theta0), y.omega0, 0.0
    if x.bonded <= 0.0:
        angle, speed, _, still_loose = geared_motor0(
            y.theta0, y.omega0, x.motor_angle, x.motor_speed, h, torque, arm.inertia, arm.friction, params, active
        )
    first_speed = x.motor_speed - (1.0 - loose) * x.omega0
    turn = angle - x.motor_angle - (1.0 - loose) * (y.theta0 - x.theta0)
    change = speed - (1.0 - loose) * y.omega0 - first_speed
    more = loose * torque - repaid
    behind = x.behind + h * (x.owed + 0.5 * (more * h - arm.friction * turn)) - inertia * (turn - first_speed * h)
    owed = x.owed + more * h - arm.friction * turn - inertia * change
    bonded = h if loose > still_loose else max(x.bonded - h, 0.0)
    swing = y.theta0, y.theta1, y.theta2, y.omega0, y.omega1, y.omega2, y.internal
    return GearedState(*swing, angle, speed, owed, behind, bonded)
