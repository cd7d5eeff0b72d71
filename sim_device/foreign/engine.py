"""The equation of motion of foreign plants, open to torques and states that the lab's kernels do not know.

Plain Python under an adaptive eighth-order rule: what comes out shares neither integrator nor step with the lab.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.equation import accelerations

ERROR = 1e-9
"""Of a step of the integrator, relative, and a tenth of it absolute."""

LONGEST_STEP = 0.02
"""So that no step jumps over a disturbance of short duration, s."""

Slope = Callable[[float, NDArray[np.float64]], Sequence[float]]
"""Time since the release, s, and state (theta1, theta2, omega1, omega2, memory ...) -> its derivative."""

Torques = Callable[[float, float, float, float, float], tuple[float, float]]
"""(t, theta1, theta2, omega1, omega2) -> generalised torques on theta1 and theta2, N m."""


@dataclass(frozen=True, slots=True)
class Body:
    """The rods in base parameters (physics of equation (1)), with the masses and lengths behind them, SI."""

    a: float
    b: float
    d: float
    e1: float
    e2: float
    c1: float
    c2: float
    L1: float
    L2: float
    g: float
    mass: float
    """Of both rods and the encoder on the inner one, kg."""
    outer_mass: float
    """Of the outer rod, kg."""

    @classmethod
    def of(cls, Z: NDArray[np.float64], L1: float, L2: float, g: float) -> "Body":
        """The body of a rig with the nine parameters Z."""
        a, b, d, e1, c1, c2 = base_parameters(Z, L1, g).tolist()
        return cls(a, b, d, e1, d * g / L1, c1, c2, L1, L2, g, float(Z[2:5].sum()), float(Z[3]))

    def accelerations(
        self, theta1: float, theta2: float, omega1: float, omega2: float, tau1: float = 0.0, tau2: float = 0.0
    ) -> tuple[float, float]:
        """Angular accelerations under equation (1), rad/s^2."""
        return accelerations(
            theta1, theta2, omega1, omega2, self.a, self.b, self.d, self.e1, self.e2, self.c1, self.c2, tau1, tau2
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Motion:
    """How the rods move: the derivative of the state, and the memory it starts with."""

    slope: Slope
    memory: tuple[float, ...] = ()
    error: float = ERROR
    """Of a step of the integrator."""


def undisturbed(body: Body) -> Motion:
    """The rods without any further effect."""
    return under(body, lambda t, theta1, theta2, omega1, omega2: (0.0, 0.0))


def under(body: Body, torques: Torques) -> Motion:
    """The rods under further torques that need no memory."""

    def slope(t: float, x: NDArray[np.float64]) -> Sequence[float]:
        theta1, theta2, omega1, omega2 = x.tolist()
        tau1, tau2 = torques(t, theta1, theta2, omega1, omega2)
        return omega1, omega2, *body.accelerations(theta1, theta2, omega1, omega2, tau1, tau2)

    return Motion(slope)


def at_joint2(torque: Callable[[float, float], float]) -> Torques:
    """Torques of something between the rods, from its torque on the outer one (relative angle, relative speed)."""

    def torques(t: float, theta1: float, theta2: float, omega1: float, omega2: float) -> tuple[float, float]:
        tau = torque(theta2 - theta1, omega2 - omega1)
        return -tau, tau

    return torques


def at_joint1(torque: Callable[[float, float], float]) -> Torques:
    """Torques of something between arm and inner rod (angle from hanging, speed)."""

    def torques(t: float, theta1: float, theta2: float, omega1: float, omega2: float) -> tuple[float, float]:
        return torque(theta1 - np.pi, omega1), 0.0

    return torques


def integrate(motion: Motion, state: NDArray[np.float64], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, k) states at the increasing instants `t` (n,), from the state (k,) at t[0]."""
    solved = solve_ivp(
        motion.slope,
        (t[0], t[-1]),
        state,
        method="DOP853",
        t_eval=t,
        rtol=motion.error,
        atol=motion.error / 10,
        max_step=LONGEST_STEP,
    )
    return solved.y.T
