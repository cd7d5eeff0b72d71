"""Combine the parts of a model to the rods and the arm of a double pendulum."""

import math
from collections.abc import Sequence

import numpy as np

from dpr_lab.errors import ConfigError
from dpr_lab.simulator_models.chain import CHAIN, ChainArm, ChainRod
from dpr_lab.simulator_models.joint_choice import carrier, refuse_tilted
from dpr_lab.simulator_models.tree import ModelJoint, Part, SimulatorModel, Vector


def fixed_to(model: SimulatorModel, index: int, chain: set[int]) -> list[Part]:
    """Return the part at `index` of the chain and all parts fixed to it."""
    fixed = [i for i in range(len(model.parts)) if i not in chain and carrier(model, i, chain) == index]
    return [model.parts[index], *(model.parts[i] for i in fixed)]


def sum_of(parts: Sequence[Part]) -> tuple[float, Vector, Vector]:
    """Compute the total mass, centre of mass and inertia (3, 3) of some parts.

    Raises:
        ConfigError: the parts have no mass.
    """
    mass = sum(part.mass for part in parts)
    if not mass > 0 or not math.isfinite(mass):
        joint = parts[0].joint
        moving = f"joint {joint.name!r} moves no mass: " if joint else ""
        raise ConfigError(f"{moving}{parts[0].name!r} and all parts fixed to it, up to the next joint, have none")
    centroid = sum((part.mass * part.centroid for part in parts), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        r = part.centroid - centroid
        inertia += part.inertia + part.mass * (r @ r * np.eye(3) - np.outer(r, r))
    return mass, centroid, inertia


def parts_at_elbow(parts: Sequence[Part], joint: ModelJoint, next_joint: ModelJoint, plane: Vector) -> list[Part]:
    """Return the parts of the inner rod with their centre of mass on joint 2.

    The body of the rod itself is omitted.
    """
    length = float(np.linalg.norm(plane @ (next_joint.anchor - joint.anchor)))
    if not length > 1e-6:
        raise ConfigError(f"the axes of {joint.name!r} and {next_joint.name!r} coincide: L1 would be zero")
    near = CHAIN.elbow * length
    return [p for p in parts[1:] if p.mass > 0 and np.linalg.norm(plane @ (p.centroid - next_joint.anchor)) < near]


def inner_rod(
    parts: Sequence[Part], at_elbow: Sequence[Part], joints: tuple[ModelJoint, ModelJoint], plane: Vector, e: Vector
) -> tuple[ChainRod, float]:
    """Build the inner rod, and compute its angle at joint angle zero, rad."""
    joint, next_joint = joints
    towards = plane @ (next_joint.anchor - joint.anchor)
    length = float(np.linalg.norm(towards))
    mass, centroid, inertia = sum_of(parts)
    place = plane @ (centroid - joint.anchor)
    distance, offset = float(place @ towards) / length, float(towards[0] * place[1] - towards[1] * place[0]) / length
    if not distance > 0:
        raise ConfigError(
            f"the centre of mass of the inner rod is {-distance:.3g} m behind {joint.name!r}: l1 must be above zero"
        )
    inertia_about_joint = float(e @ (inertia + sum((part.inertia for part in at_elbow), np.zeros((3, 3)))) @ e)
    angle, side = math.atan2(towards[1], towards[0]), 1 if joint.axis @ e > 0 else -1
    hanging = _wrapped(side * (math.pi - angle))
    return ChainRod(
        joint, mass, distance, inertia_about_joint, length, hanging, side, plane.T @ towards / length, offset
    ), angle


def last_rod(
    parts: Sequence[Part], joint: ModelJoint, plane: Vector, e: Vector, name: str, inner: float = math.pi
) -> ChainRod:
    """Build the outer rod, or a single rod, which points from its joint to its centre of mass.

    Args:
        parts: parts of the rod
        joint: joint of the rod
        plane: (2, 3) unit vectors of the plane of the swing, upwards first
        e: (3,) axis of the rods
        name: name of the rod, for messages
        inner: angle of the part that carries the rod when all joints are at zero, rad; pi: hanging
    """
    mass, centroid, inertia = sum_of(parts)
    towards = plane @ (centroid - joint.anchor)
    distance = float(np.linalg.norm(towards))
    if not distance > 1e-6:
        raise ConfigError(f"the centre of mass of the {name} is on the axis of {joint.name!r}: it does not swing")
    reach = [float(plane @ (end - joint.anchor) @ towards) / distance for part in parts for end in part.ends]
    length, side = max(reach, default=0.0), 1 if joint.axis @ e > 0 else -1
    hanging = _wrapped(side * (inner - math.atan2(towards[1], towards[0])))
    inertia_about_joint = float(e @ inertia @ e)
    tip = length if length > distance else None
    return ChainRod(joint, mass, distance, inertia_about_joint, tip, hanging, side, plane.T @ towards / distance)


def _wrapped(angle: float) -> float:
    """Wrap an angle to (-pi, pi], rad."""
    return -((-angle + math.pi) % (2 * math.pi) - math.pi)


def arm_of(
    joints: tuple[ModelJoint, ModelJoint],
    parts: Sequence[Part],
    rods: Sequence[Sequence[Part]],
    up: Vector,
    e: Vector,
    notes: list[str],
) -> ChainArm:
    """Build the arm, which carries the rods at its end.

    Args:
        joints: joint of the arm, and joint of the inner rod
        parts: parts of the arm
        rods: parts of each rod
        up: (3,) upward unit vector
        e: (3,) axis of the rods
        notes: list to which notes are added
    """
    joint, inner = joints
    refuse_tilted(joint, up, "the vertical", notes)
    mass, centre, inertia = sum_of(parts)
    r = centre - joint.anchor
    inertia_about_axis = joint.armature + float(up @ inertia @ up + mass * (r @ r - (r @ up) ** 2))
    length = float(abs((sum_of([part for rod in rods for part in rod])[1] - joint.anchor) @ e))
    sideways = float(abs((inner.anchor - joint.anchor) @ np.cross(e, up)))
    if not length > 1e-6:
        raise ConfigError(
            f"the axis of the rods must point along the arm, but it passes the axis of {joint.name!r} at"
            f" {1e3 * sideways:.3g} mm: L0, the distance along it, would be zero"
        )
    if sideways > 1e-3 * length:
        notes.append(f"the axis of the rods passes that of the arm at {1e3 * sideways:.3g} mm: treated as zero")
    apart = float(np.ptp([sum_of(rod)[1] @ e for rod in rods]))
    if apart > 1e-3 * length:
        notes.append(
            f"along the arm, the rods are {1e3 * apart:.3g} mm apart: L0 is the distance of their common centre of mass"
        )
    return ChainArm(joint, length, inertia_about_axis, 1 if joint.axis @ up > 0 else -1)
