"""Backlash between a joint and its encoder, for example a loose coupling or a gear."""

from typing import NamedTuple

from dpr_lab.effects.effect import ARM, BenchQuantity, Effect, EffectParameter, InternalState, Params, shape
from dpr_lab.effects.elementary import exp
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.effects.stages import StageName
from dpr_lab.kernels import inlined


@inlined
def play(angle: float, held: float, play_rad: float) -> float:
    """Return the angle at the encoder, rad.

    The angle is constant while the joint is inside the backlash; otherwise it follows the joint.
    """
    half = 0.5 * abs(play_rad)
    return min(max(held, angle - half), angle + half)


class Motor(NamedTuple):
    """State of a motor behind the backlash of a gear, referred to the arm side of the gear."""

    angle: float
    """Angle, rad."""
    speed: float
    """Speed, rad/s."""
    inertia: float
    """Moment of inertia, kg m^2."""
    loose: float
    """1 inside the backlash, where the gear transmits no torque; 0 in contact."""


@inlined
def geared_motor(
    angle: float,
    speed: float,
    held: float,
    turning: float,
    elapsed: float,
    torque: float,
    inertia: float,
    friction: float,
    play_rad: float,
    motor_share: float,
) -> Motor:
    """Compute the state of the motor after the time `elapsed`.

    Inside the backlash, the state is the exact solution of J dw/dt = torque - friction w. At an end of the backlash,
    the motor has the speed of the arm.

    Args:
        angle: angle of the arm at the end of the time, rad
        speed: speed of the arm at the end of the time, rad/s
        held: angle of the motor at the start, rad
        turning: speed of the motor at the start, rad/s
        elapsed: time, s
        torque: torque of the motor, N m
        inertia: moment of inertia of arm and motor together, kg m^2
        friction: viscous friction coefficient of arm and motor together, N m s/rad
        play_rad: width of the backlash, rad
        motor_share: share of the motor in the inertia
    """
    motor_inertia = min(max(motor_share, 1e-6), 0.9) * inertia
    rate = max(friction / motor_inertia, 1e-3)
    decay = exp(-rate * elapsed)
    lasting = (1.0 - decay) / rate
    free = held + turning * lasting + torque / motor_inertia * (elapsed - lasting) / rate
    reached = play(angle, free, play_rad)
    alone = turning * decay + torque / motor_inertia * lasting
    loose = abs(reached - angle) < 0.5 * abs(play_rad) * (1.0 - 1e-9)
    return Motor(reached, alone if reached == free else speed, motor_inertia, 1.0 if loose else 0.0)


def _hidden(params: Params) -> float:
    return params["play_rad"]


def _longest_step(params: Params) -> float:
    """Return the longest integration step, s.

    The drive torque is constant within a step, but a light motor inside the backlash follows its changes.
    """
    return 1.25e-3


def _tightened(params: Params, rig: RigConstants, joint: int) -> str:
    size = f"{1e3 * abs(params['play_rad']):.3g} mrad of backlash"
    if joint == ARM:
        return f"adjust the gear of the arm, which has {size}, or read the arm's angle at the arm"
    return f"tighten the coupling of encoder {joint + 1}, which has {size}"


_PARAMETERS = (EffectParameter("play_rad", "rad", 5e-3, "positive"),)
_SOURCE = "Play operator: Visintin (1994), Differential Models of Hysteresis, ch. III."


def _of_encoder(joint: int, stage: StageName, bench_check: str) -> Effect:
    """Return the backlash of the encoder of joint 1 or 2."""
    return Effect(
        name=f"backlash_joint{joint}",
        words=f"encoder backlash, joint {joint}",
        equation=f"encoder {joint} reads h: constant while |q{joint} - h| < x / 2, otherwise h follows the joint",
        parameters=_PARAMETERS,
        site="sensor",
        stage=stage,
        kernel=play,
        joints=(joint - 1,),
        internal=(InternalState("lag", "rad"),),
        hides_step=_hidden,
        remedy=_tightened,
        quantities=(BenchQuantity("backlash of the encoder", "x", ("play_rad",)),),
        symptom=(
            f"The reading of joint {joint} is constant for a short time at each turning point, so its curve has flat"
            " tops."
        ),
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
        "encoder 0 reads the angle h of the motor, which has the inertia J = share A and all viscous friction c0;"
        " while |q0 - h| < x / 2: J d^2h/dt^2 = tau - c0 dh/dt, and the motor exerts no torque on the arm; at the ends"
        " of the backlash motor and arm turn together"
    ),
    parameters=(
        *_PARAMETERS,
        shape("motor_share", "1", 0.02, (0.005, 0.03, 0.18), draw=(0.005, 0.2), continuous=True),
    ),
    site="sensor",
    stage="play0",
    kernel=geared_motor,
    joints=(ARM,),
    internal=(InternalState("lag", "rad"), InternalState("slip", "rad/s")),
    longest_step=_longest_step,
    hides_step=_hidden,
    remedy=_tightened,
    quantities=(BenchQuantity("backlash of the gear", "x", ("play_rad",), definition="angle of the arm"),),
    symptom=(
        "After each reversal of the motor, the encoder at the motor moves first; the arm follows later, with a small"
        " impact."
    ),
    bench_check=(
        "Hold the arm and turn the motor's shaft by hand to either side: the encoder counts through the backlash."
        " With friction instead of backlash, the encoder counts every motion of the arm immediately."
    ),
    source="Nordin & Gutman (2002), Controlling mechanical systems with backlash - a survey, Automatica 38, 1633.",
)
