"""A base that does not stand level, in the plane in which the rods swing."""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Effect, EffectParameter
from dpr_lab.effects.quantities import Known, Motion, Rods, Terms, torques
from dpr_lab.kernels import njit


@njit
def tilted(motion: Motion, rods: Rods, known: Known, vector: NDArray[np.float64], at: int) -> Terms:
    """Gravity turned by the tilt vector[at]: what it adds to e1 sin(theta1) and e2 sin(theta2)."""
    rise, lean = math.cos(vector[at]) - 1.0, math.sin(vector[at])
    torque1 = rods.e1 * (motion.sin1 * rise + motion.cos1 * lean)
    return torques(torque1, rods.e2 * (motion.sin2 * rise + motion.cos2 * lean))


BASE_TILT = Effect(
    name="base_tilt",
    equation="e1 sin(theta1 + tilt), e2 sin(theta2 + tilt) in place of e1 sin(theta1), e2 sin(theta2)",
    parameters=(EffectParameter("tilt_rad", "rad", 5e-3),),
    site="base",
    stage="torque",
    kernel=tilted,
    twins=("encoder_offset_joint1",),
    bench_check=(
        "Put a spirit level on the base, or turn the base by 180 degrees and repeat: a tilt changes sign, the zero of"
        " an encoder stays."
    ),
    source="Gravity turned in the plane of motion; a common fault of Furuta and cart rigs, e.g. arXiv 2202.01424.",
)
