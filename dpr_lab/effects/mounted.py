"""Adapt the effects of a rig to the mounting of a run.

Joint 2, the arm or the drives may not move. A held joint 2 is modelled by Coulomb friction with a very large limit.
Effects of the arm are switched off if it is clamped, and effects of drives if no drive acts.
"""

from collections.abc import Sequence

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import EFFECTS, param_index
from dpr_lab.effects.coulomb import COULOMB
from dpr_lab.setup import Setup

UNYIELDING_NM = 1e6
"""Torque that suffices to hold a joint of any rig, N m."""

_HOLDS = param_index(COULOMB[1].name, COULOMB[1].amplitudes[0].name)
_OF_JOINT2 = np.array(
    [
        param_index(effect.name, parameter.name)
        for effect in EFFECTS.values()
        if effect.joints == (1,) and effect.stage in ("torque", "load", "play", "drive")
        for parameter in effect.amplitudes
    ]
)

_OF_DRIVES = np.array(
    [
        param_index(effect.name, parameter.name)
        for effect in EFFECTS.values()
        if effect.driven
        for parameter in effect.amplitudes
    ]
)

_OF_ARM = np.array(
    [
        param_index(effect.name, parameter.name)
        for effect in EFFECTS.values()
        if effect.of_arm
        for parameter in effect.amplitudes
    ]
)


def differ(params: Array, setups: Sequence[Setup]) -> bool:
    """Return whether the mounting of any run changes the effects (..., SIZE) of the rig."""
    return any(setup.held or _undriven(params, setup) or _still(params, setup) for setup in setups)


def _undriven(params: Array, setup: Setup) -> bool:
    return setup.torques is None and bool(params[..., _OF_DRIVES].any())


def _still(params: Array, setup: Setup) -> bool:
    return not setup.arm_moves and bool(params[..., _OF_ARM].any())


def effects_of_run(params: Array, setup: Setup) -> Array:
    """Convert the effects (..., SIZE) of a rig to the effects in the mounting of a run."""
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
