"""Friction torque of a joint as a function of its speed, with its uncertainty.

The friction torque at the joint speed u is the sum of the viscous torque and of the torques of the named friction laws,

    T(u) = c u + sum over laws of tau_law(u).

A free-form friction curve is added to the corrected model, so that T may have any shape. The amplitudes of the curve
are hardly distinguishable from each other and from c, but T(u) depends only on their sum. The linear estimate of T(u)
has the variance g(u)^T C g(u), where C is the covariance of all fitted values and g(u) the derivative of T(u) with
respect to these values.

If the model contains a constant torque, such as that of a spring, a difference of the friction between the two
directions is indistinguishable from this torque. The curve is then equal in both directions.

Joint 0 is the joint of an arm that is free or driven. The back-EMF of a voltage drive adds ke kt gear^2 / R to the
viscous coefficient c of this joint. No recording separates the back-EMF from c.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.trajectory import KnownMotion, arm_effects_along, effect_torques_along
from dpr_lab.effects import SLICES, param_index
from dpr_lab.effects.coulomb import COULOMB, COULOMB_JOINT0
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.effects.friction_curve import FRICTION_CURVE, FRICTION_CURVE_JOINT0
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.effects.stribeck import STRIBECK, STRIBECK_JOINT0
from dpr_lab.fitting.estimate import (
    EFFECTS_BEGIN,
    FRICTION,
    SCALE,
    ZEROS_BEGIN,
    Estimate,
    FreeParameter,
    effect_parameters,
)
from dpr_lab.fitting.linearise import linearise
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import TINY, ColumnSpace
from dpr_lab.fitting.response import TRAJECTORY, Trajectory, trajectory
from dpr_lab.gap.hypothesis.detectable import SEEN
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.result.evidence import JointFriction

FRICTION_CURVES = (FRICTION_CURVE_JOINT0, *FRICTION_CURVE)
"""Free-form friction curves of joints 0, 1 and 2."""

LAWS = ((COULOMB_JOINT0, *COULOMB), (STRIBECK_JOINT0, *STRIBECK), FRICTION_CURVES)
"""Friction laws that depend only on the speed of the joint, each for joints 0, 1 and 2."""


BY_DIRECTION = ("forward_Nm", "backward_Nm")
"""Amplitudes of the friction curve at rest, one for each direction."""


@dataclass(frozen=True, slots=True)
class SpeedGrid:
    """Grid of speeds for which the friction torque is computed."""

    count: int = 24
    """Number of speeds in each direction."""
    slowest: float = 0.02
    """Smallest absolute speed, rad/s."""

    def up_to(self, speed: float) -> Array:
        """Return the speeds in both directions, ascending, rad/s."""
        positive = np.geomspace(self.slowest, speed, self.count)
        return np.concatenate([-positive[::-1], positive])


GRID = SpeedGrid()


def laws_of(joint: int) -> tuple[str, ...]:
    """Return the names of the friction laws of joint 0, 1 or 2."""
    return tuple(law[joint].name for law in LAWS)


def joint_friction(problem: Problem, model: Hypothesis, *, back_emf: bool) -> dict[str, JointFriction]:
    """Return the friction torque of `joint1`, `joint2` and, for a moving arm, `joint0`.

    The curve of a joint ends at the largest speed that the joint reaches in both directions. A joint that hardly moves
    is left out.
    """
    fit = model.fit
    reached = _reached(trajectory(problem, fit.estimate, spacing=TRAJECTORY.coarse_s))
    added = {joint: _curve(joint, fit.free) for joint, speed in reached.items() if speed > GRID.slowest}
    columns = (*fit.free, *(column for curve in added.values() for column in curve))
    A, e = linearise(problem, fit.estimate, columns).flat
    friction: dict[str, JointFriction] = {}
    for joint, curve in added.items():
        chosen = [i for i, column in enumerate(columns) if i < len(fit.free) or column in curve]
        free = [columns[i] for i in chosen]
        speeds = GRID.up_to(reached[joint])
        torque, slope = linear_torque(joint, speeds, fit.estimate, free, problem.model.constants)
        basis = curve_basis(A[:, chosen].T @ A[:, chosen], free, curve)
        of_joint, slope = ColumnSpace.of(A[:, chosen] @ basis, e), slope @ basis
        variance = model.inflation * np.einsum("ui,ij,uj->u", slope, of_joint.covariance(), slope)
        friction[f"joint{joint}"] = JointFriction(
            speed_rad_per_s=speeds.tolist(),
            torque_Nm=(torque + slope @ of_joint.solution()).tolist(),
            std_Nm=np.sqrt(variance).tolist(),
            coefficients=int(np.count_nonzero(slope.any(axis=0))),
            back_emf=back_emf and joint == 0,
        )
    return friction


def curve_basis(H: Array, free: Sequence[FreeParameter], curve: Sequence[FreeParameter]) -> Array:
    """Return a (k, m) basis of the fitted values in which all coordinates are determined.

    If the other values absorb the difference between the curves of the two directions, the basis omits this difference.
    Otherwise it is the unit matrix.

    Args:
        H: (k, k) normal matrix of the fitted values
        free: the k fitted values
        curve: amplitudes of the friction curve among them that are not part of the model
    """
    basis = np.eye(len(free))
    ends = [i for i, column in enumerate(free) if column in curve and column.name in BY_DIRECTION]
    if len(ends) == len(BY_DIRECTION):
        forward, backward = ends
        basis[backward, forward], basis[forward, backward] = 1.0, -1.0  # their sum and their difference
        G = basis.T @ H @ basis
        scale = 1 / np.sqrt(np.maximum(np.diag(G), TINY))
        space = ColumnSpace(scale, G * scale[:, None] * scale, np.zeros(len(G)))
        remaining = scale[backward] ** 2 / space.covariance()[backward, backward]
        return np.delete(basis, backward, axis=1) if remaining < SEEN else np.eye(len(free))
    return basis


def _reached(swings: Trajectory) -> dict[int, float]:
    """Return the largest speed that each joint reaches in both directions, rad/s.

    Joint 0 is included only if the arm moves.
    """
    speeds = swings.joint_speed.copy()
    alone = np.array([setup.alone for setup in swings.setups])[swings.motion.run]
    speeds[alone, 1] = 0.0
    return {joint: float(min(u.max(), -u.min())) for joint, u in zip((1, 2, 0), speeds.T, strict=False)}


def _curve(joint: int, free: Sequence[FreeParameter]) -> list[FreeParameter]:
    """Return the amplitudes of the friction curve of a joint that are not part of the model."""
    fitted = {column.place for column in free}
    every = effect_parameters(FRICTION_CURVES[joint])
    return [column for column in every if column.place not in fitted]


def linear_torque(
    joint: int, speeds: Array, estimate: Estimate, free: Sequence[FreeParameter], constants: RigConstants
) -> tuple[Array, Array]:
    """Return the (speeds,) friction torque of a joint, N m, and its (speeds, free) derivatives.

    The derivatives are those with respect to the fitted parameters.
    """
    vectors = np.tile(estimate.vector, (len(free) + 1, 1))
    steps = np.array([column.step for column in free])
    vectors[range(1, len(vectors)), [column.place for column in free]] += steps
    torques = _torques(joint, speeds, vectors, estimate.base, constants)
    return torques[:, 0], (torques[:, 1:] - torques[:, :1]) / steps


def _torques(joint: int, speeds: Array, vectors: Array, base: Array, constants: RigConstants) -> Array:
    """Return the (speeds, vectors) friction torque of a joint, N m.

    Each row of `vectors`, (vectors, n), contains all parameters of a model, as in `Estimate.vector`.
    """
    n, axes, axis = len(speeds), 2 if joint else 3, joint - 1  # the arm is the last axis
    zero, omega = np.zeros((n, axes)), np.zeros((n, axes))
    hanging = zero + [np.pi, np.pi, 0.0][:axes]
    omega[:, axis:] = speeds[:, None]
    motion = KnownMotion(np.ones(n), np.zeros(n, dtype=np.int64), hanging, omega, zero, zero)
    params = np.zeros_like(vectors[:, EFFECTS_BEGIN:ZEROS_BEGIN])
    for law in laws_of(joint):
        params[:, SLICES[law]] = vectors[:, EFFECTS_BEGIN:ZEROS_BEGIN][:, SLICES[law]]
    along = effect_torques_along if joint else arm_effects_along
    dry = along(motion, base, constants, params)[:, axis]
    of_arm = EFFECTS_BEGIN + param_index(FREE_ARM.name, "viscous_Nms")
    viscous = vectors[:, FRICTION[axis]] * vectors[:, SCALE] if joint else vectors[:, of_arm]
    return speeds[:, None] * viscous - dry
