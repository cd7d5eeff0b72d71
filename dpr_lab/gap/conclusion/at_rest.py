"""Error of a zero reading caused by friction that holds a rod away from its equilibrium."""

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
"""Result of `held_angles` without dry friction: an empty mapping."""

READ_AT_REST = (
    (ENCODER_OFFSET_JOINT1.name, BASE_TILT.name, COM_OFFSET_LINK1.name),
    (ENCODER_OFFSET_JOINT2.name,),
)
"""Effects whose remedy or bench check uses the position of the inner and of the outer rod at rest."""


def held_angles(
    names: Iterable[str], whole: Array, sizes: Mapping[str, Params], setups: Iterable[Setup], rig: RigConstants
) -> dict[int, float]:
    """Return the largest angle from equilibrium, rad, at which dry friction can hold each rod.

    The sine of this angle is the largest friction torque at rest divided by the gravity torque of the rod. The angle is
    at most pi / 2. The friction of a free joint 2 also acts on the inner rod, as a reaction.

    Args:
        names: names of the probable effects, of which the dry friction laws count
        whole: (7,) base parameters of the complete rig
        sizes: fitted parameters of each effect
        setups: setups of the recordings
        rig: constants of the rig

    Returns:
        the angle by rod, 0 for the inner and 1 for the outer rod; a rod without dry friction is left out
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
    """Return a sentence on the error by friction, for an effect that is measured or corrected at rest.

    The text is empty for other effects, and without dry friction.

    Args:
        effect: name of the effect
        held: largest angle from equilibrium by rod, from `held_angles`
        fitted: whether the fitted value of the effect is an alternative to a reading
    """
    rod = next((rod for rod, names in enumerate(READ_AT_REST) if effect in names), None)
    if rod is None or rod not in held:
        return ""
    instead = ", or use the fitted value" if fitted else ""
    return (
        f" Friction can hold the {('inner', 'outer')[rod]} rod up to {1e3 * held[rod]:.2g} mrad from its equilibrium:"
        f" let it come to rest from both sides and use the mean of the two readings{instead}."
    )
