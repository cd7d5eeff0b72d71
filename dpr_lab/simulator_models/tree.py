"""Model of a simulator as parts on joints, all in world coordinates with every joint at zero; SI."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from dpr_lab.arrays import Array

Vector = Array


@dataclass(frozen=True, slots=True)
class ModelJoint:
    """Joint between a part and its parent."""

    name: str
    kind: str
    """`hinge`, `slide`, `ball`, `free`, or another type by its name in the format."""
    axis: Vector
    """(3,) unit vector of the axis."""
    anchor: Vector
    """(3,) a point of the axis, m."""
    damping: float = 0.0
    """Viscous friction, N m s/rad."""
    friction: float = 0.0
    """Coulomb friction, N m."""
    armature: float = 0.0
    """Rotor inertia (armature), kg m^2."""
    stiffness: float = 0.0
    """Spring stiffness, N m/rad."""
    rest: float = 0.0
    """Joint angle with the spring relaxed, rad."""
    limits: tuple[float, float] | None = None
    """Smallest and largest joint angle, rad; None without limits."""
    other: dict[str, str] = field(default_factory=dict)
    """Terms that a rig file cannot contain -> their numbers."""


@dataclass(frozen=True, slots=True)
class Part:
    """A rigid body."""

    name: str
    parent: int
    """Index of its parent; -1: the world."""
    joint: ModelJoint | None
    """Joint to its parent; None: fixed."""
    mass: float
    """Mass, kg."""
    centroid: Vector
    """(3,) centre of mass, m."""
    inertia: Vector
    """(3, 3) inertia about the centre of mass, kg m^2."""
    ends: tuple[Vector, ...] = ()
    """Points of its shapes, m, which determine the length of a rod."""


@dataclass(frozen=True, slots=True)
class ModelActuator:
    """Actuator of a joint."""

    name: str
    joint: str
    kind: str
    """Kind of the actuator in the format."""
    gear: float = 1.0


@dataclass(frozen=True, slots=True)
class SimulatorModel:
    """A model from a file."""

    name: str
    format: Literal["MJCF", "URDF", "SDFormat"]
    gravity: Vector | None
    """(3,) gravity, m/s^2; None: not in the format."""
    parts: tuple[Part, ...]
    """Parts, parents first."""
    actuators: tuple[ModelActuator, ...] = ()
    notes: tuple[str, ...] = ()
    """Notes on elements that were not read, and on terms that a rig file cannot contain."""


def follows(joint: str, factor: float, offset: float) -> dict[str, str]:
    """Term of a joint that mimics another one, for `ModelJoint.other`."""
    plus = f" + {offset:g}" if offset else ""
    return {"follows another joint (mimic), which is not in the rig file:": f"{factor:g} x {joint!r}{plus}"}


def frame(roll: float, pitch: float, yaw: float) -> Vector:
    """(3, 3) rotation about the fixed axes x, y, z in this order, rad."""
    (a, b), (c, d), (e, f) = ((np.cos(angle), np.sin(angle)) for angle in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, a, -b], [0, b, a]])
    about_y = np.array([[c, 0, d], [0, 1, 0], [-d, 0, c]])
    about_z = np.array([[e, -f, 0], [f, e, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x
