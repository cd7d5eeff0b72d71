"""The rig as rigid bodies on hinges, in the words of every format."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Words

THIN = 1e-12
"""Inertia of a thin rod about its own axis, kg m^2, because simulators require a positive value."""


@dataclass(frozen=True, slots=True)
class Rod:
    """A rod in its own frame: joint at the origin, z along the rod, rotation about y; SI."""

    length: float
    mass: float
    centroid: float
    """Distance of the centre of mass along the rod."""
    offset: float
    """Distance of the centre of mass across the rod, along x."""
    inertia: float
    """Inertia about its centre of mass."""
    damping: float
    """Viscous friction of its joint."""
    words: Words
    """Additional elements of its joint."""


@dataclass(frozen=True, slots=True)
class Arm:
    """An arm that turns about the vertical: compliant, free or driven; SI."""

    length: float
    """Distance of the rods' plane from its axis."""
    inertia: float
    """Inertia without the rods."""
    damping: float
    """Viscous friction, with the back-EMF of a voltage drive."""
    words: Words
    """Additional elements of its joint."""
    input: str = ""
    """Kind of the input that drives it; empty without a drive."""
    gain: float = 0.0
    """Torque per input, N m over the unit of the input."""


@dataclass(frozen=True, slots=True)
class Bodies:
    """Bodies of the rig: both rods, the parts at joint 2, and gravity."""

    rods: tuple[Rod, ...]
    """The inner rod, and the outer one if it is mounted."""
    tip_mass: float
    """Mass of the encoder at joint 2, kg."""
    gravity: float
    tilt: float
    arm: Arm | None


def words_of_joint(expressed: Mapping[str, Words], joint: int) -> dict[str, Any]:
    """Elements of the effects of one joint (0 or 1, -1 for the arm); no two effects may use the same element."""
    of_joint: dict[str, Any] = {}
    for name, words in expressed.items():
        if EFFECTS[name].joints == (joint,):
            of_joint |= words
    return of_joint


def rod_about_joint(
    length: float, mass: float, moment: float, about_joint: float, damping: float, felt: float, words: Words
) -> Rod:
    """A rod from its first moment, kg m, and its inertia about its joint without the offset of the centre, kg m^2.

    `felt` is the mass to which an offset of the centre of mass refers, kg.
    """
    offset = felt * words.get("offset", 0.0) / mass
    inertia = about_joint + felt * words.get("offset", 0.0) ** 2
    centroid = moment / mass
    return Rod(length, mass, centroid, offset, inertia - mass * (centroid**2 + offset**2), damping, words)
