"""Friction of any form that grows with speed: a curve through fixed speeds, made of increments of one sign.

At rest it may differ between the two directions, as a skewed seal or a preloaded bearing does.
"""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import EffectParameter
from dpr_lab.effects.joints import pair
from dpr_lab.effects.quantities import SMOOTHING, Joint
from dpr_lab.kernels import njit

KNOTS = (0.0, 0.3, 1.0, 3.0, 8.0)
"""Speeds at which the curve bends, rad/s; the last lies within fast swings, where only viscous friction still grows."""


@njit
def curve(joint: Joint, vector: NDArray[np.float64], at: int) -> float:
    """Torque on the rod beyond the joint, N m: a step at rest, then one ramp between each two knots."""
    speed = abs(joint.speed)
    size = vector[at] if joint.speed > 0.0 else vector[at + 1]
    for k in range(1, len(KNOTS)):
        size += vector[at + 1 + k] * min(max((speed - KNOTS[k - 1]) / (KNOTS[k] - KNOTS[k - 1]), 0.0), 1.0)
    return -size * math.tanh(joint.speed / SMOOTHING)


FRICTION_CURVE = pair(
    curve,
    "friction_curve",
    nested=("coulomb",),
    twins=("stribeck",),
    equation=(
        "tau = -tanh(u / 0.02 rad/s) (F + sum_k rise_k ramp_k(|u|)), F = forward for u > 0 and backward for u < 0, each"
        " ramp_k going from 0 to 1 between two of the speeds 0, 0.3, 1, 3, 8 rad/s of joint {j}"
    ),
    parameters=tuple(
        EffectParameter(f"{name}_Nm", "N m", 5e-4, "positive")
        for name in ("forward", "backward", *(f"rise{k}" for k in range(1, len(KNOTS))))
    ),
    stage="torque",
    dissipative=True,
    bench_check=(
        "Drive joint {j} at constant speeds with a falling weight, or compare the decay of swings of different size:"
        " the loss at each speed gives the curve directly."
    ),
    source=(
        "Isotonic (monotone) regression, Robertson, Wright & Dykstra (1988), Order Restricted Statistical Inference;"
        " its use for a bearing is ours."
    ),
)
