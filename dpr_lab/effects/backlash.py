"""Backlash between joint 2 and its encoder: a loose coupling or a worn key."""

from dpr_lab.effects.effect import BenchQuantity, Effect, EffectParameter, InternalState
from dpr_lab.kernels import inlined


@inlined
def play(angle: float, held: float, play_rad: float) -> float:
    """Angle held by the encoder, which follows the joint once it has crossed the backlash, rad."""
    half = 0.5 * abs(play_rad)
    return min(max(held, angle - half), angle + half)


BACKLASH_JOINT2 = Effect(
    name="backlash_joint2",
    words="encoder backlash, joint 2",
    equation="encoder 2 reads h, which is constant while |q2 - h| < x / 2 and then follows the joint",
    parameters=(EffectParameter("play_rad", "rad", 5e-3, "positive"),),
    site="sensor",
    stage="play",
    kernel=play,
    joints=(1,),
    internal=(InternalState("lag", "rad"),),
    hides_step=lambda params: params["play_rad"],
    remedy=lambda params, rig, joint: (
        f"tighten the coupling of encoder 2, which has {1e3 * abs(params['play_rad']):.3g} mrad of backlash"
    ),
    quantities=(BenchQuantity("backlash of the encoder", "x", ("play_rad",)),),
    bench_check="Hold the outer rod and turn the encoder's shaft by hand: the backlash can be felt and read from the"
    " counts.",
    source="Play operator: Visintin (1994), Differential Models of Hysteresis, ch. III.",
)
