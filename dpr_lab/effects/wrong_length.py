"""An inner rod that is longer than was measured."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Effect, EffectParameter
from dpr_lab.effects.quantities import Known, Motion, Rods, Terms, torques
from dpr_lab.kernels import njit


@njit
def longer(motion: Motion, rods: Rods, known: Known, vector: NDArray[np.float64], at: int) -> Terms:
    """e2 = d g / (L1 + x) in place of d g / L1; x = vector[at], m. The base parameters take up all else."""
    return torques(0.0, rods.e2 * (known.L1 / (known.L1 + vector[at]) - 1.0) * motion.sin2)


WRONG_LENGTH = Effect(
    name="wrong_length_L1",
    equation="e2 = d g / (L1 + x) in place of e2 = d g / L1",
    parameters=(EffectParameter("added_m", "m", 2e-3),),
    site="geometry",
    stage="torque",
    kernel=longer,
    twins=("clock_rate",),
    bench_check=(
        "Measure L1 between the axes of the joints with a calliper and look up the local gravity; a crystal is off by"
        " 0.01 % at most, so that an error above that is the length (or gravity)."
    ),
    source="Equation (1): d, e2, g and L1 meet only in e2 = d g / L1.",
)
