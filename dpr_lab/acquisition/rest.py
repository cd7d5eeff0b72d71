"""Residual motion of the held rods, and their distance from a pose."""

import numpy as np

from dpr_lab.acquisition.settings import RestLimits
from dpr_lab.arrays import Array, without_turns
from dpr_lab.rig import Rig
from dpr_lab.rig_tables import Pose

RodAngles = tuple[float, float, float]
"""Absolute angles of arm, inner and outer rod, rad."""

RodPair = tuple[float, float]
"""One value for the inner and one for the outer rod."""


def rest_motion(t: Array, theta: Array) -> tuple[float, float]:
    """Return the residual motion of held rods.

    Args:
        t: (n,) time, s
        theta: (n, 3) angles, rad

    Returns:
        Largest drift of a rod (slope of a fitted straight line), rad/s, and largest scatter about this line (rms), rad.
    """
    time = t - t.mean()
    rods = theta[:, 1:] - theta[:, 1:].mean(axis=0)
    slope = time @ rods / max(float(time @ time), np.finfo(float).tiny)
    spread = np.sqrt(np.mean((rods - np.outer(time, slope)) ** 2, axis=0))
    return float(np.abs(slope).max()), float(spread.max())


def at_rest(t: Array, theta: Array, rig: Rig, limits: RestLimits) -> bool:
    """Return whether the rods are at rest; see `rest_motion` for the arguments."""
    speed, spread = rest_motion(t, theta)
    return speed <= limits.speed and spread <= limits.spread(rig)


def arm_restless(t: Array, theta: Array, rig: Rig, limits: RestLimits) -> str:
    """Return the reason why a movable arm forbids a release.

    The text is empty if the arm permits the release. See `rest_motion` for the arguments.
    """
    if rig.arm.mode == "clamped":
        return ""
    speed, _ = rest_motion(t, theta[:, [0, 0, 0]])
    if speed > limits.speed:
        return f"the arm still moved: drifting {speed:.3f} rad/s (limit {limits.speed} rad/s)"
    low, high = rig.arm.limits or (-np.inf, np.inf)
    theta0 = float(theta[-1, 0])
    if not low <= theta0 <= high:
        return f"the arm stands at {theta0:.3f} rad, outside its limits of {low:g} to {high:g} rad ([arm] limits)"
    return ""


def pose_error(theta: Array, pose: Pose) -> Array:
    """Return the angles of the rods relative to a pose, without whole turns.

    Args:
        theta: (..., 3) absolute angles, rad
        pose: the requested pose

    Returns:
        (..., 2) measured minus required angle of inner and outer rod in [-pi, pi), rad
    """
    return without_turns(theta[..., 1:] - pose.theta[1:])


def elbow_error(theta: Array, pose: Pose) -> float:
    """Return the deviation of theta2 - theta1 from a pose, in [-pi, pi), rad.

    `theta` contains (3,) absolute angles.
    """
    inner, outer = pose_error(theta, pose)
    return float(without_turns(outer - inner))
