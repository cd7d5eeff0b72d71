"""Export the corrected model as a plain Python module that needs only numpy.

The module contains the functions with which dpr-lab itself simulates (`dpr_lab.exports.source`), reduced to the named
effects.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from dpr_lab.dynamics.arm import CLAMPED, DRIVEN, FREE
from dpr_lab.dynamics.base import BASE
from dpr_lab.dynamics.moving_arm.geared_motor import GearedState, arm_of_gear, stepped_with_gear
from dpr_lab.dynamics.rig_constants import constants_of_run
from dpr_lab.dynamics.step import with_arm
from dpr_lab.effects import EFFECTS, OF_FREE_SWINGS, effect_params
from dpr_lab.effects.backlash import BACKLASH_JOINT0
from dpr_lab.effects.effect_kernels import arm_model
from dpr_lab.effects.quantities import HELD_ARM, ArmModel
from dpr_lab.exports.module_parts import assembled, base_of, constants_of, known_effects, simulated_rig
from dpr_lab.exports.source import Rewrite
from dpr_lab.identification.moving_arm.engine import engine_constants
from dpr_lab.identification.moving_arm.model import AnyModel, MovingArmModel
from dpr_lab.rig import Rig
from dpr_lab.setup import Setup

_HEAD = '''"""Double pendulum with the effects that dpr-lab named; simulated by the same functions as in dpr-lab.

simulate(x0, t)     states of a swing: theta1, theta2 absolute angles, rad, 0 = upright, pi = hanging; speeds, rad/s
readings(x0, t)     readings of the encoders of joints 1 and 2 at device times t, rad
derivative(t, x)    time derivative of a state
Swing(x0)           step-by-step simulation with your own torques

All quantities are in SI units; t is the time since the release, s.
"""

import math
from bisect import bisect
from collections import namedtuple
from copy import copy
from itertools import pairwise

import numpy as np

inf, nan = math.inf, math.nan
RIG = {rig!r}
SCALE = {scale!r}
LEFT_OUT = {left_out!r}  # effects that were named, but that this module does not contain
EFFECTS = {effects!r}
L1, L2, G = {L1!r}, {L2!r}, {g!r}
BASE = {base!r}  # a, b, d, e1, c1, c2
{parameters}

'''

_TAIL = '''
def simulate(x0, t, max_step=1e-3, torques=lambda t, state: (0.0, 0.0), kind=Swing):
    """(n, 4) states at the instants t, by the classical Runge-Kutta method; nan from the first that is not finite.

    torques(t, state): torques of joints 1 and 2, N m, constant during each step. kind: class that simulates the steps.
    """
    return states_at(x0, t, max_step, torques, kind)


def readings(x0, t, run=0, max_step=1e-3, start=0.0, kind=Swing, torques=lambda t, state: (0.0, 0.0)):
    """(n, 2) readings of the encoders of joints 1 and 2 at device times t, rad; the state at `start`, s, is x0.

    torques(t, state): torques of joints 1 and 2, N m, constant during each step.
    """
    return readings_at(x0, t, run, max_step, start, kind, torques)


def derivative(t, x, torques=(0.0, 0.0)):
    """(4,) time derivative of theta1, theta2, omega1, omega2, with the internal states at the release, arm at rest."""
    start = Swing(x, t)
    alphas = accelerations_at(t, start.x, 0.0, 0.0, MODEL._replace(params=tuple(torques)), {mode}, 0.0)
    return np.array([*x[2:], *alphas[1:]])
'''


_HEAD_OF_ARM = '''"""Rods on a moving arm with the identified values; simulated by the same functions as in dpr-lab.

simulate(x0, t, inputs)  states at the instants t; each input is held until the next instant
readings(x0, t, ...)     readings of the encoders of joints 0, 1 and 2 at device times t, rad
derivative(x, u)         time derivative of a state
step(x, u, h)            state after a step of h, s
ArmSwing(x0)             step-by-step simulation

A state contains theta0, theta1, theta2, omega0, omega1, omega2 of arm, inner and outer rod: absolute angles, rad, and
speeds, rad/s. The rods are upright at 0 and hang at pi. Without an outer rod, theta2 is zero. INPUT is the kind of the
input. All quantities are in SI units.
"""

import math
from bisect import bisect
from collections import namedtuple
from copy import copy
from itertools import pairwise

import numpy as np

inf, nan = math.inf, math.nan
RIG = {rig!r}
SCALE = {scale!r}
INPUT = {input!r}  # torque (N m), current (A), voltage (V) or acceleration (rad/s^2) of the arm; empty without one
LEFT_OUT = {left_out!r}  # effects that were named, but that this module does not contain
EFFECTS = {effects!r}
VALUES = {values!r}
L1, G = {L1!r}, {g!r}
GAIN = {gain!r}  # torque on the arm over its input
OUTER = {outer!r}  # whether the outer rod is mounted
{parameters}

'''

_TAIL_OF_ARM = '''
DELAY = delay_of_input(0.0, None, None)  # of the input, s
GEARED = MODEL.required.play0  # whether the arm's motor is a separate body behind the backlash of a gear
OF_ARM = MODEL._replace(required=MODEL.required._replace(drive0=False))  # the effects of the drive act on the motor


class ArmSwing(Swing):
    """Step-by-step simulation from an initial state (6,); the input of the arm's drive may change between steps."""

    encoders = 3

    def __init__(self, x0, t=0.0, run=0):
        theta0, theta1, theta2, omega0, omega1, omega2 = map(float, x0)
        theta2, omega2 = (theta2, omega2) if OUTER else (0.0, 0.0)
        super().__init__((theta1, theta2, omega1, omega2), t, run)
        self.x = self.x._replace(theta0=theta0, omega0=omega0)
        self.x = GearedState(*self.x, theta0, omega0, 0.0, 0.0, 0.0) if GEARED else self.x
        self.input, self.times, self.impulse = None, [], []
        self.kept_s = abs(arm_delay(0.0, None, None))

    def step(self, h, u=None):
        """Simulate a step of h, s, with an input."""
        self.input = (self.input or 0.0) if u is None else float(u)
        super().step(h, self.delayed(h))

    def delayed(self, h):
        """Mean input that acts during a step of h, after the delay; before the start, the first input acts."""
        if not DELAY:
            return self.input
        if not self.times:
            self.times, self.impulse = [self.t - 10.0, self.t], [-10.0 * self.input, 0.0]
        self.times, self.impulse = [*self.times, self.t + h], [*self.impulse, self.impulse[-1] + h * self.input]
        old = max(bisect(self.times, self.t - DELAY) - 1, 0)
        self.times, self.impulse = self.times[old:], self.impulse[old:]
        until = np.interp([self.t - DELAY, self.t - DELAY + h], self.times, self.impulse)
        return float(until[1] - until[0]) / h

    def after(self, h, u, _):
        """State after a step of h."""
        try:
            if GEARED:
                return stepped_with_gear(self.t, self.x, h, OF_ARM, {mode}, GAIN * u)
            return stepped(self.t, self.x, h, MODEL, {mode}, GAIN * u)
        except (ValueError, OverflowError):  # sine of a value that is not finite
            return self.x._replace(theta1=nan, theta2=nan, omega1=nan, omega2=nan)

    def read(self, t):
        """Readings of the encoders of joints 0, 1 and 2 at device time t, s, rad; t must not decrease between calls."""
        at0 = max(read_at(t, MODEL)[0] - arm_delay(0.0, None, None), self.began)
        angle0 = self.angles(at0)[2]
        error0 = arm_encoder_error(angle0, t, self.run, MODEL.constants, None, None)
        return angle0 + error0, *super().read(t)

    def arm(self, x):
        """Angle and speed that the encoder of the arm reads."""
        return (x.motor_angle, x.motor_speed) if GEARED else (x.theta0, x.omega0)

    def state(self):
        """(6,) present state."""
        return np.array([*self.x[:6]])


def simulate(x0, t, inputs, max_step=1e-3, kind=ArmSwing):
    """(n, 6) states at the instants t, each of the (n,) inputs held until the next instant."""
    t = np.asarray(t, dtype=float).tolist()
    return states_at(x0, t, max_step, lambda now, _: (float(inputs[bisect(t, now) - 1]),), kind)


def readings(x0, t, run=0, max_step=1e-3, start=0.0, kind=ArmSwing, torques=lambda t, state: (0.0,)):
    """(n, 3) readings of the encoders of joints 0, 1 and 2 at device times t, rad; the state at `start`, s, is x0.

    torques(t, state): the input of the arm, constant during each step.
    """
    return readings_at(x0, t, run, max_step, start, kind, torques)


def derivative(x, u=0.0):
    """(6,) time derivative of a state (6,) with the input u; internal states are those at the release."""
    start, rig, torque = ArmSwing(x).x, MODEL, GAIN * u
    if GEARED:  # the motor is released in the middle of the backlash
        rig, torque, *_ = arm_of_gear(0.0, start, OF_ARM, torque)
    return np.array([*x[3:], *accelerations_at(0.0, start, 0.0, 0.0, rig, {mode}, torque)])


def step(x, u, h):
    """(6,) state after h, s, by the classical Runge-Kutta method; internal states are those at the release."""
    swing = ArmSwing(x)
    swing.step(h, u)
    return swing.state()
'''


def python_module(
    model: AnyModel,
    rig: Rig,
    more: Mapping[str, Any] = MappingProxyType({}),
    rewritten: Mapping[str, Rewrite] = MappingProxyType({}),
) -> str:
    """Generate a Python module with the corrected model.

    The module supports every effect of the library and needs only numpy.

    Args:
        model: the corrected model
        rig: rig of the model
        more: additional functions of dpr-lab, as for `sources`
        rewritten: transformations of functions, as for `sources`
    """
    if isinstance(model, MovingArmModel):
        return arm_module_text(model, rig, more, rewritten)
    effects = {name: values for name, values in model.effects.items() if name in OF_FREE_SWINGS}
    params = effect_params(known_effects(effects))
    constants = constants_of(model, rig)._replace(L1=model.rig.L1, g=model.rig.g)
    arm = arm_model(constants, HELD_ARM, params.tolist(), np.isin(list(EFFECTS), list(effects)))
    base = base_of(model)
    simulated = simulated_rig(base, constants, arm, effects)
    mode = FREE if simulated.required.arm else CLAMPED
    further = {"L2": constants.L2, "base": tuple(base._asdict()[name] for name in BASE)}
    return assembled(model, (_HEAD, _TAIL), simulated, effects, mode, more, rewritten, **further)


def arm_module_text(model: MovingArmModel, rig: Rig, more: Mapping[str, Any], rewritten: Mapping[str, Rewrite]) -> str:
    """Generate a Python module with a model of a moving arm.

    See `python_module` for the arguments.
    """
    model = model.with_arm_effects()
    sizes, outer = model.sizes, model.mounted == "both"
    effects = {name: values for name, values in model.effects.items() if EFFECTS[name].stage != "drive"}
    gain = 1.0 if model.input == "acceleration" else sizes["gain"] if model.input else 0.0
    constants = engine_constants(model, rig)._replace(L1=model.rig.L1, g=model.rig.g)
    constants = constants_of_run(constants, Setup("both" if outer else "inner"))
    arm = ArmModel(sizes["A"], sizes["L0"] / model.rig.g, sizes["c0"], 0.0)
    mode = DRIVEN if model.input == "acceleration" else FREE
    simulated = simulated_rig(base_of(model), constants, arm, effects)
    of_gear = {"GearedState": GearedState, "arm_of_gear": arm_of_gear, "stepped_with_gear": stepped_with_gear}
    more = {"with_arm": with_arm, **(of_gear if BACKLASH_JOINT0.name in effects else {}), **more}
    further = {"input": model.input, "values": sizes, "gain": gain, "outer": outer}
    return assembled(model, (_HEAD_OF_ARM, _TAIL_OF_ARM), simulated, effects, mode, more, rewritten, **further)
