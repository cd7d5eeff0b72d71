"""Torques of effects along a given trajectory, without their effect on the motion."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.dynamics.arm import with_gravity
from dpr_lab.dynamics.dry_friction import direction_of
from dpr_lab.dynamics.lanes.effects import add_drives, add_torques
from dpr_lab.dynamics.lanes.workspace import LANES, LaneWorkspace, lane_workspace
from dpr_lab.dynamics.step import motion_of, with_arm
from dpr_lab.effects.effect_kernels import (
    AT_RELEASE,
    EFFECT_OF,
    STEPPED,
    active_effects,
    arm_drives,
    arm_model,
    arm_torques,
    whole_torques,
)
from dpr_lab.effects.elementary import sincos
from dpr_lab.effects.quantities import HELD_ARM, BaseParameters, RigConstants
from dpr_lab.effects.stages import StageName
from dpr_lab.kernels import njit, subroutine

_AT_RELEASE = tuple(AT_RELEASE[list(STEPPED)])


class KnownMotion(NamedTuple):
    """Motion along a trajectory; the axes are theta1, theta2 and optionally theta0."""

    t: Array
    """(n,) time since the release, s."""
    run: Integers
    """(n,) index of the run."""
    theta: Array
    """(n, axes) absolute angles, rad."""
    omega: Array
    """(n, axes) angular speeds, rad/s."""
    alpha: Array
    """(n, axes) accelerations, rad/s^2."""
    drive: Array
    """(n, axes) known generalised forces of the absolute angles, N m."""

    def part(self, mask: Flags | slice, axes: int) -> "KnownMotion":
        """Return the motion of the first `axes` axes at the times that `mask` selects."""
        by_axis = (values[mask][:, :axes] for values in (self.theta, self.omega, self.alpha, self.drive))
        return KnownMotion(self.t[mask], self.run[mask], *by_axis)


def effect_torques_along(motion: KnownMotion, base: Array, constants: RigConstants, params: Array) -> Array:
    """Compute the torques of effects on the rods along a trajectory.

    Internal states stay as they are at the release.

    Args:
        motion: motion of the rods
        base: (6,) base parameters, SI
        constants: constants of the rig
        params: (k, SIZE) k vectors of effects

    Returns:
        (n, 2, k) generalised torques on theta1, theta2, N m
    """
    named = with_gravity(base, constants.L1, constants.g)
    params, rig = _c(params), RigConstants(*map(float, constants))
    active = active_effects(params)
    used = np.flatnonzero(np.logical_or.reduce(active, axis=0)[EFFECT_OF])
    torques = np.empty((len(motion.t), 2, len(params)))
    swing = _c(motion.t), _c(motion.theta), _c(motion.omega), _c(motion.drive)
    _effect_torques(*swing, named, rig, params, active, used, lane_workspace(), torques)
    return torques


def arm_torques_along(motion: KnownMotion, base: Array, constants: RigConstants, params: Array) -> Array:
    """Compute the torques of a slightly compliant arm on the rods.

    See `effect_torques_along` for arguments and result. The rods drive the arm, A alpha0 + c0 omega0 + k0 theta0 = F,
    and its acceleration acts on the rods:

        F = r sum_i e_i (sin(theta_i) omega_i^2 - cos(theta_i) alpha_i),    tau_i = -r e_i cos(theta_i) alpha0,

    where r = L0 / g, and A, c0 and k0 are the inertia, friction and stiffness of the arm. The torques are those of
    `dpr_lab.dynamics.arm` to first order in 1 / A. The arm is held until the release.
    """
    named = with_gravity(base, constants.L1, constants.g)
    levers = constants.L0 / constants.g * np.array([named.e1, named.e2])
    sine, cosine = np.sin(motion.theta), np.cos(motion.theta)
    force = (sine * motion.omega**2 - cosine * motion.alpha) @ levers
    arms = [arm_model(constants, HELD_ARM, row, active_effects(row)) for row in _c(params)]
    inertia, _, friction, stiffness = np.array(arms).T
    swing = _driven(_c(motion.t), np.array(motion.run), force, friction / inertia, stiffness / inertia) / inertia
    return -(cosine * levers)[:, :, None] * swing[:, None, :]


@njit(allocates=False)
def _effect_torques(
    t: Array,
    theta: Array,
    omega: Array,
    drive: Array,
    base: BaseParameters,
    rig: RigConstants,
    params: Array,
    active: Flags,
    used: Integers,
    w: LaneWorkspace,
    torques: Array,
) -> None:
    """Write the torques of each effect vector to `torques`; each lane contains one instant.

    `used` lists the indices of the parameters of active effects.
    """
    for first in range(0, len(t), LANES):
        for k in range(LANES):
            i = min(first + k, len(t) - 1)
            _put(w, k, t[i], theta[i, 0], theta[i, 1], omega[i, 0], omega[i, 1], base, rig)
            w.drive1[k], w.drive2[k] = drive[i, 0], drive[i, 1]
        for c in range(len(params)):
            for place in used:
                for k in range(LANES):
                    w.params[place, k] = params[c, place]
            _exert(w, rig, active[c])
            for k in range(min(LANES, len(t) - first)):
                torques[first + k, 0, c], torques[first + k, 1, c] = w.torque1[k], w.torque2[k]


@subroutine
def _exert(w: LaneWorkspace, rig: RigConstants, active: Flags) -> None:
    """Compute the torques of one effect vector on the rods in all lanes."""
    for k in range(LANES):
        w.torque1[k], w.torque2[k] = 0.0, 0.0
    add_torques(w, rig, active)
    add_drives(w, active)


@subroutine
def _put(
    w: LaneWorkspace,
    k: int,
    t: float,
    theta1: float,
    theta2: float,
    omega1: float,
    omega2: float,
    base: BaseParameters,
    rig: RigConstants,
) -> None:
    """Load the state of the rods at time t into lane k; the arm is held."""
    w.a[k], w.b[k], w.d[k], w.e1[k], w.e2[k] = base.a, base.b, base.d, base.e1, base.e2
    w.L1[k], w.L2[k], w.stage_t[k] = rig.L1, rig.L2, t
    w.m1[k], w.m2[k], w.mb[k] = rig.m1, rig.m2, rig.mb
    w.stage_theta1[k], w.stage_theta2[k] = theta1, theta2
    w.stage_omega1[k], w.stage_omega2[k] = omega1, omega2
    w.direction1[k], w.direction2[k] = direction_of(omega1), direction_of(omega2 - omega1)
    w.sin1[k], w.cos1[k] = sincos(theta1)
    w.sin2[k], w.cos2[k] = sincos(theta2)


@njit
def _driven(t: Array, run: Integers, force: Array, friction: Array, stiffness: Array) -> Array:
    """Return the (n, k) accelerations of k damped oscillators of unit mass that a force (n,) drives.

    The trapezoidal rule is used. The oscillators are at rest until t = 0.
    """
    count = len(stiffness)
    accelerations, x, v = np.zeros((len(t), count)), np.empty(count), np.empty(count)
    for i in range(len(t)):
        if t[i] < 0.0:
            continue
        h, previous = 0.0, i
        if i == 0 or run[i] != run[i - 1] or t[i - 1] < 0.0:
            x[:], v[:] = 0.0, 0.0
        else:
            h, previous = max(t[i] - t[i - 1], 0.0), i - 1
        half, quarter = 0.5 * h, 0.25 * h * h
        for k in range(count):
            before = accelerations[previous, k]
            ahead, onward = x[k] + h * v[k] + quarter * before, v[k] + half * before
            now = (force[i] - friction[k] * onward - stiffness[k] * ahead) / (
                1.0 + half * friction[k] + quarter * stiffness[k]
            )
            x[k], v[k] = ahead + quarter * now, onward + half * now
            accelerations[i, k] = now
    return accelerations


def _c(values: Array) -> Array:
    """Convert an array to the type and memory layout of the compiled kernels."""
    return np.array(values, dtype=np.float64, order="C")


def arm_effects_along(motion: KnownMotion, base: Array, constants: RigConstants, params: Array) -> Array:
    """Compute the torques of effects at a free or driven arm.

    Arguments are those of `effect_torques_along`; the motion contains theta0 as third axis.

    Returns:
        (n, 3, k) generalised torques on theta1, theta2, theta0, N m
    """
    named, rig = with_gravity(base, constants.L1, constants.g), RigConstants(*map(float, constants))
    params, torques = _c(params), np.zeros((len(motion.t), 3, len(params)))
    swing = _c(motion.t), _c(motion.theta), _c(motion.omega), _c(motion.drive)
    _arm_effects(*swing, named, rig, params, active_effects(params), torques)
    return torques


@njit
def _arm_effects(
    t: Array,
    theta: Array,
    omega: Array,
    drive: Array,
    base: BaseParameters,
    rig: RigConstants,
    params: Array,
    active: Flags,
    torques: Array,
) -> None:
    for i in range(len(t)):
        thetas, omegas = (theta[i, 2], theta[i, 0], theta[i, 1]), (omega[i, 2], omega[i, 0], omega[i, 1])
        motion = motion_of(t[i], thetas, omegas, (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
        motion = with_arm(motion, 0.0, direction_of(omega[i, 2]))
        for c in range(len(params)):
            torque0 = arm_drives(motion, drive[i, 2], params[c], active[c]) - drive[i, 2]
            torque0 = arm_torques(motion, torque0, _AT_RELEASE, params[c], active[c])
            torques[i, 2, c], torques[i, 0, c], torques[i, 1, c] = whole_torques(
                motion, base, rig, torque0, params[c], active[c]
            )


TrajectoryTorques = Callable[[KnownMotion, Array, RigConstants, Array], Array]

TRAJECTORY_TORQUES: Mapping[StageName, TrajectoryTorques] = {
    "torque": effect_torques_along,
    "drive": effect_torques_along,
    "arm": arm_torques_along,
    "torque0": arm_effects_along,
    "drive0": arm_effects_along,
    "whole0": arm_effects_along,
}
"""Functions that compute the torques of effects along a trajectory, by the stage of the effect."""

OF_ARM: tuple[StageName, ...] = ("torque0", "drive0", "whole0")
"""Stages whose torques also depend on the motion of the arm."""
