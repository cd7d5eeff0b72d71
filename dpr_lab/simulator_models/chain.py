"""Types for the rods of a model: inner rod, outer rod, and optionally an arm.

The axis of the arm is vertical. An arm may carry a single rod. theta_i is the angle of rod i from upright, about
the axis of joint 1 (docs/theory.md). The inner rod points from joint 1 to joint 2. The last rod points from its joint
to its centre of mass.
"""

import math
from dataclasses import dataclass

from dpr_lab.simulator_models.tree import ModelJoint, Vector


@dataclass(frozen=True, slots=True)
class ChainLimits:
    """Default gravity, and tolerances for parallel axes and for parts fixed to the elbow."""

    gravity: float = 9.81
    """Gravity of a model that contains none, m/s^2."""
    parallel: float = math.radians(10.0)
    """Maximum angle between axes that are treated as parallel, rad. A model with a larger angle is refused."""
    noticed: float = math.radians(0.01)
    """Maximum angle between axes treated as parallel for which no note is given, rad."""
    elbow: float = 1e-3
    """Maximum distance from the axis of joint 2 to the centre of mass of a part that belongs to mb, relative to L1."""
    offset: float = 1e-7
    """Maximum distance of the centre of mass from the axis of the inner rod for which no note is given, m."""


CHAIN = ChainLimits()


@dataclass(frozen=True, slots=True)
class JointTerm:
    """Property of a model joint that no key of a rig file can contain."""

    joint: str
    quantity: str
    value: float
    unit: str

    def __str__(self) -> str:
        return f"{self.joint}: {self.quantity} {self.value:.6g} {self.unit}".rstrip()


@dataclass(frozen=True, slots=True)
class ChainRod:
    """A rod and its joint, in SI units."""

    joint: ModelJoint
    mass: float
    centroid: float
    """Distance of the centre of mass from the joint along the rod, m."""
    inertia: float
    """Inertia about the centre of mass, kg m^2."""
    length: float | None
    """Length, m; None if no shape determines it."""
    hanging: float
    """Angle of the joint in the model when the rods hang, rad."""
    direction: int
    """-1 if the angle of the joint in the model decreases while theta increases."""
    along: Vector
    """(3,) unit vector along the rod with all joints at zero."""
    offset: float = 0.0
    """Distance of the centre of mass from the axis of the rod, m."""
    gear: float | None = None
    """Gear ratio of the only motor on its joint; None if there is no motor, or if other actuators act on the joint."""


@dataclass(frozen=True, slots=True)
class ChainArm:
    """The arm and its joint, in SI units."""

    joint: ModelJoint
    length: float
    inertia: float
    """Inertia of arm and rotor about the axis of the arm, without the rods, kg m^2."""
    direction: int
    """-1 if the angle of the joint in the model decreases while theta0 increases."""
    hanging: float = 0.0
    """Angle of the joint in the model at theta0 = 0, rad."""
    gear: float | None = None
    """Gear ratio of the only motor on its joint; None if there is no motor, or if other actuators act on the joint."""


@dataclass(frozen=True, slots=True)
class ModelChain:
    """The rods of a model, and the arm if the model has one."""

    rods: tuple[ChainRod, ...]
    """Inner and outer rod. A model with an arm may have a single rod."""
    elbow_mass: float
    """Mass of the parts on the axis of joint 2 that are fixed to the inner rod, kg."""
    gravity: float
    """Gravity in the plane of the swing, m/s^2."""
    axis: Vector
    """(3,) unit vector of the axis about which theta is positive."""
    arm: ChainArm | None
    terms: tuple[JointTerm, ...]
    """Properties of the joints that no key of a rig file can contain."""
    notes: tuple[str, ...]
    """Notes on parts of the model that the rig file cannot contain."""

    @property
    def parts(self) -> tuple[ChainRod | ChainArm, ...]:
        """The rods, then the arm if there is one."""
        return (*self.rods, *((self.arm,) if self.arm else ()))

    @property
    def parameters(self) -> dict[str, float]:
        """Parameters of the rods by their names in the rig file, SI units."""
        values = {"mb": self.elbow_mass} if len(self.rods) == 2 else {}
        for i, rod in enumerate(self.rods, 1):
            values |= {f"l{i}": rod.centroid, f"m{i}": rod.mass, f"c{i}": rod.joint.damping, f"J{i}": rod.inertia}
        return values
