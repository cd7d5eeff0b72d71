"""Motor behind the backlash of the arm's gear, computed in the lanes.

Inside the backlash the arm moves alone, without the inertia J and the viscous friction c0 of the motor. In contact, arm
and motor are one body. Contact is decided at the start of each step; h is the length of the step. Each step is computed
first for the arm, then for the motor. Let q be the angle of the motor and tau its torque. The balance of the motor's
momentum gives the impulse P of the gear and its first moment M about the end of the step:

    P = tau h - c0 (change of q) - J (change of dq/dt)
    M = tau h^2/2 - c0 h/2 (change of q) - J (change of q - h dq/dt at the start)

The parts of P and M that the torques of the step already contained are subtracted. A torque (`fed`) transmits the
remainder of impulse and moment to the arm within two steps. Momentum is therefore also conserved at an impact, and the
arm moves as after an impact at its exact instant. After an impact the motor stays in contact for one step, in which
both bodies take their common speed. The loops over lanes have the form described in `stepping`.
"""

from dpr_lab.arrays import Flags
from dpr_lab.dynamics.lanes.effects import follow_motor
from dpr_lab.dynamics.lanes.interpolation import angle0, speed0
from dpr_lab.dynamics.lanes.workspace import LaneWorkspace, waits
from dpr_lab.kernels import subroutine


@subroutine
def begin_gear(w: LaneWorkspace) -> None:
    """Set the inertia and friction of the arm for the next step, and store the state of the motor."""
    for k in range(len(w.t)):
        w.old_hold0[k], w.old_motor_speed0[k], w.old_loose0[k] = w.hold0[k], w.motor_speed0[k], w.loose0[k]
        w.inertia[k] = w.geared_inertia[k] - w.loose0[k] * w.motor_inertia0[k]
        w.friction[k] = (1.0 - w.loose0[k]) * w.geared_friction[k]
        w.fed0[k] = fed(w.owed0[k], w.behind0[k], w.step[k])
        w.followed0[k] = 0.0


@subroutine
def fed(owed: float, behind: float, step: float) -> float:
    """Return the torque of the gear in the next step, N m.

    Together with the torque of the step after it, this torque transmits an impulse and its first moment.

    Args:
        owed: impulse, N m s
        behind: first moment of the impulse, N m s^2
        step: length of a step, s
    """
    return (1.5 * owed + behind / step) / step


@subroutine
def transmit(w: LaneWorkspace) -> None:
    """Replace the drive torque by the torque of the gear on the arm.

    The torque includes the impulse that the gear has not yet transmitted.
    """
    for k in range(len(w.t)):
        w.motor_torque0[k] = w.torque0[k]
        w.torque0[k] = (1.0 - w.old_loose0[k]) * w.motor_torque0[k] + w.fed0[k]


@subroutine
def follow(w: LaneWorkspace, active: Flags, until: float) -> None:
    """Advance each motor to the fraction `share` of the step, unless `share` exceeds `until`."""
    for k in range(len(w.t)):
        u = w.share[k] if w.share[k] <= until else w.followed0[k]
        w.angle0[k], w.speed0[k] = angle0(w, k, u), speed0(w, k, u)
        w.elapsed0[k] = (u - w.followed0[k]) * w.h[k]
        w.followed0[k] = u
    follow_motor(w, active)
    for k in range(len(w.t)):
        bonded = w.bonded0[k] > 0.0
        w.hold0[k] = w.old_hold0[k] + (w.angle0[k] - w.old_theta0[k]) if bonded else w.hold0[k]
        w.motor_speed0[k] = w.speed0[k] if bonded else w.motor_speed0[k]
        w.loose0[k] = 0.0 if bonded else w.loose0[k]


@subroutine
def balance_gear(w: LaneWorkspace) -> None:
    """Compute the impulse that the gear must still transmit after a step.

    Before the release, the motor moves with the arm, and the impulse is zero.
    """
    for k in range(len(w.t)):
        h, geared = w.h[k], 1.0 - w.old_loose0[k]
        first_speed = w.old_motor_speed0[k] - geared * w.old_omega0[k]
        turn = w.hold0[k] - w.old_hold0[k] - geared * (w.theta0[k] - w.old_theta0[k])
        change = w.motor_speed0[k] - geared * w.omega0[k] - first_speed
        torque = w.old_loose0[k] * w.motor_torque0[k] - w.fed0[k]
        friction, inertia = w.geared_friction[k], w.motor_inertia0[k]
        w.behind0[k] += h * (w.owed0[k] + 0.5 * (torque * h - friction * turn)) - inertia * (turn - first_speed * h)
        w.owed0[k] += torque * h - friction * turn - inertia * change
        impact = w.old_loose0[k] > w.loose0[k]
        w.bonded0[k] = w.step[k] if impact else max(w.bonded0[k] - h, 0.0)
        if waits(w, k):
            w.hold0[k], w.motor_speed0[k] = w.theta0[k], w.omega0[k]
            w.owed0[k], w.behind0[k], w.bonded0[k] = 0.0, 0.0, 0.0
