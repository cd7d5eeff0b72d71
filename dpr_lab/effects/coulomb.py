"""Dry (Coulomb) friction in a rod joint."""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import EffectParameter
from dpr_lab.effects.joints import pair
from dpr_lab.effects.quantities import SMOOTHING, Joint
from dpr_lab.kernels import njit


@njit
def dry(joint: Joint, vector: NDArray[np.float64], at: int) -> float:
    """Torque -F tanh(u / v_s) on the rod beyond the joint, N m; F = vector[at]."""
    return -vector[at] * math.tanh(joint.speed / SMOOTHING)


COULOMB = pair(
    dry,
    "coulomb",
    twins=("hysteresis",),
    equation="tau = -F tanh(u / 0.02 rad/s) with u the speed of joint {j}",
    parameters=(EffectParameter("torque_Nm", "N m", 1e-3, "positive"),),
    stage="torque",
    dissipative=True,
    bench_check=(
        "Let joint {j} alone swing by a few degrees until it rests: under dry friction the peaks fall along a straight"
        " line and the rod stops away from the vertical; viscous friction gives a decaying exponential."
    ),
    source=(
        "Armstrong-Helouvry, Dupont & Canudas de Wit (1994), A survey of models, analysis tools and compensation"
        " methods for the control of machines with friction, Automatica 30(7), 1083-1138; the tanh instead of the jump"
        " is ours."
    ),
)
