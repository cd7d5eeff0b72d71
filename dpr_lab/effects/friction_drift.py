"""Viscous friction that changes while the rods swing: grease that warms, a seal that runs in."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import EffectParameter
from dpr_lab.effects.joints import pair
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import njit


@njit
def drifting(joint: Joint, vector: NDArray[np.float64], at: int) -> float:
    """Torque -r t u on the rod beyond the joint, N m; r = vector[at], t the time since the release."""
    return -vector[at] * joint.t * joint.speed


FRICTION_DRIFT = pair(
    drifting,
    "friction_drift",
    equation="tau = -r t u: c{j}(t) = c{j} + r t, t the time since the release",
    parameters=(EffectParameter("rate_Nm_per_rad", "N m/rad", 2e-5),),
    stage="torque",
    bench_check=(
        "Let the rods hang for ten minutes and repeat the first release last: friction of joint {j} that drifts differs"
        " between the two by more than they scatter."
    ),
    source="Viscosity of lubricants against temperature: Stachowiak & Batchelor (2013), Engineering Tribology, ch. 2.",
)
