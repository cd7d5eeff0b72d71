"""The effects over the lanes of a workspace: each is a loop of its own, skipped where it is off."""

import math
from typing import Any

from dpr_lab.dynamics.lanes.workspace import LANES, At, base_at, constants_at, joint1_at, joint2_at, motion_at
from dpr_lab.effects import SLICES
from dpr_lab.effects.effect import Effect, Stage
from dpr_lab.effects.effect_kernels import STEPPED, dry_effects, of_stage, stepped_states
from dpr_lab.effects.fold import arguments, call, compiled
from dpr_lab.effects.quantities import yielding

_NAMES: dict[str, Any] = {
    kernel.__name__: kernel for kernel in (base_at, constants_at, joint1_at, joint2_at, motion_at)
}

_ADDED = {
    "term_a": "x.a",
    "term_b": "x.b",
    "term_coupling": "x.coupling",
    "torque1": "x.torque1",
    "torque2": "x.torque2",
}


def _lane(row: int, place: int = 0) -> str:
    return f"w[{row + place * LANES} + k]"


def _parameters(effect: Effect) -> dict[str, str]:
    start = SLICES[effect.name].start
    return {p.name: _lane(At.params, start + i) for i, p in enumerate(effect.parameters)}


def _internal(effect: Effect, row: int) -> dict[str, str]:
    return {state.name: _lane(row, i) for i, (_, owner, state) in enumerate(stepped_states()) if owner is effect}


def _loop(index: int, *body: str) -> list[str]:
    lines = [f"    if active[{index}]:", f"        for k in range({LANES}):"]
    return [*lines, *(f"            {line}" for line in body)]


def _added(effect: Effect) -> list[str]:
    """The source that adds an effect to the terms of a lane."""
    wanted, joint = arguments(effect.kernel), effect.joints[0] + 1
    quantities = {"motion": "motion_at(w, k)", "base": "base_at(w, k)", "constants": "constants_at(w, k, constants)"}
    quantities["joint"] = f"joint{joint}_at(w, k)"
    quantities["torque"] = f"({_lane(At.drive1)} + {_lane(At.drive2)})" if joint == 1 else _lane(At.drive2)
    value = call(effect.name, wanted, _parameters(effect), _internal(effect, At.internal), quantities)
    if "joint" not in wanted and effect.stage != "drive":
        return [f"x = {value}", *(f"{_lane(getattr(At, row))} += {part}" for row, part in _ADDED.items())]
    back = [f"{_lane(At.torque1)} -= x", f"{_lane(At.torque2)} += x"]
    return [f"x = {value}", *(back if joint == 2 else [f"{_lane(At.torque1)} += x"])]


def _stage(stage: Stage) -> Any:
    names, lines = dict(_NAMES), ["def folded(w, constants, active):"]
    for index, effect in of_stage(stage):
        names[effect.name] = effect.kernel
        lines += _loop(index, *_added(effect))
    return compiled([*lines, "    return"], names)


def _dry_limits() -> Any:
    names, lines = {**_NAMES, "yielding": yielding, "copysign": math.copysign}, ["def folded(w, constants, active):"]
    for index, effect in dry_effects():
        names[effect.name], j = effect.kernel, effect.joints[0] + 1
        push, limit = _lane((At.push1, At.push2)[j - 1]), _lane((At.limit1, At.limit2)[j - 1])
        joint = {"joint": f"yielding(joint{j}_at(w, k), {push})"}
        value = call(effect.name, arguments(effect.kernel), _parameters(effect), joint)
        lines += _loop(index, f"{limit} -= copysign(1.0, {push}) * {value}")
    return compiled([*lines, "    return"], names)


def _transitions() -> Any:
    names: dict[str, Any] = {}
    lines = ["def folded(w, active):", f"    for k in range({LANES * len(STEPPED)}):"]
    lines += [f"        w[{At.moved} + k] = w[{At.old_internal} + k]"]
    for i, (index, effect, state) in enumerate(stepped_states()):
        assert state.after is not None
        names[f"after{i}"] = state.after
        displacement = {"displacement": _lane((At.displacement1, At.displacement2)[effect.joints[0]])}
        offered = _parameters(effect), _internal(effect, At.old_internal), displacement
        value = call(f"after{i}", arguments(state.after), *offered)
        lines += _loop(index, f"{_lane(At.moved, i)} = {value}")
    return compiled([*lines, "    return"], names)


def _play() -> Any:
    names, lines = {}, ["def folded(w, active):"]
    quantities = {"angle": _lane(At.angle2), "held": _lane(At.hold)}
    for index, effect in of_stage("play"):
        names[effect.name] = effect.kernel
        value = call(effect.name, arguments(effect.kernel), _parameters(effect), quantities)
        lines += _loop(index, f"{_lane(At.angle2)} = {value}")
    return compiled([*lines, "    return"], names)


add_torques = _stage("torque")
"""(w, constants, active): add to the terms what moves the rods."""

add_load_friction = _stage("load")
"""(w, constants, active): add to the terms the friction that follows the load; the joint forces are known."""

add_drives = _stage("drive")
"""(w, constants, active): add to the terms what drives give beyond their known torques."""

add_dry_limits = _dry_limits()
"""(w, constants, active): add to the limits the torques up to which dry friction holds joints that are pushed so."""

displaced = _transitions()
"""(w, active): internal states after the displacements of the joints, from those at the start of the step."""

played = _play()
"""(w, active): in place of the angle of joint 2, the one that its encoder holds there."""
