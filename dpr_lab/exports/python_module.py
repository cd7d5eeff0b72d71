"""Export the corrected model as a plain Python module that needs only numpy.

The module contains the functions with which dpr-lab itself simulates (`dpr_lab.exports.source`), reduced to the named
effects.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from dpr_lab.dynamics.arm import CLAMPED, FREE
from dpr_lab.dynamics.base import BASE
from dpr_lab.effects import EFFECTS, OF_FREE_SWINGS, effect_params
from dpr_lab.effects.effect_kernels import arm_model
from dpr_lab.effects.quantities import HELD_ARM
from dpr_lab.exports.module_parts import assembled, base_of, constants_of, known_effects, simulated_rig
from dpr_lab.exports.moving_arm.python_module import arm_module_text
from dpr_lab.exports.source import Rewrite
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.rig import Rig

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

_CLAMPED = '''
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


def python_module(
    model: Model | MovingArmModel,
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
    return assembled(model, (_HEAD, _CLAMPED), simulated, effects, mode, more, rewritten, **further)
