"""An encoder disc or magnet that sits off centre or tilted: an error that repeats with every turn."""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Effect, EffectParameter
from dpr_lab.effects.quantities import Known
from dpr_lab.kernels import njit

HARMONICS = 6


@njit
def eccentric(angle: float, vector: NDArray[np.float64], at: int) -> float:
    """Sum over k of A_k cos(k q) + B_k sin(k q), rad; A_k, B_k = vector[at + 2 k - 2], vector[at + 2 k - 1]."""
    cos, sin = math.cos(angle), math.sin(angle)
    cos_k, sin_k, error = 1.0, 0.0, 0.0
    for k in range(HARMONICS):
        cos_k, sin_k = cos_k * cos - sin_k * sin, sin_k * cos + cos_k * sin
        error += vector[at + 2 * k] * cos_k + vector[at + 2 * k + 1] * sin_k
    return error


@njit
def eccentric1(
    angle1: float, angle2: float, t: float, run: int, known: Known, vector: NDArray[np.float64], at: int
) -> tuple[float, float]:
    """What encoder 1 reads too much."""
    return eccentric(angle1, vector, at), 0.0


@njit
def eccentric2(
    angle1: float, angle2: float, t: float, run: int, known: Known, vector: NDArray[np.float64], at: int
) -> tuple[float, float]:
    """What encoder 2 reads too much."""
    return 0.0, eccentric(angle2, vector, at)


_PARAMETERS = tuple(
    EffectParameter(f"{wave}{k}_rad", "rad", 3e-3 / k) for k in range(1, HARMONICS + 1) for wave in ("cos", "sin")
)
_SOURCE = (
    "Eccentricity gives one cycle a turn and an oval track two: Synapticon Circulo encoder manual; 0.1 mm at a radius"
    " of 15 mm is 7 mrad."
)

ENCODER_ECCENTRICITY_JOINT1, ENCODER_ECCENTRICITY_JOINT2 = (
    Effect(
        name=f"encoder_eccentricity_joint{j}",
        equation=f"encoder {j} reads q{j} + sum over k = 1..6 of A_k cos(k q{j}) + B_k sin(k q{j})",
        parameters=_PARAMETERS,
        site="sensor",
        stage="encoder",
        kernel=kernel,
        twins=(f"encoder_offset_joint{j}",),
        bench_check=(
            f"Take encoder {j} off, turn its disc or magnet by 90 degrees on its shaft and repeat: the error turns too."
        ),
        source=_SOURCE,
    )
    for j, kernel in ((1, eccentric1), (2, eccentric2))
)
