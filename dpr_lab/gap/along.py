"""Generalised torques that effects exert along a swing that is known: what the rods do, the effects left out."""

import math
from collections.abc import Callable, Mapping

import numba
import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.step import mechanics
from dpr_lab.effects import place
from dpr_lab.effects.folded import switched
from dpr_lab.effects.quantities import Known, Motion, Rods
from dpr_lab.gap.problem import Problem
from dpr_lab.gap.response import Course
from dpr_lab.kernels import njit

Array = NDArray[np.float64]


def torques_along(problem: Problem, along: Course, vectors: Array) -> Array:
    """(n, 2, k) generalised torques, N m, of k effect vectors (k, SIZE) along a course."""
    a, b, d, e1, c1, c2 = along.base
    rods = Rods(a, b, d, e1, d * problem.known.g / problem.known.L1, c1, c2)
    on = np.array([switched(vector) for vector in vectors])
    return _torques(along.t, along.theta, along.omega, rods, problem.known, vectors, on)


@njit(parallel=True)
def _torques(
    t: Array, theta: Array, omega: Array, rods: Rods, known: Known, vectors: Array, on: NDArray[np.bool_]
) -> Array:
    found = np.empty((len(t), 2, len(vectors)))
    for i in numba.prange(len(t)):
        sin1, cos1, sin2, cos2 = (
            math.sin(theta[i, 0]),
            math.cos(theta[i, 0]),
            math.sin(theta[i, 1]),
            math.cos(theta[i, 1]),
        )
        motion = Motion(
            t[i], 0.0, theta[i, 0], theta[i, 1], 0.0, omega[i, 0], omega[i, 1],
            sin1, cos1, sin2, cos2, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
        )  # fmt: skip
        for k in range(len(vectors)):
            terms = mechanics(motion, rods, known, vectors[k], on[k])
            found[i, 0, k] = terms.torque1
            found[i, 1, k] = terms.torque2
    return found


def arm_torques(problem: Problem, along: Course, vectors: Array) -> Array:
    r"""(n, 2, k) generalised torques, N m, of a slightly compliant arm, for k effect vectors (k, SIZE).

    The rods drive the arm, alpha0 + 2 zeta w omega0 + w^2 theta0 = F coupling / L0^2, and its acceleration drives them:

        F = r sum_i e_i (sin(theta_i) omega_i^2 - cos(theta_i) alpha_i),    tau_i = -r e_i cos(theta_i) alpha0,

    with r = L0 / g; the first order in the coupling of `dpr_lab.dynamics.arm`. The arm is held until the release.
    """
    known, (_, _, d, e1, _, _) = problem.known, along.base
    levers = known.L0 / known.g * np.array([e1, d * known.g / known.L1])
    sine, cosine = np.sin(along.theta), np.cos(along.theta)
    force = (sine * along.omega**2 - cosine * along.alpha) @ levers
    coupling, frequency, damping = (
        vectors[:, place("arm_compliance", name)] for name in ("coupling_per_kg", "frequency_hz", "damping_ratio")
    )
    swing = _driven(along.t, along.run, force, 2 * np.pi * frequency, damping) * coupling / known.L0**2
    return -(cosine * levers)[:, :, None] * swing[:, None, :]


@njit(parallel=True)
def _driven(t: Array, run: NDArray[np.int64], force: Array, speed: Array, damping: Array) -> Array:
    """(n, k) accelerations of oscillators of mass 1 that rest until t = 0, by the trapezoidal rule."""
    found = np.zeros((len(t), len(speed)))
    for k in numba.prange(len(speed)):
        friction, stiffness = 2.0 * damping[k] * speed[k], speed[k] * speed[k]
        x, v = 0.0, 0.0
        for i in range(len(t)):
            if t[i] < 0.0:
                continue
            h, before = 0.0, 0.0
            if i == 0 or run[i] != run[i - 1] or t[i - 1] < 0.0:
                x, v = 0.0, 0.0
            else:
                h, before = max(t[i] - t[i - 1], 0.0), found[i - 1, k]
            ahead, onward = x + h * v + 0.25 * h * h * before, v + 0.5 * h * before
            now = (force[i] - friction * onward - stiffness * ahead) / (
                1.0 + 0.5 * h * friction + 0.25 * h * h * stiffness
            )
            x, v = ahead + 0.25 * h * h * now, onward + 0.5 * h * now
            found[i, k] = now
    return found


ALONG: Mapping[str, Callable[[Problem, Course, Array], Array]] = {"torque": torques_along, "arm": arm_torques}
"""Stage of an effect -> its torques along a swing, for the stages that have them."""
