"""An encoder whose zero is not where it was told to be."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Effect, EffectParameter
from dpr_lab.effects.quantities import Known
from dpr_lab.kernels import njit


@njit
def shifted1(
    angle1: float, angle2: float, t: float, run: int, known: Known, vector: NDArray[np.float64], at: int
) -> tuple[float, float]:
    """Encoder 1 reads vector[at] more."""
    return vector[at], 0.0


@njit
def shifted2(
    angle1: float, angle2: float, t: float, run: int, known: Known, vector: NDArray[np.float64], at: int
) -> tuple[float, float]:
    """Encoder 2 reads vector[at] more."""
    return 0.0, vector[at]


_PARAMETERS = (EffectParameter("offset_rad", "rad", 5e-3),)
_SOURCE = "Definition of an encoder's zero, `dpr_lab.rig.Encoders`."

ENCODER_OFFSET_JOINT1 = Effect(
    name="encoder_offset_joint1",
    equation="encoder 1 reads q1 + x",
    parameters=_PARAMETERS,
    site="sensor",
    stage="encoder",
    kernel=shifted1,
    twins=("base_tilt", "encoder_eccentricity_joint1"),
    bench_check=(
        "Put a spirit level on the base, or turn the base by 180 degrees and repeat: the zero of an encoder stays, a"
        " tilt changes sign."
    ),
    source=_SOURCE,
)

ENCODER_OFFSET_JOINT2 = Effect(
    name="encoder_offset_joint2",
    equation="encoder 2 reads q2 + x",
    parameters=_PARAMETERS,
    site="sensor",
    stage="encoder",
    kernel=shifted2,
    twins=("com_offset_link2", "encoder_eccentricity_joint2"),
    bench_check=(
        "Take the outer rod off and turn it by 180 degrees about its long axis: the zero of the encoder stays, a"
        " centroid off the axis changes sides."
    ),
    source=_SOURCE,
)
