"""An encoder that counts more or less than it should for a turn: a belt, a gear, a wrong number in the rig file."""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Effect, EffectParameter
from dpr_lab.effects.quantities import Known
from dpr_lab.kernels import njit


@njit
def stretched1(
    angle1: float, angle2: float, t: float, run: int, known: Known, vector: NDArray[np.float64], at: int
) -> tuple[float, float]:
    """Encoder 1 reads x (q1 - pi) more; x = vector[at]."""
    return vector[at] * (angle1 - math.pi), 0.0


@njit
def stretched2(
    angle1: float, angle2: float, t: float, run: int, known: Known, vector: NDArray[np.float64], at: int
) -> tuple[float, float]:
    """Encoder 2 reads x times its angle from hanging more; x = vector[at]."""
    return 0.0, vector[at] * (angle2 - (1.0 - known.relative2) * math.pi)


_PARAMETERS = (EffectParameter("excess", "1", 1e-3),)
_SOURCE = "Definition of counts per turn, `dpr_lab.rig.Encoders`; counters are zero where the rods hang."

ENCODER_SCALE_JOINT1, ENCODER_SCALE_JOINT2 = (
    Effect(
        name=f"encoder_scale_joint{j}",
        equation=f"encoder {j} reads (1 + x) q{j}, q{j} its angle from hanging",
        parameters=_PARAMETERS,
        site="sensor",
        stage="encoder",
        kernel=kernel,
        twins=(f"spring_joint{j}",),
        bench_check=f"Turn rod {j} by hand through ten whole turns to the same mark: the counts give the scale.",
        source=_SOURCE,
    )
    for j, kernel in ((1, stretched1), (2, stretched2))
)
