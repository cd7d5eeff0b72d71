"""An encoder that counts more or less than it should for a turn: a belt, a gear, a wrong number in the rig file."""

from dpr_lab.effects.effect import EffectParameter, pair
from dpr_lab.effects.quantities import EncoderReading
from dpr_lab.kernels import inlined


@inlined
def stretched(encoder: EncoderReading, excess: float) -> float:
    """The encoder reads x times its angle from hanging more, rad."""
    return excess * (encoder.angle - encoder.hanging)


ENCODER_SCALE = pair(
    "encoder_scale",
    words="scale of the encoder, joint {j}",
    kernel=stretched,
    exported=lambda params: {"encoder_scale": params["excess"]},
    twins=("spring",),
    equation="encoder {j} reads (1 + x) q{j}, q{j} its angle from hanging",
    parameters=(EffectParameter("excess", "1", 1e-3),),
    site="sensor",
    stage="encoder",
    bench_check="Turn rod {j} by hand through ten whole turns to the same mark: the counts give the scale.",
    source="Definition of counts per turn, `dpr_lab.rig.Encoders`; counters are zero where the rods hang.",
)
