"""Steps of a rig whose arm has a motor behind the backlash of a gear: the physics of `dpr_lab.dynamics.lanes`.

`dpr_lab.dynamics.lanes.geared_motor` contains the equations.
"""

from typing import NamedTuple

from dpr_lab.dynamics.lanes.interpolation import cubic
from dpr_lab.dynamics.step import RigModel, RigState, motion_of, stepped
from dpr_lab.effects.effect_kernels import arm_drives, geared_motor0
from dpr_lab.effects.quantities import ArmModel
from dpr_lab.kernels import subroutine


class GearedState(NamedTuple):
    """Fields of `RigState`, and the motor as seen at the arm: angle rad, speed rad/s, and owed impulse, N m s."""

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


AnyState = RigState | GearedState
"""State of a rig with or without a motor behind backlash."""


@subroutine
def stepped_with_gear(t: float, x: GearedState, h: float, model: RigModel, mode: int, drive: float) -> GearedState:
    """State one step of h later; `drive` is the known torque of the motor, N m.

    The model does not require the effects of the drive: they act on the motor.
    """
    arm, params, active = model.arm, model.params, model.active
    angle, speed, motor_inertia, loose = geared_motor0(
        x.theta0, x.omega0, x.motor_angle, x.motor_speed, 0.0, 0.0, arm.inertia, arm.friction, params, active
    )
    thetas, omegas = (x.theta0, x.theta1, x.theta2), (x.omega0, x.omega1, x.omega2)
    torque = arm_drives(motion_of(t, thetas, omegas, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0)), drive, drive, params, active)
    moved = ArmModel(arm.inertia - loose * motor_inertia, arm.reach, (1.0 - loose) * arm.friction, arm.stiffness)
    rig = RigModel(model.base, model.constants, moved, params, active, model.required)
    start = RigState(x.theta0, x.theta1, x.theta2, x.omega0, x.omega1, x.omega2, x.internal)
    y = stepped(t, start, h, rig, mode, (1.0 - loose) * torque + x.owed / h)
    for quarter in range(4):
        u = 0.25 * (quarter + 1)
        theta0 = cubic(u, h, x.theta0, x.omega0, y.theta0, y.omega0)
        omega0 = x.omega0 + u * (y.omega0 - x.omega0)
        angle, speed, _, _ = geared_motor0(
            theta0, omega0, angle, speed, 0.25 * h, torque, arm.inertia, arm.friction, params, active
        )
    turn = angle - x.motor_angle - (1.0 - loose) * (y.theta0 - x.theta0)
    change = speed - x.motor_speed - (1.0 - loose) * (y.omega0 - x.omega0)
    owed = loose * torque * h - arm.friction * turn - motor_inertia * change
    return GearedState(y.theta0, y.theta1, y.theta2, y.omega0, y.omega1, y.omega2, y.internal, angle, speed, owed)
