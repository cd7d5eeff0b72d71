"""Unknown gain of a drive: a free parameter of every fit, not a fault."""

from dpr_lab.effects.effect import ARM, BenchQuantity, Effect, EffectParameter
from dpr_lab.kernels import inlined


@inlined
def regained(torque: float, excess: float) -> float:
    """Return the acting torque minus the torque for the assumed gain, N m."""
    return excess * torque


DRIVE_GAIN = Effect(
    name="drive_gain",
    words="gain of the arm's drive",
    equation="(1 + x) tau acts on the arm, with tau the input times an assumed gain",
    parameters=(EffectParameter("excess", "1", 0.05, most=1e6),),
    site="drive",
    stage="drive0",
    kernel=regained,
    joints=(ARM,),
    quantities=(BenchQuantity("gain of the drive divided by the assumed gain, minus 1", "x", ("excess",)),),
    symptom="The arm responds to every input too strongly or too weakly, by the same factor.",
    bench_check=(
        "Hold the arm's tip against a spring scale and command a steady input: force times length divided by the input"
        " is the gain."
    ),
    source="Ljung (1999), System Identification, ch. 4: the static gain of a model structure.",
)
