"""What effects become where joint 2 cannot turn: it is held by dry friction without a limit."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import EFFECTS, param_index
from dpr_lab.effects.coulomb import COULOMB
from dpr_lab.setup import Setup

UNYIELDING_NM = 1e6
"""Torque that holds a joint against whatever swings on a bench, N m."""

_HOLDS = param_index(COULOMB[1].name, COULOMB[1].amplitudes[0].name)
_OF_JOINT2 = [
    param_index(effect.name, parameter.name)
    for effect in EFFECTS.values()
    if effect.joints == (1,) and effect.stage in ("torque", "load", "play")
    for parameter in effect.amplitudes
]


def effects_of_run(params: NDArray[np.float64], setup: Setup) -> NDArray[np.float64]:
    """(..., SIZE) effects on what hung on the rig during a run, from those on the whole rig."""
    if not setup.held:
        return params
    params = params.copy()
    if setup.alone:
        params[..., _OF_JOINT2] = 0.0
    params[..., _HOLDS] = UNYIELDING_NM
    return params
