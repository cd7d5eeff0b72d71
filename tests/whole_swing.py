"""Swings of the rig with its arm, and the energy of the rods, for comparison."""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpr_lab.dynamics.arm import CLAMPED, ArmParameters
from dpr_lab.dynamics.schedule import MAX_STEP
from dpr_lab.dynamics.simulate import at_release, integrate, rig_model
from dpr_lab.effects.quantities import RigConstants


def simulate_arm(
    Z: ArrayLike,
    frame: tuple[float, float, float],
    arm: ArmParameters,
    state: ArrayLike,
    t: ArrayLike,
    max_step: float = MAX_STEP,
    effects: ArrayLike | None = None,
    drive: ArrayLike = 0.0,
    constants: RigConstants | None = None,
) -> NDArray[np.float64]:
    """Simulate a swing of the whole rig with the arm clamped, free or driven.

    Args:
        Z: (9,) parameters in the order of `dpr_lab.rig.PARAMETERS`, SI
        frame: L0 (m), L1 (m), g (m/s^2)
        arm: J0 (kg m^2), c0 (N m s/rad), k0 (N m/rad) and mode; a clamped arm stays at rest
        state: (6,) theta0, theta1, theta2, omega0, omega1, omega2 at t[0], rad and rad/s
        t: (n,) increasing instants, s
        max_step: longest Runge-Kutta step, s
        effects: (SIZE,) vector of `dpr_lab.effects`, SI; None: all off
        drive: (n,) or scalar, constant from each instant to the next: torque on a free arm, N m, or acceleration of a
            driven one, rad/s^2
        constants: measured constants of the rig; None: the lengths of `frame` and the masses of Z

    Returns:
        (n, 6) states at `t`; nan after the swing becomes non-finite

    Raises:
        ValueError: wrong shapes, an unknown mode, an unclamped arm together with an effect that moves the arm, or
            instants that do not increase.
    """
    model, mode = rig_model(Z, frame, arm, effects, constants)
    start = np.array(state, dtype=np.float64)
    if mode == CLAMPED:
        start[3] = 0.0
    return integrate(model, mode, at_release(start), t, max_step, drive)[:, :6]


def energy(
    theta1: float, theta2: float, omega1: float, omega2: float, a: float, b: float, d: float, e1: float, e2: float
) -> float:
    """Kinetic and potential energy of the rods, J; zero height at joint 1. Arguments are those of `accelerations`."""
    kinetic = 0.5 * (a * omega1**2 + b * omega2**2) + d * math.cos(theta1 - theta2) * omega1 * omega2
    return kinetic + e1 * math.cos(theta1) + e2 * math.cos(theta2)
