"""Define rigid bodies on hinges that represent the rig in all export formats."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Words

Vector = tuple[float, float, float]

THIN = 1e-12
"""Inertia of a thin rod about its own axis, kg m^2. It is positive, because simulators require positive inertias."""


@dataclass(frozen=True, slots=True)
class Rod:
    """A rod in its own frame, SI units.

    The joint is at the origin, z points along the rod, and the rod rotates about y.
    """

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

    @property
    def centre(self) -> Vector:
        """Centre of mass in the frame of the rod, m."""
        return self.offset, 0.0, self.centroid

    @property
    def end(self) -> Vector:
        """Position (3,) of the next joint in the frame of the rod, m."""
        return 0.0, 0.0, self.length

    @property
    def moments(self) -> Vector:
        """Inertia about the axes through the centre of mass, kg m^2."""
        return self.inertia, self.inertia, THIN

    def with_mass_at_end(self, mass: float) -> "Rod":
        """Combine the rod with a mass, kg, that is fixed to its end."""
        total = self.mass + mass
        offset, centroid = self.mass * self.offset / total, (self.mass * self.centroid + mass * self.length) / total
        masses = [(self.mass, self.offset, self.centroid), (mass, 0.0, self.length)]
        inertia = self.inertia + sum(m * ((x - offset) ** 2 + (z - centroid) ** 2) for m, x, z in masses)
        return replace(self, mass=total, centroid=centroid, offset=offset, inertia=inertia)


@dataclass(frozen=True, slots=True)
class Arm:
    """Compliant, free or driven arm that turns about the vertical axis, SI units."""

    length: float
    """Distance of the rods' plane from the axis of the arm, m."""
    inertia: float
    """Inertia about the axis without the rods, kg m^2."""
    damping: float
    """Viscous friction including the back-EMF of a voltage drive, N m s/rad."""
    words: Words
    """Elements of effects at the joint."""
    input: str = ""
    """Kind of the input of the drive; empty if there is no drive."""
    gain: float = 0.0
    """Torque per input, N m over the unit of the input."""
    mass: float = 1e-9
    """Mass, kg. Only the inertia has an influence, but simulators require a positive mass."""
    centre: Vector = (0.0, 0.0, 0.0)
    """Centre of mass, m."""

    @property
    def end(self) -> Vector:
        """Position (3,) of the inner rod's joint in the frame of the arm, m."""
        return 0.0, -self.length, 0.0

    @property
    def moments(self) -> Vector:
        """Inertia about the axes, kg m^2."""
        return self.inertia, self.inertia, self.inertia


@dataclass(frozen=True, slots=True)
class Link:
    """A moving body and the hinge on which it turns."""

    joint: int
    """Number of the joint: 0 for the arm, 1 and 2 for the rods."""
    name: str
    parent: str
    """Name of the body that carries the hinge; empty for the base."""
    place: Vector
    """(3,) position of the hinge in the frame of the parent, m."""
    body: Rod | Arm

    @property
    def axis(self) -> str:
        """Axis of the hinge in the parent frame: vertical for the arm, otherwise horizontal."""
        return "0 1 0" if self.joint else "0 0 1"

    @property
    def hanging(self) -> float:
        """Hinge angle of hanging rods, rad.

        0 is upright; joint 2 is relative to the inner rod.
        """
        return math.pi if self.joint == 1 else 0.0


@dataclass(frozen=True, slots=True)
class Bodies:
    """Bodies of the rig: rods, parts at joint 2, and arm; and gravity."""

    rods: tuple[Rod, ...]
    """The inner rod, and the outer rod if it is mounted."""
    tip_mass: float
    """Mass of the parts at joint 2, kg."""
    gravity: float
    tilt: float
    arm: Arm | None

    @property
    def pull(self) -> Vector:
        """Gravity in the frame of the base, m/s^2."""
        return self.gravity * math.sin(self.tilt), 0.0, -self.gravity * math.cos(self.tilt)

    @property
    def links(self) -> list[Link]:
        """Moving bodies from the base to the tip."""
        bodies = {0: ("arm", self.arm)} if self.arm else {}
        bodies |= dict(enumerate(zip(("inner", "outer"), self.rods, strict=False), 1))
        links, parent, place = [], "", (0.0, 0.0, 0.0)
        for joint, (name, body) in bodies.items():
            links.append(Link(joint, name, parent, place, body))
            parent, place = name, body.end
        return links


def words_of_joint(expressed: Mapping[str, Words], joint: int) -> dict[str, Any]:
    """Return the simulator elements of the effects at a joint: 0 and 1 for the rods, -1 for the arm.

    Two effects of one joint must not use the same element.
    """
    of_joint: dict[str, Any] = {}
    for name, words in expressed.items():
        if EFFECTS[name].joints == (joint,):
            of_joint |= words
    return of_joint


def added_length(expressed: Mapping[str, Words]) -> float:
    """Return the length that effects add to the inner rod, m."""
    return sum(words.get("added_length", 0.0) for words in expressed.values())


def least_mass(moment: float, about_joint: float, margin: float = 1.05) -> float:
    """Return the minimum mass of a rod with the given first moment and inertia about its joint, times a margin."""
    return margin * moment**2 / about_joint


def rod_about_joint(
    length: float, mass: float, moment: float, about_joint: float, damping: float, offset_mass: float, words: Words
) -> Rod:
    """Construct a rod from its first moment and its inertia about the joint.

    Both are given without the offset of the centre of mass in `words`, which is then added.

    Args:
        length: length of the rod, m
        mass: mass of the rod, kg
        moment: first moment about the joint, kg m
        about_joint: moment of inertia about the joint, kg m^2
        damping: viscous friction of the joint, N m s/rad
        offset_mass: mass to which the offset of the centre of mass refers, kg
        words: simulator elements of the effects at this joint
    """
    offset = offset_mass * words.get("offset", 0.0) / mass
    inertia = about_joint + offset_mass * words.get("offset", 0.0) ** 2
    centroid = moment / mass
    return Rod(length, mass, centroid, offset, inertia - mass * (centroid**2 + offset**2), damping, words)
