"""A spring across a joint: a cable or a hose that is wound up."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import EffectParameter
from dpr_lab.effects.joints import pair
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import njit


@njit
def elastic(joint: Joint, vector: NDArray[np.float64], at: int) -> float:
    """Torque -(k q + k3 q^3) on the rod beyond the joint, N m; k = vector[at], k3 = vector[at + 1]."""
    return -(vector[at] + vector[at + 1] * joint.angle * joint.angle) * joint.angle


SPRING = pair(
    elastic,
    "spring",
    twins=("encoder_scale",),
    equation="tau = -(k q + k3 q^3) with q the angle of joint {j} from hanging straight, turns included",
    parameters=(
        EffectParameter("stiffness_Nm_per_rad", "N m/rad", 1e-3, "positive"),
        EffectParameter("cubic_Nm_per_rad3", "N m/rad^3", 2e-5),
    ),
    stage="torque",
    potential=True,
    bench_check="Take the cable of joint {j} off (or add a second one) and repeat: a spring goes (or doubles).",
    source="Elastic restoring torque with Duffing's cubic term, e.g. Nayfeh & Mook (1979), Nonlinear Oscillations.",
)
