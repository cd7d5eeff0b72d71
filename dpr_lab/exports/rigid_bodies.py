"""The rig as rigid bodies on hinges, independent of the format."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Words

THIN = 1e-12
"""Inertia of a thin rod about its own axis, kg m^2. It is positive, because simulators require this."""


@dataclass(frozen=True, slots=True)
class Rod:
    """A rod in its own frame, SI units: joint at the origin, z along the rod, rotation about y."""

    length: float
    mass: float
    centroid: float
    """Distance of the centre of mass from the joint along the rod, m."""
    offset: float
    """Distance of the centre of mass from the axis of the rod, along x, m."""
    inertia: float
    """Inertia about the centre of mass, kg m^2."""
    damping: float
    """Viscous friction of the joint, N m s/rad."""
    words: Words
    """Elements of effects at the joint."""


@dataclass(frozen=True, slots=True)
class Arm:
    """An arm that turns about the vertical axis: compliant, free or driven; SI units."""

    length: float
    """Distance of the rods' plane from the axis of the arm, m."""
    inertia: float
    """Inertia about the axis without the rods, kg m^2."""
    damping: float
    """Viscous friction including the back-EMF of a voltage drive, N m s/rad."""
    words: Words
    """Elements of effects at the joint."""
    input: str = ""
    """Kind of the input of the drive; empty without a drive."""
    gain: float = 0.0
    """Torque per input, N m over the unit of the input."""


@dataclass(frozen=True, slots=True)
class Bodies:
    """Bodies of the rig: rods, parts at joint 2, and arm, with gravity."""

    rods: tuple[Rod, ...]
    """The inner rod, and the outer one if it is mounted."""
    tip_mass: float
    """Mass of the encoder at joint 2, kg."""
    gravity: float
    tilt: float
    arm: Arm | None


def words_of_joint(expressed: Mapping[str, Words], joint: int) -> dict[str, Any]:
    """Elements of the effects of one joint (0, 1, or -1 for the arm).

    No two effects may use the same element.
    """
    of_joint: dict[str, Any] = {}
    for name, words in expressed.items():
        if EFFECTS[name].joints == (joint,):
            of_joint |= words
    return of_joint


def rod_about_joint(
    length: float, mass: float, moment: float, about_joint: float, damping: float, felt: float, words: Words
) -> Rod:
    """Rod with a given first moment, kg m, and inertia about its joint, kg m^2, before its centre of mass is offset.

    `felt` is the mass, kg, to which the offset of the centre of mass refers.
    """
    offset = felt * words.get("offset", 0.0) / mass
    inertia = about_joint + felt * words.get("offset", 0.0) ** 2
    centroid = moment / mass
    return Rod(length, mass, centroid, offset, inertia - mass * (centroid**2 + offset**2), damping, words)
