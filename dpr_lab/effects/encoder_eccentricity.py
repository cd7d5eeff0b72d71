"""Encoder eccentricity: an off-centre or tilted disc causes an error that repeats every turn."""

from dpr_lab.effects.at_arm import at_arm
from dpr_lab.effects.effect import BenchQuantity, EffectParameter, pair
from dpr_lab.effects.elementary import sincos
from dpr_lab.effects.quantities import EncoderReading
from dpr_lab.kernels import inlined


@inlined
def eccentric(
    encoder: EncoderReading,
    cos1_rad: float,
    sin1_rad: float,
    cos2_rad: float,
    sin2_rad: float,
    cos3_rad: float,
    sin3_rad: float,
    cos4_rad: float,
    sin4_rad: float,
    cos5_rad: float,
    sin5_rad: float,
    cos6_rad: float,
    sin6_rad: float,
) -> float:
    """Return the reading error, rad: sum over k of A_k cos(k q) + B_k sin(k q)."""
    sin, cos = sincos(encoder.angle)
    cos_k, sin_k, error = 1.0, 0.0, 0.0
    for A, B in (
        (cos1_rad, sin1_rad),
        (cos2_rad, sin2_rad),
        (cos3_rad, sin3_rad),
        (cos4_rad, sin4_rad),
        (cos5_rad, sin5_rad),
        (cos6_rad, sin6_rad),
    ):
        cos_k, sin_k = cos_k * cos - sin_k * sin, sin_k * cos + cos_k * sin
        error += A * cos_k + B * sin_k
    return error


LARGEST_RAD = 0.03
"""Largest amplitude of the first harmonic, rad, for a disc with an offset of 3 % of its radius.

The largest amplitude of harmonic k is 1 / k of this value.
"""

ENCODER_ECCENTRICITY = pair(
    "encoder_eccentricity",
    words="encoder eccentricity, joint {j}",
    kernel=eccentric,
    remedy=lambda params, rig, joint: (
        f"centre the disc or magnet of encoder {joint + 1}, or subtract its error over a turn from its readings"
    ),
    twins=("encoder_offset",),
    equation="encoder {j} reads q{j} + sum over k = 1..6 of A_k cos(k q{j}) + B_k sin(k q{j})",
    parameters=tuple(
        EffectParameter(f"{wave}{k}_rad", "rad", 3e-3 / k, most=LARGEST_RAD / k)
        for k in range(1, 7)
        for wave in ("cos", "sin")
    ),
    site="sensor",
    stage="encoder",
    quantities=(BenchQuantity("peak encoder error, one cycle per turn", "A_1", ("cos1_rad", "sin1_rad")),),
    symptom=(
        "The residual of joint {j} repeats with its angle, one or several times per turn, in the same way in every"
        " recording and at every speed."
    ),
    bench_check=(
        "Remove encoder {j}, turn its disc or magnet by 90 degrees on its shaft and repeat: the error turns"
        " by the same angle."
    ),
    source=(
        "Eccentricity gives one cycle per turn and an oval track two: Synapticon Circulo encoder manual; 0.1 mm at a"
        " radius of 15 mm is 7 mrad."
    ),
)

ENCODER_ECCENTRICITY_JOINT0 = at_arm(
    ENCODER_ECCENTRICITY[0],
    symptom="The residual of the arm repeats with its angle, one or several times per turn, at every speed.",
    bench_check="Turn the disc or magnet of encoder 0 by 90 degrees on its shaft and repeat: the error turns too.",
)
