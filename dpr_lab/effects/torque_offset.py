"""Torque offset of a drive: a constant error of the torque, even at zero command."""

from dpr_lab.effects.at_arm import at_arm
from dpr_lab.effects.effect import BenchQuantity, EffectParameter, pair
from dpr_lab.kernels import inlined


@inlined
def shifted(offset_Nm: float) -> float:
    """Return the difference between acting and known torque, N m: the constant offset."""
    return offset_Nm


TORQUE_OFFSET = pair(
    "torque_offset",
    words="torque offset, joint {j}",
    kernel=shifted,
    equation="tau + C acts at joint {j} while the drive is on, with tau the known torque",
    parameters=(EffectParameter("offset_Nm", "N m", 5e-3),),
    site="drive",
    stage="drive",
    quantities=(BenchQuantity("offset torque", "C", ("offset_Nm",)),),
    symptom=(
        "The driven rod of joint {j} hangs away from the vertical while the drive is on, although its commanded"
        " torque is zero."
    ),
    bench_check=(
        "Record joint {j} with the drive on and the rod hanging at rest: the mean of its torque is the"
        " offset. An offset that remains with the drive off is due to a cable or a tilt."
    ),
    source="Khalil & Dombre (2002), Modeling, Identification and Control of Robots, ch. 12: offsets of motor currents.",
)

TORQUE_OFFSET_JOINT0 = at_arm(
    TORQUE_OFFSET[0],
    nested=(),
    equation="tau + C acts on the arm while the drive is on, with tau the known torque",
    symptom="The arm creeps or leans to one side while the drive is on with an input of zero.",
    bench_check=(
        "Command zero and measure the motor's current or voltage: this value is the offset. A torque that remains with"
        " the motor disconnected is due to a cable."
    ),
)
