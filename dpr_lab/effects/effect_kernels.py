"""All effects as compiled functions, one for each stage (`dpr_lab.effects.effect.Stage`), written from the table.

`params` is the flat vector (SIZE,) and `active` says which effects are on, (effects,) of `active_effects`. `internal`
are those internal states that move with a joint, in the order of `STEPPED`.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import EFFECTS, SLICES, param_index
from dpr_lab.effects.effect import Effect, InternalState, Stage
from dpr_lab.effects.fold import arguments, call, compiled
from dpr_lab.effects.quantities import (
    NOTHING,
    encoder1,
    encoder2,
    joint1,
    joint2,
    plus,
    torque_at1,
    torque_at2,
    yielding,
)

_ALL = list(EFFECTS.values())
_AMPLITUDES = [param_index(effect.name, p.name) for effect in _ALL for p in effect.amplitudes]
_FIRST_AMPLITUDES = np.cumsum([0, *(len(effect.amplitudes) for effect in _ALL[:-1])])

EFFECT_OF = np.repeat(np.arange(len(_ALL)), [len(effect.parameters) for effect in _ALL])
"""(SIZE,) index of the effect that each parameter belongs to."""

_STATES = [(effect, state) for effect in _ALL for state in effect.internal]

INTERNAL = tuple(f"{effect.name}.{state.name}" for effect, state in _STATES)
"""Order of all internal states, as `effect.state`."""

AT_RELEASE = np.array([state.at_release for _, state in _STATES])
"""(internal,) their values until the release."""

STEPPED = tuple(i for i, (_, state) in enumerate(_STATES) if state.after is not None)
"""Places in `INTERNAL` of those that move with a joint."""

LAG = next((i for i, (effect, _) in enumerate(_STATES) if effect.stage == "play"), len(INTERNAL))
"""Place of the play's: the angle that encoder 2 holds less its joint's, rad."""

ARM = next((i for i, (effect, _) in enumerate(_STATES) if effect.stage == "arm"), len(INTERNAL))
"""Place of the arm's angle; its speed comes next."""


def of_stage(stage: Stage) -> Iterator[tuple[int, Effect]]:
    """Index and effect of all effects of a stage."""
    return ((index, effect) for index, effect in enumerate(_ALL) if effect.stage == stage)


def dry_effects() -> Iterator[tuple[int, Effect]]:
    """Index and effect of all dry friction."""
    return ((index, effect) for index, effect in enumerate(_ALL) if effect.dry)


def parameters_of(effect: Effect, array: str = "params[{}]") -> dict[str, str]:
    """Name of each parameter -> expression of its value."""
    start = SLICES[effect.name].start
    return {p.name: array.format(start + k) for k, p in enumerate(effect.parameters)}


def stepped_of(effect: Effect, array: str = "internal[{}]") -> dict[str, str]:
    """Name of each internal state that moves with a joint -> expression of its value."""
    own = [(i, _STATES[i]) for i in STEPPED]
    return {state.name: array.format(k) for k, (_, (owner, state)) in enumerate(own) if owner is effect}


def stepped_states() -> Iterator[tuple[int, Effect, InternalState]]:
    """Index of the effect, the effect and the state, of all internal states that move with a joint."""
    return ((_ALL.index(_STATES[i][0]), *_STATES[i]) for i in STEPPED)


def _torque_stage(stage: Stage) -> Any:
    names: dict[str, Any] = {"NOTHING": NOTHING, "plus": plus, "joint1": joint1, "joint2": joint2}
    names |= {"at1": torque_at1, "at2": torque_at2}
    lines = ["def folded(motion, base, constants, internal, params, active):", "    total = NOTHING"]
    for index, effect in of_stage(stage):
        names[effect.name] = effect.kernel
        wanted, j = arguments(effect.kernel), effect.joints[0] + 1
        quantities = {name: name for name in ("motion", "base", "constants")} | {"joint": f"joint{j}(motion)"}
        value = call(effect.name, wanted, parameters_of(effect), stepped_of(effect), quantities)
        value = f"at{j}({value})" if "joint" in wanted else value
        lines += [f"    if active[{index}]:", f"        total = plus(total, {value})"]
    return compiled([*lines, "    return total"], names)


def _dry_limits() -> Any:
    names: dict[str, Any] = {"joint1": joint1, "joint2": joint2, "yielding": yielding, "copysign": math.copysign}
    lines = ["def folded(motion, push1, push2, params, active):", "    limit1, limit2 = 0.0, 0.0"]
    for index, effect in dry_effects():
        names[effect.name], j = effect.kernel, effect.joints[0] + 1
        joint = {"joint": f"yielding(joint{j}(motion), push{j})"}
        value = call(effect.name, arguments(effect.kernel), parameters_of(effect), joint)
        lines += [f"    if active[{index}]:", f"        limit{j} -= copysign(1.0, push{j}) * {value}"]
    return compiled([*lines, "    return max(limit1, 0.0), max(limit2, 0.0)"], names)


def _joint_stage(stage: Stage, signature: str, quantities: tuple[dict[str, str], ...], **names: Any) -> Any:
    """The sums, of both joints, of what effects add there."""
    lines = [f"def folded({signature}, params, active):", "    total1, total2 = 0.0, 0.0"]
    for index, effect in of_stage(stage):
        names[effect.name] = effect.kernel
        lines.append(f"    if active[{index}]:")
        for j in effect.joints:
            value = call(effect.name, arguments(effect.kernel), parameters_of(effect), quantities[j])
            lines.append(f"        total{j + 1} += {value}")
    return compiled([*lines, "    return total1, total2"], names)


def _one_effect(stage: Stage, signature: str, otherwise: str) -> Any:
    """What the effect of a stage says, of which there is one at most; one of the arguments where it is off."""
    names = {}
    lines = [f"def folded({signature}, params, active):"]
    quantities = {name: name for name in signature.split(", ")}
    for index, effect in of_stage(stage):
        names[effect.name] = effect.kernel
        value = call(effect.name, arguments(effect.kernel), parameters_of(effect), quantities)
        lines += [f"    if active[{index}]:", f"        return {value}"]
    return compiled([*lines, f"    return {otherwise}"], names)


def _transitions() -> Any:
    names: dict[str, Any] = {}
    lines = ["def folded(internal, displacement1, displacement2, params, active):"]
    lines += [f"    x{k} = internal[{k}]" for k in range(len(STEPPED))]
    for k, (index, effect, state) in enumerate(stepped_states()):
        assert state.after is not None
        names[f"after{k}"] = state.after
        displacement = {"displacement": f"displacement{effect.joints[0] + 1}"}
        value = call(
            f"after{k}", arguments(state.after), parameters_of(effect), stepped_of(effect, "x{}"), displacement
        )
        lines += [f"    if active[{index}]:", f"        x{k} = {value}"]
    return compiled([*lines, f"    return ({', '.join(f'x{k}' for k in range(len(STEPPED)))},)"], names)


def _sliding() -> Any:
    names: dict[str, Any] = {}
    values = []
    for k, (_, effect, state) in enumerate(stepped_states()):
        names[f"sliding{k}"] = state.sliding
        values.append(f"sliding{k}(speed{effect.joints[0] + 1})" if state.sliding else repr(state.at_release))
    return compiled(["def folded(speed1, speed2):", f"    return ({', '.join(values)},)"], names)


effect_torques = _torque_stage("torque")
"""(motion, base, constants, internal, params, active) -> Terms of what moves the rods."""

load_torques = _torque_stage("load")
"""The same of friction that follows the load, in a motion whose joint forces are known."""

dry_limits = _dry_limits()
"""(motion, push1, push2, params, active) -> torques, N m, up to which dry friction holds joints that are pushed so."""

arm_model = _one_effect("arm", "constants, held", "held")
"""(constants, held, params, active) -> ArmModel: what holds the arm; `held` where no effect does."""

reading_shifts = _joint_stage("timing", "t", ({"t": "t"}, {"t": "t"}))
"""(t, params, active) -> s added to the instants at which joints 1 and 2 are read."""

encoder_errors = _joint_stage(
    "encoder",
    "angle1, angle2, t, run, constants",
    tuple({"encoder": f"encoder{j}(angle{j}, t, run, constants)"} for j in (1, 2)),
    encoder1=encoder1,
    encoder2=encoder2,
)
"""(angle1, angle2, t, run, constants, params, active) -> rad added to what the encoders of joints 1 and 2 read."""

held_angle = _one_effect("play", "angle, held", "angle")
"""(angle, held, params, active) -> the angle that the encoder of joint 2 holds once its joint is at `angle`, rad."""

input_delay = _one_effect("input", "none", "none")
"""(none, params, active) -> s by which known torques act later; `none` where no effect says so."""

internal_after = _transitions()
"""(internal, displacement1, displacement2, params, active) -> internal, after turns of the joints, rad."""

internal_sliding = _sliding()
"""(speed1, speed2) -> internal, of joints that have slid for long, rad/s."""


class Acting(NamedTuple):
    """Which stages have an effect that is on; bools, or arrays of them."""

    torques: Any
    loads: Any
    """One needs the joint forces."""
    arm: Any
    """One lets the arm move."""
    timing: Any
    errors: Any
    """One adds to what encoders read."""
    play: Any
    drives: Any
    """One changes the known torque of a joint."""
    carried: Any
    """None does: the arm moves as it is known to, whatever is on."""
    stepped: Any
    """One has an internal state that moves with a joint."""
    internal: Any
    """One has any internal state."""
    dry1: Any
    """One can hold joint 1 at rest."""
    dry2: Any


_ASKING = np.array(
    [
        [holds(effect) for effect in _ALL]
        for holds in (
            *(
                lambda effect, stage=stage: effect.stage == stage
                for stage in ("torque", "load", "arm", "timing", "encoder", "play", "drive")
            ),
            lambda effect: False,
            lambda effect: any(state.after for state in effect.internal),
            lambda effect: bool(effect.internal),
            *(lambda effect, joint=joint: effect.dry and joint in effect.joints for joint in (0, 1)),
        )
    ]
)
"""(fields of `Acting`, effects)"""


def active_effects(params: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(..., effects) which effects of (..., SIZE) are on: those with an amplitude that is not zero."""
    return np.logical_or.reduceat(params[..., _AMPLITUDES] != 0.0, _FIRST_AMPLITUDES, axis=-1)


def acting(active: NDArray[np.bool_]) -> Acting:
    """What is asked for by effects that are on, (..., effects); each field (...)."""
    asked = np.logical_or.reduce(active[..., None, :] & _ASKING, axis=-1)
    return Acting(*(asked[..., i] for i in range(len(_ASKING))))
