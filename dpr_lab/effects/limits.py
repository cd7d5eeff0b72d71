"""Maximum sizes of effects, relative to the rig's gravity torques, inertias and lengths.

For example, the Coulomb friction of a swinging rod is less than its gravity torque. A larger fitted value therefore
indicates another cause. The limits depend only on the best known values of the rig file. They bound every fit and every
score test. One third of a limit is the standard deviation of the normal prior of an amplitude.
"""

import math
from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import EFFECTS, SIZE, named_params, param_index
from dpr_lab.effects.effect import ARM, Effect, EffectParameter
from dpr_lab.effects.quantities import BaseParameters, RigConstants
from dpr_lab.effects.rig_scales import LIMITS, RigScales, scales


def limit_words(parameter: EffectParameter) -> str:
    """Describe the limit of an amplitude."""
    if math.isfinite(parameter.most):
        return f"{parameter.most:.3g} {parameter.unit}".removesuffix(" 1")
    return LIMITS[parameter.limit or parameter.unit][0]


def _limit(effect: Effect, parameter: EffectParameter, at_joint: Mapping[int, RigScales]) -> float:
    rig = at_joint[effect.joints[0] if len(effect.joints) == 1 else 0]
    return parameter.most if math.isfinite(parameter.most) else LIMITS[parameter.limit or parameter.unit][1](rig)


@lru_cache(maxsize=8)  # cached, because every problem of a diagnosis has the prior of its rig file
def amplitude_limits(base: BaseParameters, constants: RigConstants) -> Array:
    """Return the (SIZE,) largest absolute amplitudes on a rig, in the units of the amplitudes.

    The values of shape parameters are inf.

    Args:
        base: base parameters of the whole rig from the rig file, SI
        constants: lengths, gravity and encoders
    """
    at_joint, limits = {joint: scales(base, constants, joint) for joint in (0, 1, ARM)}, np.full(SIZE, np.inf)
    for effect in EFFECTS.values():
        for parameter in effect.amplitudes:
            limits[param_index(effect.name, parameter.name)] = _limit(effect, parameter, at_joint)
    limits.setflags(write=False)  # all callers share this array
    return limits


def oversized(params: Array, limits: Array | None, *, share: float = 0.999) -> tuple[str, ...]:
    """Return the effects whose fitted sizes are at a limit, or cannot occur together.

    Another cause is then probable. Limits within the scale of the prior are exempt, because the equation defines them,
    such as the share 1 of a saturated drive.

    Args:
        params: (SIZE,) parameters of all effects
        limits: (SIZE,) maximum sizes; None: no limits
        share: fraction of a limit above which the limit counts as reached
    """
    reached = np.zeros(SIZE, dtype=bool) if limits is None else np.abs(params) >= share * limits
    return tuple(
        name
        for name, sizes in named_params(params).items()
        if any(
            reached[param_index(name, parameter.name)] and parameter.prior_scale < parameter.most
            for parameter in EFFECTS[name].amplitudes
        )
        or not EFFECTS[name].possible(sizes)
    )


def relative_size(params: Array, limits: Array, effect: str) -> float:
    """Return the rms of the amplitudes of one effect relative to their limits, dimensionless."""
    amplitudes = [param_index(effect, parameter.name) for parameter in EFFECTS[effect].amplitudes]
    return float(np.sqrt(np.mean((params[amplitudes] / limits[amplitudes]) ** 2)))
