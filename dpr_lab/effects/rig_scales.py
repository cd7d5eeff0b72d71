"""Reference values of a rig for the sizes of effects, and limits by unit."""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

from dpr_lab.effects.quantities import BaseParameters, RigConstants


class RigScales(NamedTuple):
    """Reference values of one joint, to which the sizes of effects are compared."""

    gravity: float
    """Largest gravity torque about the joint, N m."""
    inertia: float
    """Largest inertia about the joint, kg m^2."""
    length: float
    """Length of the rod beyond the joint, m."""
    mass: float
    """Mass at the end of the inner rod that would cause the gravity torque about joint 1, kg."""
    g: float
    """Gravity, m/s^2."""
    counts_per_rev: float
    """Counts per turn of the encoder with the finer resolution."""


def scales(base: BaseParameters, constants: RigConstants, joint: int) -> RigScales:
    """Return the reference values of one joint; `joint` is 0 for joint 1, 1 for joint 2, and -1 for the arm.

    The reference gravity torque of the arm is ten times that of joint 1.
    """
    inertia = base.b if joint == 1 else base.a + base.b + 2.0 * base.d
    return RigScales(
        gravity=base.e2 if joint == 1 else (base.e1 + base.e2) * (10.0 if joint < 0 else 1.0),
        inertia=inertia,
        length=constants.L2 if joint == 1 else constants.L1,
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
    "kg/m^2": ("inertia about the joint divided by length^4", lambda rig: rig.inertia / rig.length**4),
    "m": ("0.3 of the length of the rod", lambda rig: 0.3 * rig.length),
    "1/kg": ("10 divided by the mass of the rods", lambda rig: 10.0 / rig.mass),
    "m/s^2": ("gravity", lambda rig: rig.g),
    "s": ("0.25 sqrt(inertia / gravity torque) of the joint", lambda rig: 0.25 * math.sqrt(rig.inertia / rig.gravity)),
    "rad": ("0.5 rad", lambda rig: 0.5),
    "1": ("0.5", lambda rig: 0.5),
    "counts": ("one turn", lambda rig: rig.counts_per_rev),
}
"""Limits of amplitudes by unit, or by the `limit` of a parameter: each in words and as a function of the rig."""
