"""Stribeck friction: more of it at rest than in motion."""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import EffectParameter, shape
from dpr_lab.effects.joints import pair
from dpr_lab.effects.quantities import SMOOTHING, Joint
from dpr_lab.kernels import njit


@njit
def stribeck(joint: Joint, vector: NDArray[np.float64], at: int) -> float:
    """Torque -(F + S exp(-(u / u_s)^2)) tanh(u / v_s) on the rod beyond the joint, N m."""
    ratio = joint.speed / vector[at + 2]
    return -(vector[at] + vector[at + 1] * math.exp(-ratio * ratio)) * math.tanh(joint.speed / SMOOTHING)


STRIBECK = pair(
    stribeck,
    "stribeck",
    nested=("coulomb",),
    twins=("friction_curve",),
    equation="tau = -(F + S exp(-(u / u_s)^2)) tanh(u / 0.02 rad/s) with u the speed of joint {j}",
    parameters=(
        EffectParameter("torque_Nm", "N m", 1e-3, "positive"),
        EffectParameter("extra_at_rest_Nm", "N m", 1e-3, "positive"),
        shape("speed_rad_per_s", "rad/s", 0.3, (0.1, 0.3, 1.0, 3.0)),
    ),
    stage="torque",
    dissipative=True,
    bench_check=(
        "Record the last small swings until joint {j} rests, several times: friction that grows towards rest shows"
        " there and nowhere else."
    ),
    source=(
        "Armstrong-Helouvry, Dupont & Canudas de Wit (1994), Automatica 30(7), 1083-1138 (Gaussian form); the tanh"
        " instead of the jump is ours."
    ),
)
