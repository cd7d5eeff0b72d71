"""Encoder scale error: wrong counts per turn, for example due to a belt."""

from dpr_lab.effects.at_arm import at_arm
from dpr_lab.effects.effect import BenchQuantity, EffectParameter, Params, pair
from dpr_lab.effects.quantities import EncoderReading, RigConstants
from dpr_lab.kernels import inlined

USUAL_LINES = (
    *(100, 128, 200, 250, 256, 300, 360, 400, 500, 512, 600, 720, 800, 1000, 1024, 1200, 1250, 1500, 1800, 2000),
    *(2048, 2500, 3000, 3600, 4000, 4096, 5000, 8192, 10_000),
)
"""Usual lines per turn of incremental encoders; a counter counts four edges per line."""


@inlined
def stretched(encoder: EncoderReading, excess: float) -> float:
    """Return the error of the reading, rad: `excess` times the angle from hanging."""
    return excess * (encoder.angle - encoder.hanging)


def remedy(params: Params, rig: RigConstants, joint: int, exact: float = 5e-3) -> str:
    """Describe how to correct the counts per turn of an encoder.

    If another common encoder has the corrected number of counts, the text names it. If no common encoder has it and the
    relative error exceeds `exact`, the largest tolerance, the text states that another cause is probable. An error of
    less than half a count per turn needs no correction.
    """
    configured = abs((rig.counts_per_rev1, rig.counts_per_rev2, rig.counts_per_rev0)[joint])
    correct = configured * (1.0 + params["excess"])
    if round(correct) == configured:
        return f"the rig file needs no correction: the error is less than half a count per turn of joint {joint + 1}"
    words = f"set counts_per_rev of joint {joint + 1} in the rig file to {correct:.0f} (now {configured:.0f})"
    usual = usual_counts(correct)
    if usual and usual != usual_counts(configured):
        words += f"; an encoder of {usual // 4} lines, with four counts per line, has {usual}"
    elif abs(params["excess"]) > exact:
        words += "; no common encoder has this number of counts per turn: unless the joint is measured by a"
        words += " potentiometer or through a belt or gear, another cause is probable"
    return words


def usual_counts(counts: float, near: float = 2e-3) -> int | None:
    """Return the counts per turn of the common encoder nearest to `counts`.

    The result is None if the relative difference is `near` or more.
    """
    nearest = min((4 * lines for lines in USUAL_LINES), key=lambda usual: abs(usual / counts - 1.0))
    return nearest if abs(nearest / counts - 1.0) < near else None


ENCODER_SCALE = pair(
    "encoder_scale",
    words="encoder scale, joint {j}",
    kernel=stretched,
    exported=lambda params: {"encoder_scale": params["excess"]},
    corrects="counts_per_rev",
    remedy=remedy,
    twins=("spring",),
    equation="encoder {j} reads (1 + x) q{j}, with q{j} the angle of the joint from hanging",
    parameters=(EffectParameter("excess", "1", 1e-3, most=0.2),),
    site="sensor",
    stage="encoder",
    quantities=(
        BenchQuantity(
            "scale error of the encoder", "x", ("excess",), definition="reading divided by true angle, minus 1"
        ),
    ),
    symptom=(
        "After whole turns, the reading of the hanging rod {j} is not a whole number of turns; all angles are too"
        " large or too small by the same factor."
    ),
    bench_check="Turn rod {j} by hand through ten whole turns to the same mark: the counts give the scale.",
    source="Definition of counts per turn, `dpr_lab.rig_tables.Encoders`; counters are zero where the rods hang.",
)

ENCODER_SCALE_JOINT0 = at_arm(
    ENCODER_SCALE[0],
    equation="encoder 0 reads (1 + x) q0, with q0 the angle of the arm",
    symptom="All angles of the arm are too large or too small by the same factor.",
    bench_check="Turn the arm by hand through whole turns to the same mark, as far as its cable allows.",
)
