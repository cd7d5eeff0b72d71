"""Encoder offset: the zero of an encoder differs from the zero in the rig file."""

from dpr_lab.effects.at_arm import at_arm
from dpr_lab.effects.effect import BenchQuantity, Effect, EffectParameter, Params
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.kernels import inlined


@inlined
def shifted(offset_rad: float) -> float:
    """Return the error of the reading, rad: the constant offset."""
    return offset_rad


def remedy(params: Params, rig: RigConstants, joint: int) -> str:
    """Describe how to correct the zero of an encoder."""
    offset = f"{1e3 * params['offset_rad']:.3g} mrad"
    return (
        f"set the zero of encoder {joint + 1} again while the rods hang at rest, or subtract {offset} from its readings"
    )


def _of_joint(number: int, twins: tuple[str, ...], symptom: str, bench_check: str) -> Effect:
    """Return the offset of the encoder of joint 1 or 2."""
    return Effect(
        name=f"encoder_offset_joint{number}",
        words=f"encoder offset, joint {number}",
        equation=f"encoder {number} reads q{number} + x",
        parameters=(EffectParameter("offset_rad", "rad", 5e-3),),
        site="sensor",
        stage="encoder",
        kernel=shifted,
        universal=True,
        common=True,
        corrects="zero_counts",
        exported=lambda params: {"encoder_offset": params["offset_rad"]},
        remedy=remedy,
        joints=(number - 1,),
        twins=twins,
        quantities=(
            BenchQuantity("zero error of the encoder", "x", ("offset_rad",), definition="angle read minus true angle"),
        ),
        symptom=symptom,
        bench_check=bench_check,
        source="Definition of an encoder's zero, `dpr_lab.rig_tables.Encoders`.",
    )


ENCODER_OFFSET_JOINT1 = _of_joint(
    1,
    twins=("base_tilt", "encoder_eccentricity_joint1"),
    symptom="While the rods hang at rest, encoder 1 does not read the hanging angle; swings to both sides differ.",
    bench_check=(
        "Read encoder 1 with the rods at rest, turn the base by 180 degrees and read it again: half the sum is the zero"
        " error; a tilt of the base changes sign and cancels."
    ),
)

ENCODER_OFFSET_JOINT2 = _of_joint(
    2,
    twins=("com_offset_link2", "encoder_eccentricity_joint2"),
    symptom=(
        "While the rods hang at rest, the reading of encoder 2 is not zero; its value is the same in every recording."
    ),
    bench_check=(
        "Remove the outer rod, turn it by 180 degrees about its long axis, mount it again and read encoder 2 at rest:"
        " a zero error does not change, the effect of an offset of the centre of mass changes sign."
    ),
)

ENCODER_OFFSET_JOINT0 = at_arm(
    ENCODER_OFFSET_JOINT1,
    twins=("encoder_eccentricity_joint0", "spring_joint0"),
    remedy=lambda params, rig, joint: (
        f"subtract {1e3 * params['offset_rad']:.3g} mrad from the readings of the arm's encoder; the"
        " offset matters only if a cable or a stop acts on the arm"
    ),
    symptom="The reading of encoder 0 is not zero at the mark of the arm.",
    bench_check="Turn the arm to its mark and read encoder 0: the reading is the zero error.",
)
