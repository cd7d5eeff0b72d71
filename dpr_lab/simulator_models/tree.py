"""Define the tree of parts and joints of a simulator model.

All values are in world coordinates with all joints at zero, in SI units.
"""

from dataclasses import dataclass, field
from typing import Literal

from scipy.spatial.transform import Rotation

from dpr_lab.arrays import Array

Vector = Array


@dataclass(frozen=True, slots=True)
class ModelJoint:
    """Joint that connects a part to its parent."""

    name: str
    kind: str
    """Kind of the joint: `hinge`, `slide`, `ball`, `free`, or the name of another kind in the format."""
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
    """Angle of the joint at which its spring is relaxed, rad."""
    limits: tuple[float, float] | None = None
    """Minimum and maximum angle of the joint, rad; None if there are no limits."""
    other: dict[str, str] = field(default_factory=dict)
    """Properties that a rig file cannot contain, with their numbers as text."""


@dataclass(frozen=True, slots=True)
class Part:
    """A rigid body."""

    name: str
    parent: int
    """Index of the parent part; -1 for the world."""
    joint: ModelJoint | None
    """Joint that connects the part to its parent; None if the part is fixed to the parent."""
    mass: float
    """Mass, kg."""
    centroid: Vector
    """(3,) centre of mass, m."""
    inertia: Vector
    """(3, 3) inertia about the centre of mass, kg m^2."""
    ends: tuple[Vector, ...] = ()
    """Points on the shapes of the part, m, from which the length of a rod is determined."""


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
    """Model that was read from a file."""

    name: str
    format: Literal["MJCF", "URDF", "SDFormat"]
    gravity: Vector | None
    """(3,) gravity, m/s^2; None if the format does not contain it."""
    parts: tuple[Part, ...]
    """Parts, each after its parent."""
    actuators: tuple[ModelActuator, ...] = ()
    notes: tuple[str, ...] = ()
    """Notes on elements that were not read, and on terms that a rig file cannot contain."""

    def moved_by(self, joint: str) -> Part:
        """Return the part that the first joint with this name moves."""
        return next(part for part in self.parts if part.joint is not None and part.joint.name == joint)


def follows(joint: str, factor: float, offset: float) -> dict[str, str]:
    """Return the entry of `ModelJoint.other` for a joint that mimics another joint."""
    plus = f" + {offset:g}" if offset else ""
    return {"follows another joint (mimic), which is not in the rig file:": f"{factor:g} x {joint!r}{plus}"}


def frame(roll: float, pitch: float, yaw: float) -> Vector:
    """Compute the (3, 3) rotation from roll, pitch and yaw angles, rad.

    The rotations about the fixed axes x, y, z are applied in this order.
    """
    return Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
