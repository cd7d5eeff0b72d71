"""Friction that follows the force the bearing carries."""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import EffectParameter
from dpr_lab.effects.joints import pair
from dpr_lab.effects.quantities import SMOOTHING, Joint
from dpr_lab.kernels import njit


@njit
def loaded(joint: Joint, vector: NDArray[np.float64], at: int) -> float:
    """Torque -mu r |N| tanh(u / v_s) on the rod beyond the joint, N m; mu r = vector[at], |N| the joint force."""
    return -vector[at] * joint.force * math.tanh(joint.speed / SMOOTHING)


LOAD_FRICTION = pair(
    loaded,
    "load_friction",
    equation="tau = -mu r |N| tanh(u / 0.02 rad/s) with N the force that joint {j} carries and u its speed",
    parameters=(EffectParameter("friction_radius_m", "m", 1e-4, "positive"),),
    stage="load",
    dissipative=True,
    bench_check="Clamp a known mass to the rod and repeat: friction of joint {j} that follows the load grows with it.",
    source=(
        "Duclos et al. (2024), BAM: better actuator models, arXiv 2410.08650, load-dependent friction; the joint force"
        " is that of the motion without this friction, which it hardly changes."
    ),
)
