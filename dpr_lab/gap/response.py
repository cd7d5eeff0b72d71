r"""What small torques along a known swing do to the readings, by variation of constants.

With Phi(t) the sensitivity of the state to the start state and M the mass matrix,

    dx(t) = Phi(t) integral Phi(s)^-1 [0; M(s)^-1 tau(s)] ds,

so that any number of torques along the same swing cost one matrix product each. Used where there are hundreds of them:
maps of torque over angle, speed, time, and shapes (orders, frequencies) that are scanned.
"""

from dataclasses import dataclass
from itertools import pairwise

import numba
import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import base_from_ratios
from dpr_lab.dynamics.segments import segments as laid_end_to_end
from dpr_lab.dynamics.sensitivity import sensitivities
from dpr_lab.gap.problem import Point, Problem
from dpr_lab.kernels import njit

Array = NDArray[np.float64]

GRID_S = 2.5e-3
WILDEST = 1e6  # rad, rad/s, that no swing reaches


@dataclass(frozen=True, slots=True)
class Course:
    """The swings of all segments on a fine grid, and how they answer to a torque."""

    t: Array
    """(n,) since the release, s."""
    run: NDArray[np.int64]
    """(n,)"""
    theta: Array
    """(n, 2) rad"""
    omega: Array
    """(n, 2) rad/s"""
    alpha: Array
    """(n, 2) rad/s^2"""
    base: Array
    """(6,) base parameters, SI."""
    into: Array
    """(n, 4, 2) Phi^-1 [0; M^-1]: from generalised torques to the start state's measure."""
    out: Array
    """(samples, 2, 4) from there to the encoder readings at the samples."""
    at: Array
    """(samples,) place of each sample on the grid, in grid points."""
    edges: NDArray[np.int64]
    """(segments + 1,) where the segments begin on the grid."""
    steps: Array
    """(n,) grid spacing after each point, s; zero at the last of a segment."""

    def readings(self, torque: Array) -> Array:
        """(samples, 2, k) change of the encoder readings under generalised torques, (n, 2, k), N m."""
        return _answer(self.into, self.out, self.at, self.edges, self.steps, torque)

    @property
    def joint_angle(self) -> Array:
        """(n, 2) angle of joint 1 and of joint 2, 0 = hanging straight, rad."""
        return np.stack([self.theta[:, 0] - np.pi, self.theta[:, 1] - self.theta[:, 0]], axis=1)

    @property
    def joint_speed(self) -> Array:
        """(n, 2) speed of joint 1 and of joint 2, rad/s."""
        return np.stack([self.omega[:, 0], self.omega[:, 1] - self.omega[:, 0]], axis=1)


def course(problem: Problem, point: Point) -> Course:
    """Follow the swings of a point, with its ratios and start states; its effects are small and left out."""
    L1, g = problem.rig.rig.L1, problem.rig.rig.g
    instants = [_grid(first, last) for first, last in problem.spans]
    swings = laid_end_to_end(instants, point.starts, GRID_S)
    states, slopes = sensitivities(point.rods[:5], L1, g, swings)
    base = point.rods[5] * base_from_ratios(point.rods[:5])
    phi = slopes[:, :, 5:]
    lost = ~(np.isfinite(phi).all(axis=(1, 2)) & (np.abs(states) < WILDEST).all(axis=1))
    phi[lost], states[lost] = np.eye(4), 0.0
    lost |= np.abs(np.linalg.det(phi)) < 1e-9
    inverse, alpha = _accelerations(base, L1, g, states)
    phi[lost], inverse[lost] = np.eye(4), 0.0  # a swing that cannot be followed answers to nothing
    t = np.concatenate(instants)
    steps = np.diff(t, append=t[-1])
    steps[swings.offsets[1:] - 1] = 0.0
    owner = np.repeat(np.arange(len(instants)), np.diff(problem.offsets))
    at = np.concatenate(
        [
            swings.offsets[s] + np.interp(problem.t[i:j], instants[s], np.arange(len(instants[s])))
            for s, (i, j) in enumerate(pairwise(problem.offsets))
        ]
    )
    lower = np.minimum(at.astype(np.int64), swings.offsets[owner + 1] - 2)
    share = (at - lower)[:, None, None]
    out = (1 - share) * phi[lower, :2] + share * phi[lower + 1, :2]
    if problem.relative:
        out = out - np.array([0.0, 1.0])[:, None] * out[:, :1]
    return Course(
        t=t,
        run=np.repeat(problem.run, np.diff(swings.offsets)),
        theta=states[:, :2],
        omega=states[:, 2:],
        alpha=alpha,
        base=base,
        into=np.asarray(
            np.linalg.solve(phi, np.concatenate([np.zeros_like(inverse), inverse], axis=1)), dtype=np.float64
        ),
        out=out,
        at=at,
        edges=swings.offsets,
        steps=steps,
    )


def _grid(first: float, last: float) -> Array:
    return np.linspace(first, last, max(2, int(np.ceil((last - first) / GRID_S)) + 1))


def _accelerations(base: Array, L1: float, g: float, states: Array) -> tuple[Array, Array]:
    """(n, 2, 2) inverse mass matrices and (n, 2) accelerations of equation (1)."""
    a, b, d, e1, c1, c2 = base
    theta1, theta2, omega1, omega2 = states.T
    coupling, twist = d * np.cos(theta1 - theta2), d * np.sin(theta1 - theta2)
    inverse = np.stack([np.stack([b + 0 * coupling, -coupling]), np.stack([-coupling, a + 0 * coupling])])
    inverse = np.moveaxis(inverse / (a * b - coupling**2), -1, 0)
    friction2 = c2 * (omega2 - omega1)
    right = np.stack(
        [
            -twist * omega2**2 - c1 * omega1 + friction2 + e1 * np.sin(theta1),
            twist * omega1**2 - friction2 + d * g / L1 * np.sin(theta2),
        ],
        axis=1,
    )
    return inverse, (inverse @ right[:, :, None])[:, :, 0]


@njit(parallel=True)
def _answer(into: Array, out: Array, at: Array, edges: NDArray[np.int64], steps: Array, torque: Array) -> Array:
    """The integral by trapezoids from each segment's start, read at the samples."""
    answer = np.empty((len(at), 2, torque.shape[2]))
    for k in numba.prange(torque.shape[2]):
        total = np.zeros((len(steps), 4))
        for s in range(len(edges) - 1):
            for i in range(edges[s], edges[s + 1] - 1):
                for j in range(4):
                    here = into[i, j, 0] * torque[i, 0, k] + into[i, j, 1] * torque[i, 1, k]
                    there = into[i + 1, j, 0] * torque[i + 1, 0, k] + into[i + 1, j, 1] * torque[i + 1, 1, k]
                    total[i + 1, j] = total[i, j] + 0.5 * steps[i] * (here + there)
        for n in range(len(at)):
            i = min(int(at[n]), len(steps) - 2)
            share = at[n] - i
            for axis in range(2):
                value = 0.0
                for j in range(4):
                    value += out[n, axis, j] * ((1.0 - share) * total[i, j] + share * total[i + 1, j])
                answer[n, axis, k] = value
    return answer
