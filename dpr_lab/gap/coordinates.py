"""Free functions of one coordinate along a swing, as sums of hats: of an angle, a speed, the time, a joint's load."""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.gap.problem import Problem
from dpr_lab.gap.response import Course

Array = NDArray[np.float64]

BINS = 10


def hats(x: Array, knots: Array) -> Array:
    """(n, k) piecewise linear functions that sum to one."""
    place = np.clip(np.interp(x, knots, np.arange(len(knots))), 0, len(knots) - 1 - 1e-9)
    lower = place.astype(int)
    found = np.zeros((len(x), len(knots)))
    found[np.arange(len(x)), lower] = 1 - (place - lower)
    found[np.arange(len(x)), lower + 1] = place - lower
    return found


def angle_hats(angle: Array) -> tuple[Array, Array]:
    """(n, k) hats around the circle, and their knots."""
    knots = np.linspace(-math.pi, math.pi, BINS + 1)
    found = hats((angle + math.pi) % (2 * math.pi) - math.pi, knots)
    found[:, 0] += found[:, -1]
    return found[:, :-1], knots[:-1]


def speed_hats(speed: Array) -> tuple[Array, Array]:
    """(n, k) hats over signed roots of the speed, closer together where dry friction lives, and their knots."""
    top = max(float(np.quantile(np.abs(speed), 0.99)), 1e-3)
    roots = np.linspace(-1, 1, BINS)
    knots = np.sign(roots) * roots**2 * top
    return hats(speed, knots), knots


def time_hats(t: Array) -> tuple[Array, Array]:
    """(n, k) hats from the release to the last instant, and their knots."""
    knots = np.linspace(0, float(t.max()), BINS)
    return hats(t, knots), knots


def load_hats(force: Array) -> tuple[Array, Array]:
    """(n, k) hats over the forces that occur often, and their knots."""
    knots = np.quantile(force, np.linspace(0.01, 0.99, BINS // 2))
    return hats(force, knots), knots


def joint_force(problem: Problem, along: Course, joint: int) -> Array:
    """(n,) force that a joint carries, N, from masses times accelerations of equation (1)."""
    known, sin, cos = problem.known, np.sin(along.theta), np.cos(along.theta)
    across = cos * along.alpha - sin * along.omega**2
    up = -sin * along.alpha - cos * along.omega**2
    inner, outer = along.base[3] / known.g, along.base[2] / known.L1
    if joint == 0:
        weight = (known.m1 + known.m2 + known.mb) * known.g
        lengths = np.array([inner, outer])
    else:
        weight = known.m2 * known.g
        lengths = np.array([known.m2 * known.L1, outer])
    return np.hypot(across @ lengths, up @ lengths + weight)


def encoder_angle(problem: Problem, joint: int) -> Array:
    """(samples,) what the encoder of a joint reads from hanging, rad."""
    return problem.measured[:, joint] - (math.pi if joint == 0 or not problem.relative else 0.0)


def encoder_speed(along: Course, joint: int) -> Array:
    """(samples,) speed of a joint at the samples, rad/s."""
    return np.interp(along.at, np.arange(len(along.t)), along.joint_speed[:, joint])


def under_torque(along: Course, joint: int, torque: Array) -> Array:
    """(samples, 2, k) change of the readings under torques of a joint, (n, k), N m."""
    pair = np.stack([torque, np.zeros_like(torque)] if joint == 0 else [-torque, torque], axis=1)
    return along.readings(np.ascontiguousarray(pair))
