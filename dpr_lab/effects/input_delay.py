"""Input delay: known torques act later, or earlier, than their time stamps."""

from dpr_lab.effects.effect import BenchQuantity, Effect, EffectParameter
from dpr_lab.kernels import inlined


@inlined
def later(delay_s: float) -> float:
    """Return the delay of the known torques, s."""
    return delay_s


INPUT_DELAY = Effect(
    name="input_delay",
    words="input delay",
    equation="tau(t - x) acts at t, with tau the known torque; x < 0: the torque was logged too late",
    parameters=(EffectParameter("delay_s", "s", 5e-3),),
    site="drive",
    stage="input",
    kernel=later,
    quantities=(BenchQuantity("delay of the input", "x", ("delay_s",)),),
    symptom=(
        "Every response to a step of the input begins earlier or later than in the simulation, always by the same time."
    ),
    bench_check=(
        "Command a torque step on a hanging rod at rest and log its encoder at the highest rate: the delay is the"
        " time from the step to the first motion of the rod."
    ),
    source="Astrom & Wittenmark (1997), Computer-Controlled Systems, sec. 2.3 and 3.2: time delays of a held input.",
)
