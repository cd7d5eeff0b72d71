"""Adapt the effects of a rig to the mounting of a run.

A held joint 2 is modelled by Coulomb friction with a very large limit. The effects of the arm are set to zero if it is
clamped, and those of the drives if no drive acts.
"""

from collections.abc import Callable, Sequence

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.effects import EFFECTS, param_index
from dpr_lab.effects.coulomb import COULOMB
from dpr_lab.effects.effect import Effect, JointIndex
from dpr_lab.setup import Setup

UNYIELDING_NM = 1e6
"""Torque that suffices to hold a joint of any rig, N m."""

_STAGES_OF_JOINT2 = ("torque", "load", "play", "drive")


def _amplitudes_of(selected: Callable[[Effect], bool]) -> Integers:
    """Return the indices of the amplitudes of the selected effects."""
    effects = filter(selected, EFFECTS.values())
    return np.array([param_index(effect.name, parameter.name) for effect in effects for parameter in effect.amplitudes])


_HOLDS = param_index(COULOMB[1].name, COULOMB[1].amplitudes[0].name)
_OF_JOINT2 = _amplitudes_of(lambda effect: effect.joints == (JointIndex().outer,) and effect.stage in _STAGES_OF_JOINT2)
_OF_DRIVES = _amplitudes_of(lambda effect: effect.driven)
_OF_ARM = _amplitudes_of(lambda effect: effect.of_arm)


def differ(params: Array, setups: Sequence[Setup]) -> bool:
    """Return whether the mounting of any run changes the effect parameters (..., SIZE) of the rig."""
    return any(setup.held or _undriven(params, setup) or _still(params, setup) for setup in setups)


def _undriven(params: Array, setup: Setup) -> bool:
    return setup.torques is None and bool(params[..., _OF_DRIVES].any())


def _still(params: Array, setup: Setup) -> bool:
    return not setup.arm_moves and bool(params[..., _OF_ARM].any())


def effects_of_run(params: Array, setup: Setup) -> Array:
    """Convert the effect parameters (..., SIZE) of a rig to those in the mounting of a run."""
    undriven, still = _undriven(params, setup), _still(params, setup)
    if not (setup.held or undriven or still):
        return params
    params = params.copy()
    if still:
        params[..., _OF_ARM] = 0.0
    if undriven:
        params[..., _OF_DRIVES] = 0.0
    if not setup.held:
        return params
    if setup.alone:
        params[..., _OF_JOINT2] = 0.0
    params[..., _HOLDS] = UNYIELDING_NM
    return params
