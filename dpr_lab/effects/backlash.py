"""Backlash between a joint and its encoder: a loose coupling, a worn key, or a gear with the encoder at its motor."""

from dpr_lab.effects.effect import ARM, BenchQuantity, Effect, EffectParameter, InternalState, Params
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.effects.stages import StageName
from dpr_lab.kernels import inlined


@inlined
def play(angle: float, held: float, play_rad: float) -> float:
    """Angle held by the encoder, which follows the joint once it has crossed the backlash, rad."""
    half = 0.5 * abs(play_rad)
    return min(max(held, angle - half), angle + half)


@inlined
def driven_play(angle: float, held: float, drift: float, play_rad: float) -> float:
    """Angle held by an encoder at the motor, which turns by `drift` while the gear transmits no torque, rad."""
    return play(angle, held + drift, play_rad)


@inlined
def unloaded_turn(impulse: float, friction: float) -> float:
    """Rotation, rad, of a motor without inertia and load: impulse of its torque, N m s, viscous friction, N m s/rad."""
    return impulse / max(friction, 1e-12)


def _hidden(params: Params) -> float:
    return params["play_rad"]


def _tightened(params: Params, rig: RigConstants, joint: int) -> str:
    size = f"{1e3 * abs(params['play_rad']):.3g} mrad of backlash"
    if joint == ARM:
        return f"adjust the gear of the arm, which has {size}, or read the arm's angle at the arm"
    return f"tighten the coupling of encoder {joint + 1}, which has {size}"


_PARAMETERS = (EffectParameter("play_rad", "rad", 5e-3, "positive"),)
_SOURCE = "Play operator: Visintin (1994), Differential Models of Hysteresis, ch. III."


def _of_encoder(joint: int, stage: StageName, bench_check: str) -> Effect:
    """Backlash of the encoder of joint 1 or 2."""
    return Effect(
        name=f"backlash_joint{joint}",
        words=f"encoder backlash, joint {joint}",
        equation=f"encoder {joint} reads h, which is constant while |q{joint} - h| < x / 2 and then follows the joint",
        parameters=_PARAMETERS,
        site="sensor",
        stage=stage,
        kernel=play,
        joints=(joint - 1,),
        internal=(InternalState("lag", "rad"),),
        hides_step=_hidden,
        remedy=_tightened,
        quantities=(BenchQuantity("backlash of the encoder", "x", ("play_rad",)),),
        bench_check=bench_check,
        source=_SOURCE,
    )


BACKLASH_JOINT2 = _of_encoder(
    2,
    "play",
    "Hold the outer rod and turn the encoder's shaft by hand: the backlash can be felt and read from the counts.",
)

BACKLASH_JOINT1 = _of_encoder(
    1,
    "play1",
    "Hold the inner rod and turn the encoder's shaft, or the motor before the gear, by hand: the backlash can be felt"
    " and read from the counts.",
)

BACKLASH_JOINT0 = Effect(
    name="backlash_joint0",
    words="backlash of the arm's gear, with the encoder at the motor",
    equation=(
        "encoder 0 reads the angle h of the motor: c0 dh/dt = tau, the known torque, while |q0 - h| < x / 2; then the"
        " motor pushes the arm. Without a drive h is constant inside the backlash"
    ),
    parameters=_PARAMETERS,
    site="sensor",
    stage="play0",
    kernel=driven_play,
    joints=(ARM,),
    internal=(InternalState("lag", "rad"),),
    hides_step=_hidden,
    remedy=_tightened,
    quantities=(BenchQuantity("backlash of the gear", "x", ("play_rad",), definition="as an angle of the arm"),),
    bench_check=(
        "Hold the arm and turn the motor's shaft by hand to either side: the encoder counts through the backlash."
        " Friction, in contrast, resists the motion of the arm but the encoder counts it at once."
    ),
    source=f"{_SOURCE} Motor without inertia: Nordin & Gutman (2002), Controlling mechanical systems with backlash - a"
    " survey, Automatica 38, 1633.",
)
