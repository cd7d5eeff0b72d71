"""Largest sizes of effects on a rig: relative to its gravity torques, inertias, lengths and encoders.

A rod that swings has, for instance, less dry friction than its gravity torque. A larger fitted size has another cause.
The limits follow from the rig file's best known values alone. They bound every fit and every score test, and a third of
a limit is the standard deviation of a normal prior of the size.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import EFFECTS, SIZE, param_index
from dpr_lab.effects.effect import Effect, EffectParameter
from dpr_lab.effects.quantities import BaseParameters, RigConstants


class RigScales(NamedTuple):
    """What sizes at one joint are compared with."""

    gravity: float
    """Largest gravity torque about the joint, N m."""
    inertia: float
    """Largest inertia about the joint, kg m^2."""
    length: float
    """Length of the rod beyond the joint, m."""
    mass: float
    """Mass with the inner rod's length that would cause the gravity torque about joint 1, kg."""
    g: float
    """Gravity, m/s^2."""
    counts_per_rev: float
    """Counts of the finer encoder per turn."""


def scales(base: BaseParameters, constants: RigConstants, joint: int) -> RigScales:
    """The scales of a rig at joint 0 or 1."""
    inertia = base.b if joint else base.a + base.b + 2.0 * base.d
    return RigScales(
        gravity=base.e2 if joint else base.e1 + base.e2,
        inertia=inertia,
        length=constants.L2 if joint else constants.L1,
        mass=(base.e1 + base.e2) / (constants.g * constants.L1),
        g=constants.g,
        counts_per_rev=max(abs(constants.counts_per_rev1), abs(constants.counts_per_rev2)),
    )


def _critical_damping(rig: RigScales) -> float:
    return 2.0 * math.sqrt(rig.gravity * rig.inertia)


LIMITS: Mapping[str, tuple[str, Callable[[RigScales], float]]] = {
    "N m": ("gravity torque about the joint", lambda rig: rig.gravity),
    "N m/rad": ("3 times the gravity torque about the joint per radian", lambda rig: 3.0 * rig.gravity),
    "N m/rad^3": ("3 times the gravity torque about the joint per cubic radian", lambda rig: 3.0 * rig.gravity),
    "N m s/rad": ("critical damping of the joint", _critical_damping),
    "damping per second": ("critical damping of the joint within 1 s", _critical_damping),
    "kg m^2": ("3 times the inertia about the joint", lambda rig: 3.0 * rig.inertia),
    "kg/m^2": ("inertia about the joint over length^4", lambda rig: rig.inertia / rig.length**4),
    "m": ("0.3 of the length of the rod", lambda rig: 0.3 * rig.length),
    "1/kg": ("10 over the mass of the rods", lambda rig: 10.0 / rig.mass),
    "m/s^2": ("gravity", lambda rig: rig.g),
    "s": ("a quarter of the radian time of the joint", lambda rig: 0.25 * math.sqrt(rig.inertia / rig.gravity)),
    "rad": ("0.5 rad", lambda rig: 0.5),
    "1": ("0.5", lambda rig: 0.5),
    "counts": ("one turn", lambda rig: rig.counts_per_rev),
}
"""Unit of an amplitude, or its own `limit` -> the limit in words, and as a function of the rig."""


def limit_words(parameter: EffectParameter) -> str:
    """The limit of an amplitude in words."""
    if math.isfinite(parameter.most):
        return f"{parameter.most:.3g} {parameter.unit}".removesuffix(" 1")
    return LIMITS[parameter.limit or parameter.unit][0]


def _limit(effect: Effect, parameter: EffectParameter, at_joint: tuple[RigScales, RigScales]) -> float:
    rig = at_joint[1 if effect.joints == (1,) else 0]
    return parameter.most if math.isfinite(parameter.most) else LIMITS[parameter.limit or parameter.unit][1](rig)


def amplitude_limits(base: BaseParameters, constants: RigConstants) -> NDArray[np.float64]:
    """(SIZE,) largest size of each amplitude on a rig, in its own unit; inf for shape parameters.

    Args:
        base: base parameters of the whole rig by the rig file, SI
        constants: lengths, gravity and encoders
    """
    at_joint, limits = (scales(base, constants, 0), scales(base, constants, 1)), np.full(SIZE, np.inf)
    for effect in EFFECTS.values():
        for parameter in effect.amplitudes:
            limits[param_index(effect.name, parameter.name)] = _limit(effect, parameter, at_joint)
    return limits


def at_limit(params: NDArray[np.float64], limits: NDArray[np.float64], *, share: float = 0.999) -> tuple[str, ...]:
    """Effects with an amplitude at a share of its limit or more: their cause has the same shape and is another."""
    reached = np.abs(params) >= share * limits
    return tuple(
        name
        for name, effect in EFFECTS.items()
        if any(reached[param_index(name, parameter.name)] for parameter in effect.amplitudes)
    )
