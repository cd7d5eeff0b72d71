"""Errors of readings at rest due to friction that holds a rod away from its equilibrium."""

import cmath
import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import BASE, base_of_run
from dpr_lab.effects.base_tilt import BASE_TILT
from dpr_lab.effects.com_offset import COM_OFFSET_LINK1
from dpr_lab.effects.coulomb import COULOMB
from dpr_lab.effects.effect import Params
from dpr_lab.effects.encoder_offset import ENCODER_OFFSET_JOINT1, ENCODER_OFFSET_JOINT2
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.effects.stribeck import STRIBECK
from dpr_lab.setup import Setup

NOT_HELD: Mapping[int, float] = MappingProxyType({})
"""Angles at rest without dry friction."""

READ_AT_REST = (
    (ENCODER_OFFSET_JOINT1.name, BASE_TILT.name, COM_OFFSET_LINK1.name),
    (ENCODER_OFFSET_JOINT2.name,),
)
"""Effects whose remedy or bench check uses the position of the inner and of the outer rod at rest."""


def held_angles(
    names: Iterable[str], whole: Array, sizes: Mapping[str, Params], setups: Iterable[Setup], rig: RigConstants
) -> dict[int, float]:
    """Return the largest angle from equilibrium, rad, at which named dry friction holds each rod, by rod.

    The sine of this angle is the largest friction torque at rest divided by the gravity torque of the rod. The angle is
    at most pi / 2. The friction of a free joint 2 also acts on the inner rod, as a reaction.

    `names` are those of the probable effects, `whole` (7,) the base parameters of the rig.
    """
    friction = [0.0, 0.0]
    for name in names:
        for rod, laws in enumerate(zip(COULOMB, STRIBECK, strict=True)):
            if name in [law.name for law in laws]:
                friction[rod] += sizes[name]["torque_Nm"] + sizes[name].get("extra_at_rest_Nm", 0.0)
    held: dict[int, float] = {}
    for setup in set(setups):
        base = dict(zip(BASE, base_of_run(whole, setup, rig.L1, rig.g).tolist(), strict=True))
        torques, at_joints = [base["e1"], base["d"] * rig.g / rig.L1], friction
        if setup.mounting == "both":
            at_joints = [sum(friction), friction[1]]
        if setup.mounting == "clamped":  # both rods are one body
            torques = [abs(torques[0] + cmath.rect(torques[1], setup.elbow))]
        for rod, gravity in enumerate(torques):
            if at_joints[rod] > 0.0 and gravity > 0.0:
                held[rod] = max(held.get(rod, 0.0), math.asin(min(at_joints[rod] / gravity, 1.0)))
    return held


def at_rest(effect: str, held: Mapping[int, float], *, fitted: bool = False) -> str:
    """Return a sentence on friction for an effect that is read or corrected at rest; otherwise an empty text."""
    rod = next((rod for rod, names in enumerate(READ_AT_REST) if effect in names), None)
    if rod is None or rod not in held:
        return ""
    instead = ", or use the fitted value" if fitted else ""
    return (
        f" Friction holds the {('inner', 'outer')[rod]} rod at rest up to {1e3 * held[rod]:.2g} mrad from"
        f" equilibrium: let it come to rest from both sides and take the mean{instead}."
    )
