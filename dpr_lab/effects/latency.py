"""Latency of encoder 2, or of the arm's encoder, relative to encoder 1."""

from dpr_lab.effects.at_arm import at_arm
from dpr_lab.effects.effect import BenchQuantity, Effect, EffectParameter
from dpr_lab.kernels import inlined


@inlined
def late(delay_s: float) -> float:
    """Return the shift of the instant at which joint 2 is read, s: minus the delay."""
    return -delay_s


LATENCY_JOINT2 = Effect(
    name="latency_joint2",
    words="latency, joint 2",
    equation="encoder 2 reads q2(t - x), encoder 1 reads q1(t)",
    parameters=(EffectParameter("delay_s", "s", 1e-3),),
    site="timing",
    stage="timing",
    kernel=late,
    joints=(1,),
    remedy=lambda params, rig, joint: (
        f"latch both encoders on one edge, or subtract {1e3 * params['delay_s']:.3g} ms from the time stamps of"
        " encoder 2"
    ),
    quantities=(BenchQuantity("delay of encoder 2 after encoder 1", "x", ("delay_s",)),),
    symptom=(
        "The residual of joint 2 is proportional to its speed: it is largest at the lowest point of the swing and"
        " zero at the turning points."
    ),
    bench_check=(
        "Swap the two encoder cables at the board and repeat: a delay of the electronics changes its sign. Or latch"
        " both counters on one edge and repeat: the delay vanishes."
    ),
    source=(
        "Polled buses read one encoder after the other; a delay that both encoders share is not visible in a free"
        " swing."
    ),
)


@inlined
def later(delay_s: float) -> float:
    """Return the time by which the arm is read before joint 1, s: the delay."""
    return delay_s


LATENCY_JOINT0 = at_arm(
    LATENCY_JOINT2,
    kernel=later,
    equation="encoder 0 reads q0(t - x), encoder 1 reads q1(t)",
    remedy=lambda params, rig, joint: (
        f"latch all encoders on one edge, or subtract {1e3 * params['delay_s']:.3g} ms from the time stamps of"
        " encoder 0"
    ),
    quantities=(BenchQuantity("delay of encoder 0 after encoder 1", "x", ("delay_s",)),),
    symptom="The residual of the arm is proportional to its speed, and zero where it reverses.",
    bench_check="Swap the cables of encoders 0 and 1 at the board and repeat: a delay of the board changes its sign.",
)
