"""Interval of the largest friction torque of a joint, and the speeds at which this torque is uncertain."""

import numpy as np

from dpr_lab.acceptance.limits import FrictionLimit
from dpr_lab.arrays import Array
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.gap.result.evidence import JointFriction
from dpr_lab.shown import listed

KNOWN_BETTER = 3.0
"""Minimum ratio of the standard deviation at a speed to the smallest one, for a speed that counts as inaccurate."""


def largest_friction(curve: JointFriction, limit: FrictionLimit, confidence: float) -> tuple[float, float]:
    """Return the interval of the largest friction torque at speeds up to that of the limit, N m.

    The lower end comes from a simultaneous confidence band, the upper end from the pointwise 90 % intervals.
    """
    from scipy.special import chdtri  # slow to import, and every diagnosis imports this module

    _, size, std = _up_to(curve, limit)
    simultaneous = float(np.sqrt(chdtri(curve.coefficients, 1.0 - confidence)))
    lower, upper = (size - simultaneous * std).max(), (size + NORMAL_Q90 * std).max()
    return max(0.0, float(lower)), float(upper)


def largest_estimate(curve: JointFriction, limit: FrictionLimit) -> float:
    """Return the largest estimated friction torque at speeds up to that of the limit, N m."""
    return float(_up_to(curve, limit)[1].max())


def inaccurate_speeds(curve: JointFriction, limit: FrictionLimit) -> str:
    """Return a clause on the speeds at which the uncertainty of the torque leaves the limit undecided, and why.

    The text is empty if the uncertainty is about the same at all speeds.
    """
    speed, size, std = _up_to(curve, limit)
    best = int(np.argmin(std))
    inaccurate = (size + NORMAL_Q90 * std >= limit.max) & (std >= KNOWN_BETTER * std[best])
    sides = {
        "the friction at rest and its slope against the speed are correlated, and a swing that ends at rest helps": (
            inaccurate & (speed < speed[best])
        ),
        "high speeds are rare in the recordings, and a faster swing helps": inaccurate & (speed > speed[best]),
    }
    sides = {cause: side for cause, side in sides.items() if side.any()}
    if not sides:
        return ""
    places = [f"{1e3 * std[side].max():.2g} mN m {_range(speed[side])}" for side in sides.values()]
    return (
        f"with a free-form friction curve, the standard deviation of the torque is {listed(places)},"
        f" but {1e3 * std[best]:.2g} mN m at {speed[best]:.2g} rad/s: {'; '.join(sides)}"
    )


def _range(speeds: Array) -> str:
    first, last = (f"{speed:.2g}" for speed in (speeds.min(), speeds.max()))
    return f"at {last} rad/s" if first == last else f"from {first} to {last} rad/s"


def _up_to(curve: JointFriction, limit: FrictionLimit) -> tuple[Array, Array, Array]:
    """Return magnitudes of speed, rad/s, and torque, N m, and the standard deviation of the torque, N m.

    The largest speed is that of the limit.
    """
    u = np.array(curve.speed_rad_per_s)
    within = np.append(u[np.abs(u) <= limit.speed_rad_s], [-limit.speed_rad_s, limit.speed_rad_s])
    return np.abs(within), np.abs(np.interp(within, u, curve.torque_Nm)), np.interp(within, u, curve.std_Nm)
