"""Compiled functions that evaluate all effects for one rig, one per stage.

`params` is the flat vector (SIZE,), and `active` the mask (effects,) from `active_effects`. `internal` contains the
internal states that move with a joint, in the order of `STEPPED`.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.effects import EFFECTS, SLICES, param_index
from dpr_lab.effects.effect import Effect, InternalState
from dpr_lab.effects.fold import arguments, call, compiled
from dpr_lab.effects.quantities import Terms, encoder0, encoder1, encoder2, joint0, joint1, joint2, yielding
from dpr_lab.effects.stages import PER_JOINT, STAGES, Requirements

_ALL = list(EFFECTS.values())
_AMPLITUDES = np.array([param_index(effect.name, p.name) for effect in _ALL for p in effect.amplitudes])
_FIRST_AMPLITUDES = np.cumsum([0, *(len(effect.amplitudes) for effect in _ALL[:-1])])

EFFECT_OF = np.repeat(np.arange(len(_ALL)), [len(effect.parameters) for effect in _ALL])
"""(SIZE,) index of the effect to which each parameter belongs."""

_STATES = [(effect, state) for effect in _ALL for state in effect.internal]

INTERNAL = tuple(f"{effect.name}.{state.name}" for effect, state in _STATES)
"""Names of all internal states in their order, as `effect.state`."""

AT_RELEASE = np.array([state.at_release for _, state in _STATES])
"""(internal,) values of the internal states until the release."""

STEPPED = tuple(i for i, (_, state) in enumerate(_STATES) if state.after is not None)
"""Indices in `INTERNAL` of the states that move with a joint."""

LAG0, LAG1, LAG2 = (
    next((i for i, (effect, _) in enumerate(_STATES) if effect.stage == stage), len(INTERNAL))
    for stage in ("play0", "play1", "play")
)
"""Indices of the backlash states of the arm, joint 1 and joint 2.

Each state is the angle held by the encoder minus the angle of its joint, rad. The state of the arm is followed by the
speed of its motor relative to the arm, rad/s.
"""

ARM = next((i for i, (effect, _) in enumerate(_STATES) if effect.stage == "arm"), len(INTERNAL))
"""Index of the state that is the arm's angle; the next state is the arm's speed."""


def stepped_states() -> Iterator[tuple[Effect, InternalState]]:
    """Return the internal states that move with a joint, each after its effect."""
    return (_STATES[i] for i in STEPPED)


class Contribution(NamedTuple):
    """One call of a kernel within a stage."""

    name: str
    """Name of the kernel in the generated source."""
    kernel: Callable[..., float]
    effect: Effect
    joint: int
    """Number of the joint: 0, 1 or 2."""
    state: int = 0
    """Index in `STEPPED` of the internal state that the call updates; used in the stage `transition` only."""

    def guard(self) -> str:
        """Return the source line of the `if` statement that checks whether the effect is active."""
        return f"if active[{_ALL.index(self.effect)}]:"

    def statements(self, stage: str, notation: Mapping[str, str]) -> list[str]:
        """Return the source lines that call the kernel and combine its value with the results of the stage.

        `notation` maps the names of the stage to names in the source.
        """
        row, required, start = STAGES[stage], arguments(self.kernel), SLICES[self.effect.name].start
        states = {s.name: f"{{{row.states}_{i}}}" for i, (e, s) in enumerate(stepped_states()) if e is self.effect}
        params = {p.name: f"{{params_{start + i}}}" for i, p in enumerate(self.effect.parameters)}
        lines = [f"x = {call(self.name, required, params, states, row.quantities)}", *row.combine(self.joint, required)]
        return [line.replace("#", str(self.joint)).replace("@", str(self.state)).format_map(notation) for line in lines]


def contributions(stage: str) -> list[Contribution]:
    """Return the kernel calls of a stage, in the order of the library."""
    if stage == "transition":
        return [
            Contribution(f"after{i}", state.after, effect, effect.joints[0] + 1, i)
            for i, (effect, state) in enumerate(stepped_states())
            if state.after is not None
        ]
    dry = {"dry": False, "dry0": True}
    effects = [
        effect
        for effect in _ALL
        if (effect.dry and effect.of_arm == dry[stage] if stage in dry else effect.stage == stage)
    ]
    return [
        Contribution(effect.name, effect.kernel, effect, joint + 1)
        for effect in effects
        for joint in (effect.joints if stage in PER_JOINT else effect.joints[:1])
    ]


class _ScalarNotation(dict[str, str]):
    """Scalar notation: a name is an argument or a local variable.

    `params_3` stands for `params[3]`.
    """

    def __missing__(self, name: str) -> str:
        array, _, index = name.rpartition("_")
        return f"{array}[{index}]" if array in ("params", "internal", "old_internal") else name


_NOTATION = _ScalarNotation(joint0="joint0(motion)", joint1="joint1(motion)", joint2="joint2(motion)")


def scalar_stage(stage: str) -> Any:
    """Return the compiled scalar version of a stage.

    It has the form (arguments of the stage, params, active) -> results of the stage.
    """
    row, calls = STAGES[stage], contributions(stage)
    states = range(len(STEPPED)) if stage == "transition" else range(1)
    results = {
        name.replace("@", str(i)): value.replace("@", str(i)).format_map(_NOTATION)
        for name, value in row.results.items()
        for i in states
    }
    lines = [f"    {name} = {value}" for name, value in results.items() if name != value]
    for contribution in calls:
        lines.append(f"    {contribution.guard()}")
        lines += [f"        {statement}" for statement in contribution.statements(stage, _NOTATION)]
    returned = row.returns.format_map(_NOTATION) or f"({', '.join(results)},)"
    known = (joint0, joint1, joint2, encoder0, encoder1, encoder2, yielding)
    names = {"Terms": Terms, "copysign": math.copysign} | {function.__name__: function for function in known}
    names |= {c.name: c.kernel for c in calls}
    return compiled([f"def {stage}_stage({row.arguments}, params, active):", *lines, f"    return {returned}"], names)


def _sliding() -> Any:
    names: dict[str, Any] = {}
    values = []
    for i, (effect, state) in enumerate(stepped_states()):
        names[f"sliding{i}"] = state.sliding
        values.append(f"sliding{i}(speed{effect.joints[0] + 1})" if state.sliding else repr(state.at_release))
    return compiled(["def sliding_states(speed0, speed1, speed2):", f"    return ({', '.join(values)},)"], names)


effect_torques = scalar_stage("torque")
"""(motion, base, constants, internal, params, active) -> Terms of the equation of motion."""

load_torques = scalar_stage("load")
"""(motion, base, constants, internal, params, active) -> Terms of load-dependent friction, for known joint forces."""

dry_limits = scalar_stage("dry")
"""(motion, push1, push2, params, active) -> limits of the Coulomb friction torques under the torques `push`, N m."""

arm_model = scalar_stage("arm")
"""(constants, arm, params, active) -> ArmModel: inertia, friction and stiffness of the arm.

`arm` is the model without effects.
"""

free_arm_model = scalar_stage("free_arm")
"""(constants, arm, params, active) -> ArmModel of a free or driven arm; `arm` is the model without effects."""

arm_torques = scalar_stage("torque0")
"""(motion, torque0, internal, params, active) -> torque on the arm, N m; `torque0` is the torque without effects."""

arm_drives = scalar_stage("drive0")
"""(motion, torque0, params, active) -> torque of the arm's drive, N m; `torque0` is the known torque without effects.

The effects act in sequence, the gain first. Each effect acts on the torque that the preceding effects return.
"""

whole_torques = scalar_stage("whole0")
"""(motion, base, constants, torque0, params, active) -> torques on the arm, on theta1 and on theta2, N m.

`torque0` is the torque on the arm without effects.
"""

dry_limit0 = scalar_stage("dry0")
"""(motion, push0, params, active) -> largest torque, N m, against which Coulomb friction holds the arm."""

arm_delay = scalar_stage("timing0")
"""(late0, params, active) -> time by which the arm is read before joint 1, s; `late0` is this time without effects."""

arm_encoder_error = scalar_stage("encoder0")
"""(angle0, t, run, constants, params, active) -> error of the reading of the arm's encoder, rad."""

reading_shifts = scalar_stage("timing")
"""(t, params, active) -> shifts of the instants at which joints 1 and 2 are read, s."""

encoder_errors = scalar_stage("encoder")
"""(angle1, angle2, t, run, constants, params, active) -> errors of the encoder readings of joints 1 and 2, rad."""

held_angle = scalar_stage("play")
"""(angle2, hold2, params, active) -> angle held by the encoder of joint 2 after its joint has reached `angle2`, rad."""

held_angle1 = scalar_stage("play1")
"""(angle1, hold1, params, active) -> angle held by the encoder of joint 1 after its joint has reached `angle1`, rad."""

geared_motor0 = scalar_stage("play0")
"""(angle0, speed0, hold0, motor_speed0, elapsed0, motor_torque0, geared_inertia, geared_friction, params, active) ->
fields of `dpr_lab.effects.backlash.Motor`.
"""

input_delay = scalar_stage("input")
"""(late, params, active) -> delay of the known torques, s; `late` is the delay without effects."""

internal_after = scalar_stage("transition")
"""Internal states after displacements of the joints, rad.

(old_internal, displacement0, displacement1, displacement2, params, active) -> states.
"""

internal_sliding = _sliding()
"""(speed0, speed1, speed2) -> internal states of joints that have slid for a long time; speeds in rad/s."""


_REQUIRED_BY: dict[str, Callable[[Effect], bool]] = {
    "prescribed": lambda effect: False,
    "stepped": lambda effect: any(state.after for state in effect.internal),
    "internal": lambda effect: bool(effect.internal),
    "arm": lambda effect: effect.stage in ("arm", "free_arm"),
    "dry0": lambda effect: effect.dry and effect.of_arm,
    "dry1": lambda effect: effect.dry and 0 in effect.joints,
    "dry2": lambda effect: effect.dry and 1 in effect.joints,
}
"""Field of `Requirements` that is not a stage -> function that returns whether an effect requires it."""

_REQUIREMENTS = np.array(
    [
        [_REQUIRED_BY[field](effect) if field in _REQUIRED_BY else effect.stage == field for effect in _ALL]
        for field in Requirements._fields
    ]
)
"""(fields of `Requirements`, effects) whether an effect requires a field."""

_WITH_STATES = _REQUIREMENTS[Requirements._fields.index("internal")]


def active_effects(params: Array) -> Flags:
    """Return the (..., effects) mask of effects with a non-zero amplitude in (..., SIZE) parameters."""
    return np.logical_or.reduceat(params[..., _AMPLITUDES] != 0.0, _FIRST_AMPLITUDES, axis=-1)


def keep_states(active: Flags) -> Flags:
    """Return the (...) mask: whether any active effect of a mask (..., effects) has an internal state."""
    return np.logical_or.reduce(active & _WITH_STATES, axis=-1)


def required_by(active: Flags) -> Requirements:
    """Return the requirements of the effects that a mask (..., effects) marks as active.

    Each field has the shape (...).
    """
    required = np.logical_or.reduce(active[..., None, :] & _REQUIREMENTS, axis=-1)
    return Requirements(*(required[..., i] for i in range(len(_REQUIREMENTS))))
