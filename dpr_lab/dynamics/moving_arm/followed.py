"""Simulation of swings with a moving arm, with their sensitivity to the initial states."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.dynamics.arm import CLAMPED, FREE
from dpr_lab.dynamics.moving_arm.swing import arm_segments, swing_segments
from dpr_lab.dynamics.segments import Segments
from dpr_lab.effects import param_index
from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.setup import Torques


@dataclass(frozen=True, slots=True)
class FollowedSwing:
    """Simulated segments on a time grid, with the quantities that `dpr_lab.fitting.response` needs.

    The axes are theta1, theta2, theta0.
    """

    states: Array
    """(n, states) theta1, theta2, omega1, omega2, and theta0, omega0 of a moving arm, rad and rad/s."""
    phi: Array
    """(n, states, states) derivative of the states with respect to the initial state of their segment."""
    inverse: Array
    """(n, axes, axes) inverse mass matrix, 1/(kg m^2)."""
    alpha: Array
    """(n, axes) angular accelerations, rad/s^2."""
    drive: Array
    """(n, axes) known torques, N m; the torque of the arm includes the fitted gain of its drive."""
    angles: list[int]
    """Columns of the angles among the states, in the order of the axes."""
    speeds: list[int]
    """Columns of the speeds among the states, in the order of the axes."""


_INERTIA, _VISCOUS, _EXCESS = (
    param_index(effect.name, parameter.name) for effect in (FREE_ARM, DRIVE_GAIN) for parameter in effect.amplitudes
)


@dataclass(frozen=True, slots=True)
class FollowSettings:
    """Increments for the derivatives of simulated swings, and limits beyond which a simulation has failed."""

    step: float = 1e-5
    """Increment of each component of an initial state for forward differences, rad and rad/s."""
    wildest: float = 1e6
    """Largest absolute angle, rad, or speed, rad/s, of a valid simulation."""
    singular: float = 1e-9
    """Minimum determinant of a sensitivity; below it torques and initial states are indistinguishable."""
    order: tuple[int, ...] = (4, 0, 1, 5, 2, 3)
    """Columns of theta0, theta1, theta2, omega0, omega1, omega2 among the states."""
    weightless: float = 1e-6
    """Inertia of a missing rod relative to that of the mounted rod."""


FOLLOW = FollowSettings()


def followed_with_arm(bases: Array, rig: RigConstants, grid: Segments, params: Array, initial: Array) -> FollowedSwing:
    """Simulate swings of rods and arm, with the drive gain but no other effects.

    Args:
        bases: (runs, 6) base parameters of the mounted rods, SI; all runs have the same rods
        rig: constants of the rig
        grid: segments of grid times
        params: (SIZE,) effects; only the arm and the gain of its drive are used
        initial: (segments, 6) initial states
    """
    a, b, d, e1, c1, c2 = bases[0]
    alone = grid.setups[0].alone
    if alone:  # the two equal halves of a single rod: one rod, and another one without mass
        a, b, d = 2.0 * a, FOLLOW.weightless * a, 0.0
    inertia, viscous, gain = params[_INERTIA], params[_VISCOUS], 1.0 + params[_EXCESS]
    modes = [FREE if setup.arm_moves else CLAMPED for setup in grid.setups]
    t = [grid.t[i:j] for i, j in pairwise(grid.offsets)]
    torque = [_mean_torque(instants, grid.setups[run].torques) for instants, run in zip(t, grid.run, strict=True)]
    pieces = arm_segments(t, [modes[run] for run in grid.run], torque)
    p = [a, b, d, e1, c1, c2, inertia, viscous, 0.0, 0.0, gain, rig.L0]
    rows = [swing_segments(p, (rig.L1, rig.g), pieces, (initial + shift)[:, FOLLOW.order]) for shift in _shifts()]
    back = np.argsort(FOLLOW.order)
    states = rows[0][:, back]
    phi = np.stack([(row[:, back] - states) / FOLLOW.step for row in rows[1:]], axis=2)
    lost = ~(np.isfinite(phi).all(axis=(1, 2)) & (np.abs(states) < FOLLOW.wildest).all(axis=1))
    phi[lost], states[lost] = np.eye(6), 0.0
    lost |= np.abs(np.linalg.det(phi)) < FOLLOW.singular
    moves = np.array([setup.arm_moves for setup in grid.setups])[grid.run]
    owner = np.repeat(np.arange(len(grid)), np.diff(grid.offsets))
    M = _mass_matrices(states, (a, b, d, e1, inertia), rig, moves[owner])
    inverse = np.asarray(np.linalg.inv(M), dtype=np.float64)
    inverse[~moves[owner], 2] = 0.0
    if alone:
        inverse[:, 1] = inverse[:, :, 1] = 0.0
    phi[lost], inverse[lost] = np.eye(6), 0.0
    speeds = [2, 3, 5]
    alpha = np.concatenate([np.gradient(states[i:j, speeds], grid.t[i:j], axis=0) for i, j in pairwise(grid.offsets)])
    drive = np.zeros((len(states), 3))
    drive[:, 2] = gain * np.concatenate(torque)
    return FollowedSwing(states, phi, inverse, alpha, drive, [0, 1, 4], speeds)


def _shifts() -> Array:
    """Return the (7, 6) increments of an initial state: zero, then one for each component."""
    return np.concatenate([np.zeros((1, 6)), FOLLOW.step * np.eye(6)])


def _mean_torque(t: Array, torques: Torques | None) -> Array:
    """Return the (n,) mean torque on the arm from each instant to the next, N m."""
    if torques is None or torques.on_arm is None:
        return np.zeros(len(t))
    until = np.interp(t, *torques.arm_knots)
    mean = np.diff(until) / np.diff(t)
    return np.append(mean, mean[-1:])


def _mass_matrices(
    states: Array, model: tuple[float, float, float, float, float], rig: RigConstants, moves: Flags
) -> Array:
    """Return the (n, 3, 3) mass matrices of theta1, theta2, theta0 (`dpr_lab.dynamics.arm`).

    A clamped arm has no coupling with the rods.
    """
    a, b, d, e1, inertia = model
    (sin1, sin2), (cos1, cos2) = np.sin(states[:, :2].T), np.cos(states[:, :2].T)
    M = np.zeros((len(states), 3, 3))
    M[:, 0, 0], M[:, 1, 1] = a, b
    M[:, 0, 1] = M[:, 1, 0] = d * np.cos(states[:, 0] - states[:, 1])
    reach = np.where(moves, rig.L0 / rig.g, 0.0)
    M[:, 0, 2] = M[:, 2, 0] = reach * e1 * cos1
    M[:, 1, 2] = M[:, 2, 1] = reach * d * rig.g / rig.L1 * cos2
    M[:, 2, 2] = inertia + a * sin1**2 + b * sin2**2 + 2.0 * d * sin1 * sin2
    return M
