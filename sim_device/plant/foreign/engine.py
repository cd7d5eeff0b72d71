"""Integrate the equation of motion of plants with out-of-library effects.

The kernels of dpr-lab do not contain the torques and states of these effects. The equation is integrated in plain
Python by an adaptive eighth-order method, so that integrator and step size also differ from those of dpr-lab.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.equation import accelerations

ERROR = 1e-9
"""Relative tolerance of an integration step. The absolute tolerance is a tenth of it."""

LONGEST_STEP = 0.02
"""Maximum step of the integrator, s. It is small enough that no short disturbance is skipped."""

SLIDING_SPEED = 1e-9
"""Minimum speed at which a joint counts as sliding, rad/s."""

Slope = Callable[[float, NDArray[np.float64]], Sequence[float]]
"""Function of the time since the release, s, and the state (theta1, theta2, omega1, omega2, memory ...) that returns
the derivative of the state."""

Torques = Callable[[float, float, float, float, float], tuple[float, float]]
"""Function of (t, theta1, theta2, omega1, omega2) that returns the generalised torques on theta1 and theta2, N m."""


@dataclass(frozen=True, slots=True)
class Body:
    """Rods, described by their base parameters (docs/theory.md (12)), masses and lengths, SI units."""

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
    """Mass of both rods and of the parts at joint 2, kg."""
    outer_mass: float
    """Mass of the outer rod, kg."""

    @classmethod
    def of(cls, Z: NDArray[np.float64], L1: float, L2: float, g: float) -> "Body":
        """Create the rods of a rig with the nine parameters Z."""
        a, b, d, e1, c1, c2 = base_parameters(Z, L1, g).tolist()
        return cls(a, b, d, e1, d * g / L1, c1, c2, L1, L2, g, float(Z[2:5].sum()), float(Z[3]))

    def accelerations(
        self, theta1: float, theta2: float, omega1: float, omega2: float, tau1: float = 0.0, tau2: float = 0.0
    ) -> tuple[float, float]:
        """Compute the angular accelerations according to docs/theory.md (1), rad/s^2."""
        return accelerations(
            theta1, theta2, omega1, omega2, self.a, self.b, self.d, self.e1, self.e2, self.c1, self.c2, tau1, tau2
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class DryJoint:
    """Joint that Coulomb friction can hold at rest: it slides only if the torque exceeds the friction limit."""

    joint: int
    """Number of the joint, 1 or 2."""
    size: Callable[[NDArray[np.float64]], float]
    """Function of the state that returns the friction of the sliding joint, or its maximum if the joint rests, N m."""

    def speed(self, x: NDArray[np.float64]) -> float:
        """Return the speed of the joint, rad/s."""
        return float(x[2] if self.joint == 1 else x[3] - x[2])

    def torques(self, torque: float) -> tuple[float, float]:
        """Return the generalised torques due to a torque in the joint, N m."""
        return (torque, 0.0) if self.joint == 1 else (-torque, torque)

    def holding(self, body: Body, x: NDArray[np.float64]) -> float:
        """Compute the torque in the joint that keeps its speed constant, N m."""
        free, pushed = (self.gain(body, x, torque) for torque in (0.0, 1.0))
        return -free / (pushed - free)

    def alphas(self, body: Body, x: NDArray[np.float64], torque: float) -> tuple[float, float]:
        """Compute the accelerations of the rods under a torque in the joint, rad/s^2."""
        theta1, theta2, omega1, omega2 = x.tolist()
        return body.accelerations(theta1, theta2, omega1, omega2, *self.torques(torque))

    def gain(self, body: Body, x: NDArray[np.float64], torque: float) -> float:
        """Compute the acceleration of the joint under a torque in the joint, rad/s^2."""
        alpha1, alpha2 = self.alphas(body, x, torque)
        return alpha1 if self.joint == 1 else alpha2 - alpha1


@dataclass(frozen=True, slots=True)
class EquationOfMotion:
    """Equation of motion: the derivative of the state, and the initial values of additional states."""

    slope: Slope
    memory: tuple[float, ...] = ()
    error: float = ERROR
    """Relative tolerance of the integrator."""
    sticks: "tuple[Body, DryJoint] | None" = None
    """Rods and their joint with Coulomb friction; `slope` is then the motion without this friction. None without such a
    joint."""


def undisturbed(body: Body) -> EquationOfMotion:
    """Return the equation of motion of the rods without any further effect."""
    return under(body, lambda t, theta1, theta2, omega1, omega2: (0.0, 0.0))


def under(body: Body, torques: Torques) -> EquationOfMotion:
    """Return the equation of motion of the rods under further torques, without additional states."""

    def slope(t: float, x: NDArray[np.float64]) -> Sequence[float]:
        theta1, theta2, omega1, omega2 = x.tolist()
        tau1, tau2 = torques(t, theta1, theta2, omega1, omega2)
        return omega1, omega2, *body.accelerations(theta1, theta2, omega1, omega2, tau1, tau2)

    return EquationOfMotion(slope)


def at_joint2(torque: Callable[[float, float], float]) -> Torques:
    """Return the torques of an element between the rods.

    `torque` is its torque on the outer rod, as a function of relative angle and relative speed.
    """

    def torques(t: float, theta1: float, theta2: float, omega1: float, omega2: float) -> tuple[float, float]:
        tau = torque(theta2 - theta1, omega2 - omega1)
        return -tau, tau

    return torques


def at_joint1(torque: Callable[[float, float], float]) -> Torques:
    """Return the torques of an element between arm and inner rod.

    `torque` is its torque on the inner rod, as a function of the angle from the hanging position and the speed.
    """

    def torques(t: float, theta1: float, theta2: float, omega1: float, omega2: float) -> tuple[float, float]:
        return torque(theta1 - np.pi, omega1), 0.0

    return torques


def sticking(body: Body, joint: int, size: Callable[[NDArray[np.float64]], float]) -> EquationOfMotion:
    """Return the equation of motion of rods with Coulomb friction in one joint.

    The level of the friction may depend on the state.
    """
    return replace(undisturbed(body), sticks=(body, DryJoint(joint, size)))


def integrate(motion: EquationOfMotion, state: NDArray[np.float64], t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the states (n, k) at the increasing times `t` (n,), from the state (k,) at t[0]."""
    if motion.sticks is not None:
        return _integrate_sticking(motion.error, *motion.sticks, state, t)
    return _solved(motion.slope, motion.error, state, t[0], t).y.T


def _solved(
    slope: Slope, error: float, state: NDArray[np.float64], first: float, t: NDArray[np.float64], event: Any = None
) -> Any:
    from scipy.integrate import solve_ivp  # imported here, because the import is slow and few plants need it

    return solve_ivp(
        slope, (first, t[-1]), state, "DOP853", t, events=event, rtol=error, atol=error / 10, max_step=LONGEST_STEP
    )


def _integrate_sticking(
    error: float, body: Body, dry: DryJoint, state: NDArray[np.float64], t: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Integrate the motion with a joint that stops and starts, separately between these events."""
    states, x, first = [state[None]], state, t[0]
    t, side = t[1:], float(np.sign(dry.speed(x))) or _starts(body, dry, x)
    while len(t):
        solved = _solved(_sliding_slope(body, dry, side), error, x, first, t, _change(body, dry, side))
        # `solved.y` is an empty list if an event precedes all instants
        states.append(np.reshape(solved.y, (len(x), -1)).T)
        t = t[len(solved.t) :]
        if solved.status == 1:
            began, first, x = first, float(solved.t_events[0][-1]), solved.y_events[0][-1].copy()
            x[1 + dry.joint] = 0.0 if dry.joint == 1 else x[2]
            # A joint that has just broken away transmits the limit torque; rounding must not stop it again.
            side = _starts(body, dry, x) if side else _pushed(body, dry, x)
            if first == began:  # a slide that is shorter than a step: its start was detected as its end
                x[1 + dry.joint] += side * SLIDING_SPEED
    return np.concatenate(states)


def _starts(body: Body, dry: DryJoint, x: NDArray[np.float64]) -> float:
    """Return the direction in which a resting joint starts to slide, or 0 if it remains at rest."""
    return 0.0 if abs(dry.holding(body, x)) < dry.size(x) else _pushed(body, dry, x)


def _pushed(body: Body, dry: DryJoint, x: NDArray[np.float64]) -> float:
    return -float(np.sign(dry.holding(body, x)))


def _sliding_slope(body: Body, dry: DryJoint, side: float) -> Slope:
    def slope(t: float, x: NDArray[np.float64]) -> Sequence[float]:
        torque = -side * dry.size(x) if side else dry.holding(body, x)
        return x[2], x[3], *dry.alphas(body, x, torque)

    return slope


def _change(body: Body, dry: DryJoint, side: float) -> Any:
    """Return an event function, which decreases through zero when the joint stops or must start to slide."""

    def left(t: float, x: NDArray[np.float64]) -> float:
        return side * dry.speed(x) if side else dry.size(x) - abs(dry.holding(body, x))

    event: Any = left
    event.terminal, event.direction = True, -1
    return event
