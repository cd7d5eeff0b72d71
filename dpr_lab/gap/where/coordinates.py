"""Free-form torques and encoder errors, each a sum of hat functions of one coordinate."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dpr_lab.arrays import Array, without_turns
from dpr_lab.effects.effect import ARM
from dpr_lab.fitting.linearise import Linearisation
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.fitting.response import Trajectory

BINS = 10
"""Number of hat functions over a coordinate: enough for a friction curve, and few enough to be determined by the
readings."""

Kind = Literal["torque", "friction", "error"]
"""Kind of a free function: torque or viscous friction coefficient of a joint, or error of its encoder."""

Coordinate = Literal["angle", "speed", "time"]


@dataclass(frozen=True, slots=True)
class FreeFunctions:
    """Hat functions of one coordinate, for the torque, the viscous friction or the encoder error of a joint."""

    joint: int
    kind: Kind
    coordinate: Coordinate
    values: Array
    """(n, k) torques along the trajectory, or (samples, k) errors of the encoder, per unit of each function."""
    knots: Array
    """(k,) coordinates of the maxima of the functions: rad, rad/s or s."""
    unit: str
    """Unit of the coefficients: N m, N m s/rad (friction over time) or rad (error)."""

    def readings(self, problem: Problem, reference: Trajectory) -> Array:
        """Compute the (segments, m, k) whitened change of the readings per unit of each function."""
        if self.kind != "error":
            return under_torque(problem, reference, self.joint, self.values)
        readings = np.zeros((len(self.values), problem.axes, len(self.knots)))
        readings[:, self.joint] = self.values
        return problem.whitened(readings)


def free_functions(
    problem: Problem, reference: Trajectory, joint: int, kind: Kind, coordinate: Coordinate
) -> FreeFunctions:
    """Create the hat functions of one kind over one coordinate of a joint."""
    speed = reference.joint_speed[:, joint]
    unit = "rad" if kind == "error" else "N m"
    match kind, coordinate:
        case "torque", "angle":
            values, knots = angle_hats(reference.joint_angle[:, joint])
        case "torque", "speed":
            values, knots = speed_hats(speed)
        case "friction", "time":
            values, knots = time_hats(reference.motion.t)
            values, unit = -values * speed[:, None], "N m s/rad"
        case "error", "angle":
            values, knots = angle_hats(encoder_angle(problem, joint))
        case _:
            values, knots = speed_hats(encoder_speed(reference, joint))
    return FreeFunctions(joint, kind, coordinate, values, knots, unit)


def hats(x: Array, knots: Array) -> Array:
    """Evaluate (n, k) hat functions, which have their maxima at the knots and sum to one; x is clipped to the knots."""
    return np.stack([np.interp(x, knots, unit) for unit in np.eye(len(knots))], axis=1)


def angle_hats(angle: Array) -> tuple[Array, Array]:
    """Return (n, k) periodic hat functions of an angle, and the angles of their knots, rad."""
    knots = np.linspace(-math.pi, math.pi, BINS + 1)
    weights = hats(without_turns(angle), knots)
    weights[:, 0] += weights[:, -1]
    return weights[:, :-1], knots[:-1]


def speed_hats(speed: Array) -> tuple[Array, Array]:
    """Return (n, k) hat functions of the speed, and their knots, rad/s.

    The knots are denser at low speed.
    """
    top = max(float(np.quantile(np.abs(speed), 0.99)), 1e-3)
    roots = np.linspace(-1, 1, BINS)
    knots = np.sign(roots) * roots**2 * top
    return hats(speed, knots), knots


def time_hats(t: Array) -> tuple[Array, Array]:
    """Return (n, k) hat functions of the time since the release, and their knots, s."""
    knots = np.linspace(0, float(t.max()), BINS)
    return hats(t, knots), knots


def encoder_angle(problem: Problem, joint: int) -> Array:
    """Return the (samples,) readings of the encoder of a joint as angles from hanging, rad."""
    turned = joint in (2, ARM) or (joint == 1 and problem.model.constants.relative2 == 1.0)
    return problem.measured[:, joint] - (0.0 if turned else math.pi)


def encoder_speed(reference: Trajectory, joint: int) -> Array:
    """Return the (samples,) speed of a joint at the samples, rad/s."""
    return np.interp(reference.at, np.arange(len(reference.motion.t)), reference.joint_speed[:, joint])


def beyond_fit(linear: Linearisation, fitted: Sequence[int], columns: Array) -> ColumnSpace:
    """Return the space of `columns` (segments, m, k) with the columns of the fitted parameters projected out."""
    space = ColumnSpace.of(np.concatenate([linear.A[:, :, fitted], columns], axis=2), linear.e)
    return space.projected_out(slice(0, len(fitted)), slice(len(fitted), None))


def under_torque(problem: Problem, reference: Trajectory, joint: int, torque: Array) -> Array:
    """Return the (segments, m, k) whitened change of the readings by (n, k) torques of a joint, N m."""
    zeros = np.zeros_like(torque)
    on_rods = {0: [torque, zeros], 1: [-torque, torque]}.get(joint, [zeros, zeros])
    torques = [*on_rods, torque if joint in (2, ARM) else zeros][: problem.axes]
    return reference.response(problem, np.stack(torques, axis=1))
