"""Detent: magnets of a motor that pull a joint towards evenly spaced angles."""

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import EffectParameter, shape
from dpr_lab.effects.joints import pair
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import njit


@njit
def cogging(joint: Joint, vector: NDArray[np.float64], at: int) -> float:
    """Torque on the rod beyond the joint, N m: two harmonics of the order vector[at + 4]."""
    phase = vector[at + 4] * joint.angle
    cos, sin = math.cos(phase), math.sin(phase)
    first = vector[at] * cos + vector[at + 1] * sin
    return first + vector[at + 2] * (cos * cos - sin * sin) + vector[at + 3] * 2.0 * sin * cos


_JOINT1, DETENT_JOINT2 = pair(
    cogging,
    "detent",
    equation="tau = A1 cos(N q) + B1 sin(N q) + A2 cos(2 N q) + B2 sin(2 N q) with q the angle of joint {j}",
    parameters=(
        EffectParameter("cos1_Nm", "N m", 1e-3),
        EffectParameter("sin1_Nm", "N m", 1e-3),
        EffectParameter("cos2_Nm", "N m", 3e-4),
        EffectParameter("sin2_Nm", "N m", 3e-4),
        shape("order", "1", 12.0, tuple(float(order) for order in range(1, 41))),
    ),
    stage="torque",
    potential=True,
    bench_check=(
        "Turn joint {j} slowly by hand with the rod balanced: a detent is felt at evenly spaced angles. Take the motor"
        " off and repeat: a detent goes, a centroid off the axis stays."
    ),
    source="Hanselman (2003), Brushless Permanent Magnet Motor Design, ch. 9 (cogging torque).",
)

DETENT_JOINT1 = replace(_JOINT1, twins=("com_offset_link1",))
"""One detent a turn, cos(theta1), is what a centroid off the inner rod's axis does."""
