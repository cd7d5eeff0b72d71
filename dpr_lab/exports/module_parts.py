"""Assemble Python modules for export from functions of dpr-lab.

Text from a file, for example the name of a rig, is written to the source only as a Python literal, so it is never
executed.
"""

import ast
from collections.abc import Collection, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np

from dpr_lab.dynamics.arm import with_gravity
from dpr_lab.dynamics.base import BASE
from dpr_lab.dynamics.encoder_errors import read_at
from dpr_lab.dynamics.lanes.interpolation import cubic
from dpr_lab.dynamics.rig_constants import constants_of_run, rig_constants
from dpr_lab.dynamics.step import RigModel, RigState, accelerations_at, stepped
from dpr_lab.effects import EFFECTS, SLICES, effect_kernels
from dpr_lab.effects.effect_kernels import AT_RELEASE, STEPPED, required_by
from dpr_lab.effects.quantities import ArmModel, BaseParameters, RigConstants
from dpr_lab.effects.stages import Requirements
from dpr_lab.exports.source import PREAMBLE, Rewrite, sources
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.model import AnyModel
from dpr_lab.rig import Rig
from dpr_lab.setup import Setup

_EVERY = """
effect_torques load_torques dry_limits arm_model free_arm_model arm_torques arm_drives whole_torques arm_delay
arm_encoder_error dry_limit0 reading_shifts encoder_errors held_angle held_angle1 geared_motor0 internal_after
"""
FOLDED = {name: getattr(effect_kernels, name) for name in _EVERY.split()}
FOLDED |= {"delay_of_input": effect_kernels.input_delay}
"""Functions that evaluate all effects of the library. In an export they evaluate only the effects of the model."""

_USED = {"RigModel": RigModel, "RigState": RigState, "accelerations_at": accelerations_at, "stepped": stepped}
_USED |= {kind.__name__: kind for kind in (BaseParameters, RigConstants, ArmModel, Requirements)}
_USED |= {"read_at": read_at, "cubic": cubic}

SWING = '''
MODEL = {model}
START = {internal!r}  # internal states of the effects at the release


class Swing:
    """Step-by-step simulation from an initial state; your joint torques, N m, may change between steps."""

    encoders = 2

    def __init__(self, x0, t=0.0, run=0):
        theta1, theta2, omega1, omega2 = map(float, x0)
        self.t, self.x = float(t), RigState(0.0, theta1, theta2, 0.0, omega1, omega2, START)
        self.run, self.starts, self.steps, self.kept_s = run, [], [], 0.0
        self.held, self.began = [0.0, theta1, theta2 - {relative2!r} * theta1], self.t
        self.followed = 3 * [self.t]

    def step(self, h, torque1=0.0, torque2=0.0):
        """Simulate a step of h, s, with torques of joint 1 on the inner rod and of joint 2 on the outer rod."""
        old, self.x = self.x, self.after(h, torque1, torque2)
        self.starts.append(self.t)
        self.steps.append((h, old, self.x, torque1))
        self.t += h

    def after(self, h, torque1, torque2):
        """State after a step of h."""
        try:
            return stepped(self.t, self.x, h, MODEL._replace(params=(torque1, torque2)), {mode}, 0.0)
        except (ValueError, OverflowError):  # sine of a value that is not finite
            return self.x._replace(theta1=nan, theta2=nan, omega1=nan, omega2=nan)

    def read(self, t):
        """Readings of the encoders of joints 1 and 2 at device time t, s, rad; t must not decrease between calls."""
        at1, at2 = (max(instant, self.began) for instant in read_at(t, MODEL))
        for instant in self.instants(1, at1, MODEL.required.play1):
            self.held[1] = held_angle1(self.angles(instant)[0], self.held[1], None, None)
        for instant in self.instants(2, at2, MODEL.required.play):
            self.held[2] = held_angle(self.angles(instant)[1], self.held[2], None, None)
        _, angle1, angle2 = self.held
        kept = max(bisect(self.starts, min(at1, at2) - self.kept_s) - 1, 0)
        del self.starts[:kept], self.steps[:kept]
        error1, error2 = encoder_errors(angle1, angle2, t, self.run, MODEL.constants, None, None)
        return angle1 + error1, angle2 + error2

    def instants(self, joint, end, play):
        """Instants up to `end`, s, at which an encoder is evaluated; backlash requires the turning points."""
        begin, self.followed[joint] = self.followed[joint], end
        if play:
            for start, step in zip(self.starts, self.steps):
                for quarter in (start, start + 0.25 * step[0], start + 0.5 * step[0], start + 0.75 * step[0]):
                    if begin < quarter < end:
                        yield quarter
        yield end

    def angles(self, t):
        """Angles of joint 1, joint 2 (as its encoder measures it) and joint 0 at time t, by cubic interpolation."""
        if not self.steps:
            return self.x.theta1, self.x.theta2 - {relative2!r} * self.x.theta1, self.arm(self.x)[0]
        if t > self.t:  # the clock of the device is slow
            ahead = copy(self)
            ahead.starts, ahead.steps = self.starts[-1:], self.steps[-1:]
            ahead.step(t - self.t)
            return ahead.angles(t)
        i = bisect(self.starts, t, 1) - 1
        h, old, new, _ = self.steps[i]
        share = (t - self.starts[i]) / h
        theta1 = cubic(share, h, old.theta1, old.omega1, new.theta1, new.omega1)
        theta2 = cubic(share, h, old.theta2, old.omega2, new.theta2, new.omega2)
        theta0 = cubic(share, h, *self.arm(old), *self.arm(new))
        return theta1, theta2 - {relative2!r} * theta1, theta0

    def arm(self, x):
        """Angle and speed that the encoder of the arm reads."""
        return x.theta0, x.omega0

    def state(self):
        """(4,) theta1, theta2, omega1, omega2."""
        return np.array([self.x.theta1, self.x.theta2, self.x.omega1, self.x.omega2])


def states_at(x0, t, max_step, torques, kind):
    """(n, k) states of a swing at the instants t; nan from the first state that is not finite."""
    swing = kind(x0, t[0])
    states = np.full((len(t), len(swing.state())), np.nan)
    states[0] = swing.state()
    for i, (begin, end) in enumerate(pairwise(np.asarray(t, dtype=float).tolist()), 1):
        count = max(1, math.ceil((end - begin) / max_step - 1e-9))
        h = (end - begin) / count
        for k in range(count):
            swing.t = begin + k * h
            swing.step(h, *torques(swing.t, swing.state()))
        if not np.isfinite(swing.state()).all():
            break
        states[i] = swing.state()
    return states


def readings_at(x0, t, run, max_step, start, kind, torques):
    """(n, encoders) encoder readings at device times t, rad; the state at time `start`, s, is x0."""
    swing = kind(x0, start, run)
    read = np.full((len(t), kind.encoders), np.nan)
    for i, instant in enumerate(np.asarray(t, dtype=float).tolist()):
        while not swing.steps or swing.t < max(read_at(instant, MODEL)):
            swing.step(float(max_step), *torques(swing.t, swing.state()))
        if not np.isfinite(swing.state()).all():
            break
        read[i] = swing.read(instant)
    return read
'''


def simulated_rig(base: BaseParameters, constants: RigConstants, arm: ArmModel, effects: Collection[str]) -> RigModel:
    """Return the model of the rig for an exported module.

    The vector of effect parameters is empty, because the functions of a module read the parameters by name.
    """
    required = required_by(np.isin(list(EFFECTS), list(effects)))._replace(torque=True)
    return RigModel(base, constants, arm, (0.0, 0.0), None, Requirements(*map(bool, required)))  # type: ignore[arg-type]


def assembled(
    model: AnyModel,
    templates: tuple[str, str],
    rig: RigModel,
    effects: Mapping[str, Mapping[str, float]],
    mode: int,
    more: Mapping[str, Any],
    rewritten: Mapping[str, Rewrite],
    **constants: object,
) -> str:
    """Assemble a module from head, required functions, simulation class and tail.

    Args:
        model: the exported model
        templates: templates of head and tail
        rig: model of the rig in the module
        effects: effects that the module contains
        mode: mode of the arm
        more: additional functions of dpr-lab, as for `sources`
        rewritten: transformations of functions, as for `sources`
        constants: further values of the head by name
    """
    head, tail = templates
    head = head.format(
        rig=model.rig.name,
        scale=model.scale_sentence,
        left_out=[name for name in model.effects if name not in effects],
        effects=effects,
        L1=model.rig.L1,
        g=model.rig.g,
        parameters="\n".join(_parameter_lines(effects)),
        **constants,
    )
    chosen: dict[str, Rewrite] = {name: partial(of_effects, effects=effects) for name in FOLDED}
    chosen |= {"effect_torques": partial(_driven, effects=effects)}
    functions = sources(FOLDED | _USED | dict(more), chosen | dict(rewritten))
    swing = SWING.format(
        model=rig, internal=tuple(AT_RELEASE[list(STEPPED)].tolist()), mode=mode, relative2=rig.constants.relative2
    )
    return f"{head}{PREAMBLE}\n\n{functions}\n\n{swing}\n{tail.format(mode=mode)}"


def base_of(model: AnyModel) -> BaseParameters:
    """Return the base parameters of the mounted rods, SI.

    If only the inner rod is mounted, d and c2 are zero, so that the outer rod has no influence.
    """
    sizes, frame = model.sizes, model.rig
    if isinstance(model, Model) and model.fitted:
        p = (model.p_over_b or 0.0) * sizes["b"]
        sizes |= {"a": sizes["a"] - p, "d": 0.0, "e1": sizes["e1"] - p * frame.g / frame.L1, "c2": 0.0}
    return with_gravity([sizes[name] for name in BASE], frame.L1, frame.g)


def constants_of(model: AnyModel, rig: Rig) -> RigConstants:
    """Return the rig constants of the mounted rods."""
    alone = isinstance(model, Model) and bool(model.fitted)
    return constants_of_run(rig_constants(rig), Setup("inner" if alone else "both"))


def known_effects(effects: Mapping[str, Mapping[str, float]]) -> dict[str, dict[str, float]]:
    """Select the effects and parameters of a file that this version knows."""
    return {
        name: {p.name: values[p.name] for p in EFFECTS[name].parameters if p.name in values}
        for name, values in effects.items()
        if name in EFFECTS
    }


def _parameter_lines(effects: Iterable[str]) -> Iterable[str]:
    """Yield one line of source for each parameter, under the name used by the functions."""
    for name in effects:
        for p in EFFECTS[name].parameters:
            yield f"{name}_{p.name} = EFFECTS[{name!r}].get({p.name!r}, {p.default!r})"


def of_effects(node: ast.FunctionDef, effects: Collection[str]) -> ast.FunctionDef:
    """Reduce the definition of a function that evaluates all effects to the given effects."""
    return _Chosen(effects).visit(node)


def _driven(node: ast.FunctionDef, effects: Collection[str]) -> ast.FunctionDef:
    """Reduce the definition of `effect_torques` to the given effects, and add the known torques.

    In the result, `params` contains the known torques of joints 1 and 2.
    """
    node = of_effects(node, effects)
    (more,) = ast.parse("torque1, torque2 = torque1 + (params[0] - params[1]), torque2 + params[1]").body
    node.body.insert(-1, more)
    return node


class _Chosen(ast.NodeTransformer):
    """Transformer that keeps the branches of the given effects, and refers to their parameters by name."""

    def __init__(self, effects: Collection[str]) -> None:
        self.on = [name in effects for name in EFFECTS]
        self.parameters = [f"{name}_{p.name}" for name in SLICES for p in EFFECTS[name].parameters]

    def visit_If(self, node: ast.If) -> ast.AST | list[ast.AST]:
        index = _index_of(node.test, "active")
        if index is None:
            return self.generic_visit(node)
        return [self.visit(part) for part in node.body] if self.on[index] else []

    def visit_Subscript(self, node: ast.Subscript) -> ast.AST:
        index = _index_of(node, "params")
        return self.generic_visit(node) if index is None else ast.Name(self.parameters[index], ast.Load())


def _index_of(node: ast.expr, array: str) -> int | None:
    """Return the index in `array[index]`, or None for other expressions."""
    if not isinstance(node, ast.Subscript) or not isinstance(node.slice, ast.Constant):
        return None
    index, of_array = node.slice.value, isinstance(node.value, ast.Name) and node.value.id == array
    return index if of_array and isinstance(index, int) else None
