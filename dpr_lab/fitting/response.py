"""Response of the readings to small torques along a trajectory, by variation of constants.

Let Phi(t) be the sensitivity of the state x to the initial state, and M the mass matrix. A torque tau changes the state
by

    dx(t) = Phi(t) integral Phi(s)^-1 [0; M(s)^-1 tau(s)] ds.

Each torque along the same trajectory therefore needs only one matrix product. The method is used for hundreds of
torques: maps over angle, speed and time, and scans of shape parameters (orders, frequencies).
"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.dynamics.arm import levers
from dpr_lab.dynamics.base import RATIOS, base_of_run
from dpr_lab.dynamics.equation import coupled
from dpr_lab.dynamics.moving_arm.followed import FOLLOW, FollowedSwing, followed_with_arm
from dpr_lab.dynamics.prediction import segment_start
from dpr_lab.dynamics.rig_constants import constants_of_run
from dpr_lab.dynamics.segments import Segments, segments
from dpr_lab.dynamics.trajectory import OF_ARM, TRAJECTORY_TORQUES, KnownMotion
from dpr_lab.effects.mounted import effects_of_run
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.effects.stages import StageName
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.rods import followed as follow
from dpr_lab.kernels import njit
from dpr_lab.setup import Setup


@dataclass(frozen=True, slots=True)
class TrajectorySettings:
    """Settings of the grid of a trajectory."""

    grid_s: float = 2.5e-3
    """Spacing of the grid, s; the trapezoidal rule then has an error of 1e-3."""
    coarse_s: float = 5e-3
    """Spacing of a coarser grid, s, for comparisons of torques and for values printed with two digits."""


TRAJECTORY = TrajectorySettings()


class _Grid(NamedTuple):
    """Fields of a `Trajectory` that compiled code needs."""

    t: Array
    into: Array
    out: Array
    at: Array
    edges: Integers
    first: Integers


@dataclass(frozen=True, slots=True)
class Trajectory:
    """Simulated motion of all segments on a fine time grid, with its response to torques."""

    motion: KnownMotion
    """Motion of the rods at n grid points."""
    bases: Array
    """(runs, 6) base parameters of the mounted parts, SI."""
    setups: tuple[Setup, ...]
    """Mounting of each run."""
    into: Array
    """(n, states, axes) Phi^-1 [0; M^-1]: change of the initial state that is equivalent to a unit impulse."""
    out: Array
    """(samples, axes, states) derivative of the encoder readings with respect to the initial state."""
    at: Array
    """(samples,) position of each sample on the grid, in grid points."""
    edges: Integers
    """(segments + 1,) index of the first grid point of each segment, then n."""
    first: Integers
    """(segments + 1,) index of the first sample of each segment, then the number of samples."""

    def response(self, problem: Problem, torque: Array) -> Array:
        """Return the (segments, m, k) whitened response to torques (n, 2, k), N m."""
        torque, count = np.ascontiguousarray(torque), torque.shape[2]
        changes = np.empty((len(self.first) - 1, int(np.diff(self.first).max()), problem.axes, count))
        grid = _Grid(self.motion.t, self.into, self.out, self.at, self.edges, self.first)
        sums, rows = np.empty((2, self.into.shape[1], count)), changes.reshape(len(changes), -1, count)
        integrate = _response_with_arm if problem.segments.arm_moves else _response
        integrate(grid, problem.weight, torque, sums, rows)
        return problem.decorrelated(changes)

    def torques(self, stage: StageName, constants: RigConstants, params: Array) -> Array:
        """Return the (n, 2, k) torques of effects (k, SIZE), N m, at one stage of `TRAJECTORY_TORQUES`.

        There is a third axis if the arm moves.
        """
        kinds = {setup: self.of_setup(setup) for setup in self.setups}
        if len(kinds) == 1:
            return self._torques(stage, constants, params, self.setups[0], slice(None))
        torques = np.empty((*self.motion.theta.shape, len(params)))
        for setup, mask in kinds.items():
            torques[mask] = self._torques(stage, constants, params, setup, mask)
        return torques

    def of_setup(self, setup: Setup) -> Flags:
        """Return the (n,) mask of the grid points in runs with a given setup."""
        return np.array([other == setup for other in self.setups])[self.motion.run]

    def _torques(
        self, stage: StageName, constants: RigConstants, params: Array, setup: Setup, mask: Flags | slice
    ) -> Array:
        axes = self.motion.theta.shape[1]
        if stage in OF_ARM and axes == 2:
            return np.zeros((*self.motion.theta[mask].shape, len(params)))  # a clamped arm
        motion = self.motion.part(mask, axes if stage in OF_ARM else 2)
        base, hanging = self.bases[self.setups.index(setup)], constants_of_run(constants, setup)
        torques = TRAJECTORY_TORQUES[stage](motion, base, hanging, effects_of_run(params, setup))
        missing = axes - torques.shape[1]
        return np.pad(torques, ((0, 0), (0, missing), (0, 0))) if missing else torques

    @property
    def joint_angle(self) -> Array:
        """(n, 2 or 3) angles of joints 1 and 2 from hanging, and theta0 if the arm moves, rad."""
        theta = self.motion.theta
        joints = [theta[:, 0] - np.pi, theta[:, 1] - theta[:, 0], *theta[:, 2:].T]
        return np.stack(joints, axis=1)

    @property
    def joint_speed(self) -> Array:
        """(n, 2 or 3) speeds of joints 1 and 2, and of the arm if it moves, rad/s."""
        omega = self.motion.omega
        return np.stack([omega[:, 0], omega[:, 1] - omega[:, 0], *omega[:, 2:].T], axis=1)


def trajectory(
    problem: Problem,
    estimate: Estimate,
    begins: Callable[[float], float] = segment_start,
    spacing: float = TRAJECTORY.grid_s,
) -> Trajectory:
    """Simulate the segments of a problem at an estimate, without effects.

    Args:
        problem: segments to simulate
        estimate: ratios and initial states
        begins: function from the instant of the first reading of a segment to the start of the segment, s
        spacing: maximum spacing of the grid, s
    """
    rig, samples = problem.model.constants, problem.segments.offsets
    spans = [(begins(float(problem.t[i])), float(problem.t[j - 1])) for i, j in pairwise(samples)]
    instants = [_grid(first, last, spacing) for first, last in spans]
    setups = problem.segments.setups
    grid = segments(instants, problem.segments.run, setups, step=TRAJECTORY.grid_s)
    bases = np.array([base_of_run(estimate.whole, setup, rig.L1, rig.g) for setup in setups])
    if grid.arm_moves:
        swing = followed_with_arm(bases, rig, grid, estimate.params, estimate.initial)
    else:
        swing = _followed(bases, rig, grid, estimate)
    edges = grid.offsets
    place = np.concatenate(
        [
            edges[s] + np.interp(problem.t[i:j], instants[s], np.arange(len(instants[s])))
            for s, (i, j) in enumerate(pairwise(samples))
        ]
    )
    lower = np.minimum(place.astype(np.int64), edges[problem.owner + 1] - 2)
    share = (place - lower)[:, None, None]
    phi, angles, speeds = swing.phi, swing.angles, swing.speeds
    out = (1 - share) * phi[lower][:, angles] + share * phi[lower + 1][:, angles]
    out[:, 1] -= problem.model.constants.relative2 * out[:, 0]
    torque_only = np.zeros((len(phi), len(phi[0]), len(speeds)))
    torque_only[:, speeds] = swing.inverse
    return Trajectory(
        motion=KnownMotion(
            t=grid.t,
            run=np.repeat(grid.run, np.diff(edges)),
            theta=swing.states[:, angles],
            omega=swing.states[:, speeds],
            alpha=swing.alpha,
            drive=swing.drive,
        ),
        bases=bases,
        setups=setups,
        into=np.asarray(np.linalg.solve(phi, torque_only), dtype=np.float64),
        out=out,
        at=place,
        edges=edges,
        first=samples,
    )


def _followed(bases: Array, rig: RigConstants, grid: Segments, estimate: Estimate) -> FollowedSwing:
    """Simulate two rods on an arm that is clamped or has a prescribed motion."""
    states, slopes = follow(estimate.ratios, grid, estimate.initial, rig, outputs=4)
    phi = slopes[:, :, len(RATIOS) :]
    lost = ~(np.isfinite(phi).all(axis=(1, 2)) & (np.abs(states) < FOLLOW.wildest).all(axis=1))
    phi[lost], states[lost] = np.eye(4), 0.0
    lost |= np.abs(np.linalg.det(phi)) < FOLLOW.singular
    owner = np.repeat(np.arange(len(grid)), np.diff(grid.offsets))
    bases_of_run, pushes = bases[grid.run][owner], grid.pushes
    drive = pushes[:, :2] + (
        _prescribed_torques(bases_of_run, rig, states, pushes[:, 2:]) if pushes[:, 2:].any() else 0.0
    )
    inverse, alpha = _accelerations(bases_of_run, grid.held[owner], rig.L1, rig.g, states, drive)
    phi[lost], inverse[lost] = np.eye(4), 0.0  # the response is zero for a swing that cannot be simulated
    return FollowedSwing(states, phi, inverse, alpha, pushes[:, :2], [0, 1], [2, 3])


def _grid(first: float, last: float, spacing: float) -> Array:
    return np.linspace(first, last, max(1, int(np.ceil((last - first) / spacing))) + 1)


def _prescribed_torques(bases: Array, rig: RigConstants, states: Array, arm: Array) -> Array:
    """Return the (n, 2) torques of a prescribed arm motion on theta1 and theta2, N m.

    `arm` (n, 2) contains the acceleration and the squared speed of the arm. The equation is (54) of docs/theory.md.
    """
    (a, b, d, e1, *_), (alpha0, squared) = bases.T, arm.T
    (sin1, sin2), (cos1, cos2) = np.sin(states[:, :2].T), np.cos(states[:, :2].T)
    pull, (lever1, lever2) = rig.L0 / rig.g * alpha0, levers(sin1, cos1, sin2, cos2, a, b, d)
    return np.stack([squared * lever1 - pull * e1 * cos1, squared * lever2 - pull * d * rig.g / rig.L1 * cos2], axis=1)


def _accelerations(bases: Array, held: Flags, L1: float, g: float, states: Array, drive: Array) -> tuple[Array, Array]:
    """Return inverse mass matrices (n, 2, 2) and accelerations (n, 2) of equation (1).

    If `held` is true, joint 2 is fixed.
    """
    a, b, d, e1, c1, c2 = bases.T
    (sin1, sin2), (cos1, cos2), (omega1, omega2) = np.sin(states[:, :2].T), np.cos(states[:, :2].T), states[:, 2:].T
    coupling, *torques = coupled(sin1, cos1, sin2, cos2, omega1, omega2, d, e1, d * g / L1, c1, c2)
    inverse = np.stack([np.stack([b, -coupling]), np.stack([-coupling, a])])
    inverse = np.moveaxis(inverse / (a * b - coupling**2), -1, 0)
    inverse[held] = (1 / (a + b + 2 * coupling))[held, None, None]
    return inverse, (inverse @ (np.stack(torques, axis=1) + drive)[:, :, None])[:, :, 0]


@njit(allocates=False)
def _response(grid: _Grid, weight: Array, torque: Array, sums: Array, response: Array) -> None:
    """Integrate the response by the trapezoidal rule, and weight it at the samples.

    The integration begins at the start of each segment. This function is `_response_with_arm` for the four states of
    two rods, unrolled, because a diagnosis integrates thousands of torques. The inner loop runs over torques. The
    result is written to `response`, (segments, m, k), where short segments end in zeros; `sums` (2, 4, k) is a work
    array.
    """
    t, into, out, positions, edges, first = grid
    count, before, total = torque.shape[2], sums[0], sums[1]
    for s in range(len(first) - 1):
        n = first[s]
        for j in range(4):
            for k in range(count):
                total[j, k] = 0.0
        for i in range(edges[s] + 1, edges[s + 1]):
            half = 0.5 * (t[i] - t[i - 1])
            for j in range(4):
                a1, a2 = half * into[i - 1, j, 0], half * into[i - 1, j, 1]
                b1, b2 = half * into[i, j, 0], half * into[i, j, 1]
                for k in range(count):
                    x = total[j, k]
                    before[j, k] = x
                    total[j, k] = (
                        x
                        + (a1 * torque[i - 1, 0, k] + a2 * torque[i - 1, 1, k])
                        + (b1 * torque[i, 0, k] + b2 * torque[i, 1, k])
                    )
            while n < first[s + 1] and (positions[n] < i or i == edges[s + 1] - 1):
                share = positions[n] - (i - 1)
                for axis in range(2):
                    u, v = weight[n, axis] * (1.0 - share), weight[n, axis] * share
                    o0, o1, o2, o3 = out[n, axis, 0], out[n, axis, 1], out[n, axis, 2], out[n, axis, 3]
                    u0, u1, u2, u3 = u * o0, u * o1, u * o2, u * o3
                    v0, v1, v2, v3 = v * o0, v * o1, v * o2, v * o3
                    row = 2 * (n - first[s]) + axis
                    for k in range(count):
                        response[s, row, k] = (
                            u0 * before[0, k] + u1 * before[1, k] + u2 * before[2, k] + u3 * before[3, k]
                        ) + (v0 * total[0, k] + v1 * total[1, k] + v2 * total[2, k] + v3 * total[3, k])
                n += 1
        for row in range(2 * (first[s + 1] - first[s]), response.shape[1]):
            for k in range(count):
                response[s, row, k] = 0.0


@njit(allocates=False)
def _response_with_arm(grid: _Grid, weight: Array, torque: Array, sums: Array, response: Array) -> None:
    """Compute `_response` for any number of states and axes.

    The work array `sums` has the shape (2, states, k).
    """
    t, into, out, positions, edges, first = grid
    states, axes, count, before, total = into.shape[1], into.shape[2], torque.shape[2], sums[0], sums[1]
    for s in range(len(first) - 1):
        n = first[s]
        total[:] = 0.0
        for i in range(edges[s] + 1, edges[s + 1]):
            half = 0.5 * (t[i] - t[i - 1])
            for j in range(states):
                for k in range(count):
                    before[j, k] = total[j, k]
                for axis in range(axes):
                    a, b = half * into[i - 1, j, axis], half * into[i, j, axis]
                    for k in range(count):
                        total[j, k] += a * torque[i - 1, axis, k] + b * torque[i, axis, k]
            while n < first[s + 1] and (positions[n] < i or i == edges[s + 1] - 1):
                share = positions[n] - (i - 1)
                for axis in range(axes):
                    u, v = weight[n, axis] * (1.0 - share), weight[n, axis] * share
                    row = axes * (n - first[s]) + axis
                    for k in range(count):
                        response[s, row, k] = 0.0
                    for j in range(states):
                        for k in range(count):
                            response[s, row, k] += out[n, axis, j] * (u * before[j, k] + v * total[j, k])
                n += 1
        for row in range(axes * (first[s + 1] - first[s]), response.shape[1]):
            for k in range(count):
                response[s, row, k] = 0.0
