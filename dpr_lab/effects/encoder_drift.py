"""Drift of an encoder zero during a swing, for example of a warming potentiometer."""

from dpr_lab.effects.effect import BenchQuantity, EffectParameter, pair
from dpr_lab.effects.quantities import EncoderReading
from dpr_lab.kernels import inlined

LARGEST_RAD_PER_S = 5e-3
"""Largest drift rate of an encoder's zero, rad/s: 0.3 degrees per second.

A faster drift is visible while the rods hang.
"""


@inlined
def drifting(encoder: EncoderReading, offset_rad: float, rate_rad_per_s: float) -> float:
    """Return the reading error, rad: offset at the release plus drift since then."""
    return offset_rad + rate_rad_per_s * max(encoder.t, 0.0)


ENCODER_DRIFT = pair(
    "encoder_drift",
    words="encoder zero drift, joint {j}",
    kernel=drifting,
    equation="encoder {j} reads q{j} + x + r t, with t the time since the release, 0 before the release",
    parameters=(
        EffectParameter("offset_rad", "rad", 5e-3),
        EffectParameter("rate_rad_per_s", "rad/s", 5e-4, most=LARGEST_RAD_PER_S),
    ),
    nested=("encoder_offset",),
    adds="rate_rad_per_s",
    site="sensor",
    stage="encoder",
    remedy=lambda params, rig, joint: (
        f"let encoder {joint + 1} and its electronics warm up, or tighten it on its shaft; or subtract"
        f" {1e3 * params['offset_rad']:.3g} mrad from its readings, and {1e3 * params['rate_rad_per_s']:.3g} mrad for"
        " each second since the release"
    ),
    quantities=(
        BenchQuantity("zero error at the release", "x", ("offset_rad",)),
        BenchQuantity("rate of the zero", "r", ("rate_rad_per_s",)),
    ),
    symptom=(
        "The centre of the swing moves steadily to one side. The readings of the hanging rods differ between the"
        " beginning and the end of a recording."
    ),
    bench_check=(
        "Let the rods hang at rest after a recording and read encoder {j} for a minute: the reading changes although"
        " the rods do not move."
    ),
    source="Temperature drift and slip in data sheets of potentiometers and shaft encoders.",
)
