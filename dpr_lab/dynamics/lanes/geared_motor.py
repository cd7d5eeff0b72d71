"""Motor behind the backlash of the arm's gear in the lanes: followed through each step after the arm.

Inside the backlash the arm moves alone, without the inertia and the viscous friction of the motor; in contact both are
one body. The mode is that at the start of a step. Once the motor has been followed, the impulse of the gear is known
from the balance of its momentum, and the arm receives in the next step what it lacked in this one:

    P = tau h - c0 (change of h) - J (change of dh/dt),    owed += P - impulse of the gear that the step contained

so that momentum is conserved, at an impact too. Loops over lanes as in `stepping`.
"""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.lanes.effects import follow_motor
from dpr_lab.dynamics.lanes.interpolation import angle0, speed0
from dpr_lab.dynamics.lanes.workspace import LANES, LaneWorkspace, waits
from dpr_lab.kernels import subroutine


@subroutine
def begin_gear(w: LaneWorkspace) -> None:
    """Set the arm's inertia and friction of the step, and copy the state of the motor."""
    for k in range(LANES):
        w.old_hold0[k], w.old_motor_speed0[k], w.old_loose0[k] = w.hold0[k], w.motor_speed0[k], w.loose0[k]
        w.inertia[k] = w.geared_inertia[k] - w.loose0[k] * w.motor_inertia0[k]
        w.friction[k] = (1.0 - w.loose0[k]) * w.geared_friction[k]
        w.followed0[k] = 0.0


@subroutine
def transmit(w: LaneWorkspace) -> None:
    """Replace the torque of the drive by that of the gear on the arm, with the owed impulse over one step."""
    for k in range(LANES):
        w.motor_torque0[k] = w.torque0[k]
        w.torque0[k] = (1.0 - w.old_loose0[k]) * w.motor_torque0[k] + w.owed0[k] / w.step[k]


@subroutine
def follow(w: LaneWorkspace, active: NDArray[np.bool_], until: float) -> None:
    """Move each motor up to the share `share` of the step if this is at most `until`."""
    for k in range(LANES):
        u = w.share[k] if w.share[k] <= until else w.followed0[k]
        w.angle0[k], w.speed0[k] = angle0(w, k, u), speed0(w, k, u)
        w.elapsed0[k] = (u - w.followed0[k]) * w.h[k]
        w.followed0[k] = u
    follow_motor(w, active)


@subroutine
def balance_gear(w: LaneWorkspace) -> None:
    """Set the owed impulse after a step; before the release the motor moves as the arm."""
    for k in range(LANES):
        h, geared = w.h[k], 1.0 - w.old_loose0[k]
        turn, change = w.hold0[k] - w.old_hold0[k], w.motor_speed0[k] - w.old_motor_speed0[k]
        turn -= geared * (w.theta0[k] - w.old_theta0[k])
        change -= geared * (w.omega0[k] - w.old_omega0[k])
        w.owed0[k] += w.old_loose0[k] * w.motor_torque0[k] * h - w.owed0[k] * h / w.step[k]
        w.owed0[k] -= w.geared_friction[k] * turn + w.motor_inertia0[k] * change
        if waits(w, k):
            w.hold0[k], w.motor_speed0[k], w.owed0[k] = w.theta0[k], w.omega0[k], 0.0
