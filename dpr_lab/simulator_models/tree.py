"""The model of a simulator as parts on joints, all of them in world coordinates at the zero of every joint; SI."""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ModelJoint:
    """Joint between a part and its parent."""

    name: str
    kind: Literal["hinge", "slide", "ball", "free", "other"]
    axis: Vector
    """(3,) unit vector."""
    anchor: Vector
    """(3,) a point of the axis, m."""
    damping: float = 0.0
    """N m s/rad"""
    friction: float = 0.0
    """Coulomb friction, N m."""
    armature: float = 0.0
    """kg m^2"""
    stiffness: float = 0.0
    """N m/rad"""
    rest: float = 0.0
    """ModelJoint angle at which the spring is slack, rad."""
    limits: tuple[float, float] | None = None
    """Smallest and largest joint angle, rad; None without a stop."""
    other: dict[str, str] = field(default_factory=dict)
    """What no rig file holds: what it is -> its numbers."""


@dataclass(frozen=True, slots=True)
class Part:
    """A rigid body."""

    name: str
    parent: int
    """Index of the part that carries it; -1: the world."""
    joint: ModelJoint | None
    """None: fixed to its parent."""
    mass: float
    """kg"""
    centroid: Vector
    """(3,) m"""
    inertia: Vector
    """(3, 3) about the centroid, kg m^2."""
    ends: tuple[Vector, ...] = ()
    """Points of its shapes, m: they give the length of a rod."""


@dataclass(frozen=True, slots=True)
class ModelActuator:
    """Actuator of a joint."""

    name: str
    joint: str
    kind: str
    """As the format calls it."""
    gear: float = 1.0


@dataclass(frozen=True, slots=True)
class SimulatorModel:
    """A model as its file has it."""

    name: str
    format: Literal["MJCF", "URDF", "SDFormat"]
    gravity: Vector | None
    """(3,) m/s^2; None: the format does not hold it."""
    parts: tuple[Part, ...]
    """Parents first."""
    actuators: tuple[ModelActuator, ...] = ()
    notes: tuple[str, ...] = ()
    """What was not read, and what no rig file holds."""


def frame(roll: float, pitch: float, yaw: float) -> Vector:
    """(3, 3) rotation about the fixed axes x, y, z in this order, rad."""
    (a, b), (c, d), (e, f) = ((np.cos(angle), np.sin(angle)) for angle in (roll, pitch, yaw))
    about_x = np.array([[1, 0, 0], [0, a, -b], [0, b, a]])
    about_y = np.array([[c, 0, d], [0, 1, 0], [-d, 0, c]])
    about_z = np.array([[e, -f, 0], [f, e, 0], [0, 0, 1]])
    return about_z @ about_y @ about_x
