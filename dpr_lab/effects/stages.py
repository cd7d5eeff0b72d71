"""Stages: points between torques and encoder counts at which effects act, one row of `STAGES` each.

Scalar code (`dpr_lab.effects.effect_kernels`, one rig) and lane code (`dpr_lab.dynamics.lanes.effects`, many candidates
in parallel) are both generated from these rows. They differ only in their notation of names: the scalar version uses an
argument or a local variable, the lane version uses a row of the workspace.

    stage       quantities of a kernel             returns
    torque      joint                              torque of its joint on the following rod, N m
                motion, base, constants            Terms
    load        the same, with known joint forces  the same, of load-dependent friction
    drive       joint, torque                      N m added to the known torque of its joint
    dry         joint                              torque of Coulomb friction of a joint that starts to slide, N m
    arm         constants                          ArmModel: inertia, friction and stiffness of a held arm
    free_arm    constants                          ArmModel of a free or driven arm
    torque0     joint                              torque on a free or driven arm, N m
    drive0      joint, torque                      N m added to the torque on the arm after the previous effects
    whole0      motion, base, constants            torques on theta0, theta1, theta2 of a rig with such an arm, N m
    dry0        joint                              torque of dry friction of an arm that starts to slide, N m
    timing      t                                  s added to the instant at which each of `joints` is read
    timing0                                        s by which the arm is read earlier than joint 1
    encoder     encoder                            rad added to the reading of the encoder of each of `joints`
    encoder0    encoder                            rad added to the reading of the arm's encoder
    play        angle, held                        angle that the encoder of joint 2 holds, rad
    play1       angle, held                        angle that the encoder of joint 1 holds, rad
    play0       angle, speed, held, turning,       Motor behind the backlash of the arm's gear
                elapsed, torque, inertia, friction
    input                                          delay of the known torques, s
    transition  state, displacement                internal state after a displacement of the joint

The quantities are those of `dpr_lab.effects.quantities`. The next arguments of a kernel are internal states and
parameters of its effect, by their names. A kernel is called only while one of the effect's amplitudes is not zero.
`dry` and `dry0` call kernels of other stages again, and `transition` calls the kernels of internal states. All other
stages are values of `Effect.stage`. The arm has separate stages, so that a rig with a clamped arm does not compute
them.
"""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

StageName = Literal[
    "torque", "load", "arm", "free_arm", "torque0", "whole0", "timing", "timing0", "encoder", "encoder0", "play",
    "play1", "play0", "drive", "drive0", "input",
]  # fmt: skip
"""Name of the stage at which the kernel of an effect is called."""

Combine = Callable[[int, Collection[str]], tuple[str, ...]]
"""Function (joint, arguments of the kernel) -> statements that combine the kernel's value `x` with the results."""


@dataclass(frozen=True, slots=True)
class Stage:
    """Quantities that the effects of one stage receive, and the combination of their contributions.

    Expressions contain names in braces, which each version replaces by its own notation. `#` is replaced by the number
    of the joint and `@` by the index of the internal state. `name_3` is element 3 of an array.
    """

    arguments: str
    """Arguments of the scalar version, before `params` and `active`."""
    quantities: Mapping[str, str]
    """Expressions of the values of the kernel arguments, by argument."""
    results: Mapping[str, str]
    """Values of the results without effects, by result. In the lane version, the caller sets the rows to these
    values."""
    combine: Combine
    returns: str = ""
    """Expression returned by the scalar version; empty: all results."""
    states: str = "internal"
    """Name of the array of internal states."""


def _joint_torque(joint: int, arguments: Collection[str]) -> tuple[str, ...]:
    """Return the statements that add a torque x of one joint to both rods.

    A torque of joint 1 acts on the inner rod. A torque of joint 2 acts on the outer rod, with its reaction on the inner
    rod.
    """
    return ("{torque1} += x",) if joint == 1 else ("{torque1} -= x", "{torque2} += x")


def _terms(joint: int, arguments: Collection[str]) -> tuple[str, ...]:
    """Return the statements that add the result of a kernel.

    A kernel with the argument `joint` returns a torque of this joint. Any other kernel returns `Terms`.
    """
    if "joint" in arguments:
        return _joint_torque(joint, arguments)
    return (
        "{term_a} += x.a",
        "{term_b} += x.b",
        "{term_coupling} += x.coupling",
        "{torque1} += x.torque1",
        "{torque2} += x.torque2",
    )


def _each(statement: str) -> Combine:
    return lambda joint, arguments: (statement,)


_TERMS = Stage(
    arguments="motion, base, constants, internal",
    quantities={"joint": "{joint#}", "motion": "{motion}", "base": "{base}", "constants": "{constants}"},
    results=dict.fromkeys(("term_a", "term_b", "term_coupling", "torque1", "torque2"), "0.0"),
    combine=_terms,
    returns="Terms({term_a}, {term_b}, {term_coupling}, {torque1}, {torque2})",
)


def _held_arm() -> Stage:
    """Return the stage of effects that replace inertia, friction and stiffness of the arm."""
    return Stage(
        arguments="constants, arm",
        quantities={"constants": "{constants}"},
        results={"arm": "{arm}"},
        combine=_each("{arm} = x"),
        returns="{arm}",
    )


def _play(joint: int) -> Stage:
    """Return the stage of an encoder's backlash, whose result is the held angle."""
    angle, hold = f"angle{joint}", f"hold{joint}"
    return Stage(
        arguments=f"{angle}, {hold}",
        quantities={"angle": "{angle#}", "held": "{hold#}"},
        results={angle: f"{{{angle}}}"},
        combine=_each("{angle#} = x"),
        returns=f"{{{angle}}}",
    )


STAGES: dict[str, Stage] = {
    "torque": _TERMS,
    "load": _TERMS,
    "drive": Stage(
        arguments="motion, known1, known2",
        quantities={"joint": "{joint#}", "torque": "{known#}"},
        results={"torque1": "0.0", "torque2": "0.0"},
        combine=_joint_torque,
    ),
    "dry": Stage(
        arguments="motion, push1, push2",
        quantities={"joint": "yielding({joint#}, {push#})"},
        results={"limit1": "0.0", "limit2": "0.0"},
        combine=_each("{limit#} -= copysign(1.0, {push#}) * x"),
        returns="max({limit1}, 0.0), max({limit2}, 0.0)",
    ),
    "arm": _held_arm(),
    "free_arm": _held_arm(),
    "torque0": Stage(
        arguments="motion, torque0, internal",
        quantities={"joint": "{joint0}"},
        results={"torque0": "{torque0}"},
        combine=_each("{torque0} += x"),
        returns="{torque0}",
    ),
    "drive0": Stage(
        arguments="motion, torque0",
        quantities={"joint": "{joint0}", "torque": "{torque0}"},
        results={"torque0": "{torque0}"},
        combine=_each("{torque0} += x"),
        returns="{torque0}",
    ),
    "whole0": Stage(
        arguments="motion, base, constants, torque0",
        quantities={"motion": "{motion}", "base": "{base}", "constants": "{constants}"},
        results={"torque0": "{torque0}", "torque1": "0.0", "torque2": "0.0"},
        combine=lambda joint, arguments: ("{torque0} += x[0]", "{torque1} += x[1]", "{torque2} += x[2]"),
    ),
    "dry0": Stage(
        arguments="motion, push0",
        quantities={"joint": "yielding({joint0}, {push0})"},
        results={"limit0": "0.0"},
        combine=_each("{limit0} -= copysign(1.0, {push0}) * x"),
        returns="max({limit0}, 0.0)",
    ),
    "timing": Stage(
        arguments="t",
        quantities={"t": "{t}"},
        results={"shift1": "0.0", "shift2": "0.0"},
        combine=_each("{shift#} += x"),
    ),
    "encoder": Stage(
        arguments="angle1, angle2, t, run, constants",
        quantities={"encoder": "encoder#({angle#}, {t}, {run}, {constants})"},
        results={"error1": "0.0", "error2": "0.0"},
        combine=_each("{error#} += x"),
    ),
    "timing0": Stage(
        arguments="late0",
        quantities={},
        results={"late0": "{late0}"},
        combine=_each("{late0} += x"),
        returns="{late0}",
    ),
    "encoder0": Stage(
        arguments="angle0, t, run, constants",
        quantities={"encoder": "encoder0({angle0}, {t}, {run}, {constants})"},
        results={"error0": "0.0"},
        combine=_each("{error0} += x"),
        returns="{error0}",
    ),
    "play": _play(2),
    "play1": _play(1),
    "play0": Stage(
        arguments="angle0, speed0, hold0, motor_speed0, elapsed0, motor_torque0, geared_inertia, geared_friction",
        quantities={
            "angle": "{angle0}",
            "speed": "{speed0}",
            "held": "{hold0}",
            "turning": "{motor_speed0}",
            "elapsed": "{elapsed0}",
            "torque": "{motor_torque0}",
            "inertia": "{geared_inertia}",
            "friction": "{geared_friction}",
        },
        results={"hold0": "{hold0}", "motor_speed0": "{motor_speed0}", "motor_inertia0": "0.0", "loose0": "0.0"},
        combine=_each("{hold0}, {motor_speed0}, {motor_inertia0}, {loose0} = x"),
    ),
    "input": Stage(
        arguments="late",
        quantities={},
        results={"late": "{late}"},
        combine=_each("{late} = x"),
        returns="{late}",
    ),
    "transition": Stage(
        arguments="old_internal, displacement0, displacement1, displacement2",
        quantities={"displacement": "{displacement#}"},
        results={"moved_@": "{old_internal_@}"},
        combine=_each("{moved_@} = x"),
        states="old_internal",
    ),
}
"""Definitions of the stages by name."""

PER_JOINT = ("timing", "encoder")
"""Stages whose kernels are called for each joint of an effect; all others are called for the first joint only."""


class Requirements(NamedTuple):
    """Quantities that the active effects require in a step, as bools or arrays of bools.

    A field with the name of a stage states whether an effect of this stage is active.
    """

    torque: Any
    load: Any
    """Whether joint forces are needed."""
    arm: Any
    """Whether the arm moves freely."""
    torque0: Any
    timing: Any
    encoder: Any
    encoder0: Any
    play: Any
    play1: Any
    play0: Any
    drive: Any
    drive0: Any
    whole0: Any
    prescribed: Any
    """Whether the arm has a prescribed motion; the setup of a run determines this, not an effect."""
    stepped: Any
    """Whether an internal state that moves with a joint is active."""
    internal: Any
    """Whether any internal state is active."""
    dry1: Any
    """Whether Coulomb friction can hold joint 1 at rest."""
    dry2: Any
    dry0: Any
    """Whether Coulomb friction can hold the arm at rest."""
