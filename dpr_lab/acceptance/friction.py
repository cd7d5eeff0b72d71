"""Interval of the largest friction torque of a joint, and the speeds at which the torque is inaccurate."""

import numpy as np

from dpr_lab.acceptance.limits import FrictionLimit
from dpr_lab.arrays import Array
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.gap.result.evidence import JointFriction

KNOWN_BETTER = 3.0
"""Ratio of two standard deviations of a friction torque above which the smaller one counts as accurate."""


def largest_friction(curve: JointFriction, limit: FrictionLimit, confidence: float) -> tuple[float, float]:
    """Return the interval of the largest friction torque at speeds up to that of the limit, N m.

    The lower end is that of a simultaneous band with the given confidence, the upper end is that of the 90 % intervals.
    """
    from scipy.special import chdtri  # slow to import, and every diagnosis imports this module

    _, size, std = _up_to(curve, limit)
    simultaneous = float(np.sqrt(chdtri(curve.coefficients, 1.0 - confidence)))
    lower, upper = (size - simultaneous * std).max(), (size + NORMAL_Q90 * std).max()
    return max(0.0, float(lower)), float(upper)


def inaccurate_speeds(curve: JointFriction, limit: FrictionLimit) -> str:
    """Describe the speeds at which an inaccurate torque may exceed the limit, and the cause.

    The text is empty if the torque is about equally accurate at all speeds.
    """
    speed, size, std = _up_to(curve, limit)
    may_exceed, best = size + NORMAL_Q90 * std >= limit.max, int(np.argmin(std))
    if not may_exceed.any() or (worst := std[may_exceed].max()) < KNOWN_BETTER * std[best]:
        return ""
    slowest, fastest = speed[may_exceed].min(), speed[may_exceed].max()
    cause = "the friction at rest and its change with the speed compensate each other; a swing that ends at rest helps"
    if slowest > speed[best]:
        cause = "these speeds are rare in the recordings; a faster swing helps"
    return (
        f"the standard deviation of the torque is {1e3 * worst:.2g} mN m from {slowest:.2g} to {fastest:.2g} rad/s, but"
        f" {1e3 * std[best]:.2g} mN m at {speed[best]:.2g} rad/s: {cause}"
    )


def _up_to(curve: JointFriction, limit: FrictionLimit) -> tuple[Array, Array, Array]:
    """Return magnitudes of speed and torque, and the standard deviation of the torque.

    The speeds end at that of the limit.
    """
    u = np.array(curve.speed_rad_per_s)
    within = np.append(u[np.abs(u) <= limit.speed_rad_s], [-limit.speed_rad_s, limit.speed_rad_s])
    return np.abs(within), np.abs(np.interp(within, u, curve.torque_Nm)), np.interp(within, u, curve.std_Nm)
