"""Double pendulum in a model: an inner rod, an outer rod on it, and optionally an arm with a vertical axis.

theta_i is the angle of rod i from upright about the axis of joint 1 (docs/theory.md). The inner rod points from joint 1
to joint 2, the outer rod from joint 2 to its centroid.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from dpr_lab.errors import ConfigError
from dpr_lab.simulator_models.tree import ModelJoint, Part, SimulatorModel, Vector


@dataclass(frozen=True, slots=True)
class ChainLimits:
    """Tolerances for parallel axes and for parts fixed to the elbow; default gravity."""

    gravity: float = 9.81
    """Default gravity, m/s^2."""
    parallel: float = math.radians(10.0)
    """Maximum angle of axes that are treated as parallel, rad; with a larger angle the model is refused."""
    noticed: float = math.radians(0.01)
    """Angle above which a note is given, rad."""
    elbow: float = 1e-3
    """Distance of a part from the axis of joint 2, in lengths of the rod, up to which it is part of mb."""
    offset: float = 1e-7
    """Distance of the centroid from the line of the inner rod above which a note is given, m."""


CHAIN = ChainLimits()


@dataclass(frozen=True, slots=True)
class JointTerm:
    """A term of the model for which the rig file has no key."""

    joint: str
    quantity: str
    value: float
    unit: str

    def __str__(self) -> str:
        return f"{self.joint}: {self.quantity} {self.value:.6g} {self.unit}".rstrip()


@dataclass(frozen=True, slots=True)
class ChainRod:
    """A rod and its joint; SI."""

    joint: ModelJoint
    mass: float
    centroid: float
    """Distance of the centroid along the rod from its joint, m."""
    inertia: float
    """Inertia about its centroid, kg m^2."""
    length: float | None
    """Length, m; None if no shape shows it."""
    hanging: float
    """Angle of the joint in the model with the rods hanging, rad."""
    direction: int
    """-1 if the angle of the joint in the model decreases while theta increases."""
    along: Vector
    """(3,) unit vector along the rod, all joints at zero."""
    offset: float = 0.0
    """Distance of the centroid across the rod, m."""
    gear: float | None = None
    """Gear of the only motor on its joint; None without one, or if other actuators act on the joint."""


@dataclass(frozen=True, slots=True)
class ChainArm:
    """The arm; SI."""

    joint: ModelJoint
    length: float
    inertia: float
    """Inertia about its axis, without the rods."""
    direction: int


@dataclass(frozen=True, slots=True)
class ModelChain:
    """The double pendulum in a model."""

    rods: tuple[ChainRod, ChainRod]
    elbow_mass: float
    """Mass of the parts on the axis of joint 2 that are fixed to the inner rod, kg."""
    gravity: float
    """Gravity in the plane of the swing, m/s^2."""
    axis: Vector
    """(3,) unit vector of the axis with positive theta."""
    arm: ChainArm | None
    terms: tuple[JointTerm, ...]
    """Additional terms of the joints with their values."""
    notes: tuple[str, ...]
    """Notes on parts that the rig file cannot contain."""


def double_pendulum(model: SimulatorModel, names: Sequence[str] = (), gravity: float | None = None) -> ModelChain:
    """Find the rods and the arm with their values.

    Args:
        model: the model
        names: joints of the inner rod, the outer rod and optionally the arm; empty if there is only one choice
        gravity: m/s^2, downwards along z, instead of that of the model

    Raises:
        ConfigError: unknown joints, several choices, or axes that are not parallel.
    """
    notes = list(model.notes)
    indices = _named(model, names) if names else _only_choice(model)
    pull = _pull(model, gravity, notes)
    joints = [_joint_of(model, index) for index in indices]
    _others(model, indices, notes)
    groups = [_fixed_to(model, index, set(indices)) for index in indices]
    inner, outer = joints[:2]
    _refuse_tilted(outer, inner.axis, f"the axis of {inner.name!r}", notes)
    e, arm = inner.axis, None
    if len(joints) == 3:
        arm = _arm((joints[2], inner), groups, -pull / np.linalg.norm(pull), e, notes)
        if (joints[2].anchor - _sum_of(groups[0] + groups[1])[1]) @ e < 0:
            e = -e  # the axis of the rods points from them to the axis of the arm
    down = pull - (pull @ e) * e
    g = float(np.linalg.norm(down))
    if not g > 0.1:
        raise ConfigError(f"gravity across the axis of {inner.name!r} is {g:.3g} m/s^2: a pendulum needs at least 0.1")
    inclination = math.asin(min(1.0, abs(pull @ e) / float(np.linalg.norm(pull))))
    if inclination > CHAIN.noticed:
        notes.append(
            f"the axis of {inner.name!r} is inclined by {math.degrees(inclination):.3g} degrees: g is the component of"
            " gravity in the plane of the swing"
        )
    up = -down / g
    plane = np.array([up, np.cross(e, up)])
    at_elbow = _at_elbow(groups[0], inner, outer, plane)
    inner_parts = [part for part in groups[0] if part not in at_elbow]
    terms = [term for joint in joints for term in _terms(joint)]
    rod1, angle1 = _inner(inner_parts, at_elbow, (inner, outer), plane, e)
    if abs(rod1.offset) > CHAIN.offset:
        terms.append(JointTerm(inner.name, "distance of the centroid from the axis of the inner rod", rod1.offset, "m"))
    rod2 = _outer(groups[1], outer, plane, e, angle1)
    _driven(model, joints, notes)
    rods = tuple(replace(rod, gear=_gear(model, rod.joint)) for rod in (rod1, rod2))
    return ModelChain(
        (rods[0], rods[1]), float(sum(part.mass for part in at_elbow)), g, e, arm, tuple(terms), tuple(notes)
    )


def _pull(model: SimulatorModel, gravity: float | None, notes: list[str]) -> Vector:
    if gravity is not None:
        return np.array([0.0, 0.0, -gravity])
    if model.gravity is None:
        notes.append(
            f"{model.format} contains no gravity: g = {CHAIN.gravity} m/s^2 downwards along z (--g changes it)"
        )
        return np.array([0.0, 0.0, -CHAIN.gravity])
    if model.gravity.shape != (3,) or not np.linalg.norm(model.gravity) > 0:
        raise ConfigError("the model has no gravity, and a pendulum needs it: give --g 9.81")
    return model.gravity


def _joint_of(model: SimulatorModel, index: int) -> ModelJoint:
    joint = model.parts[index].joint
    assert joint is not None
    return joint


def _hinges(model: SimulatorModel) -> list[int]:
    return [i for i, part in enumerate(model.parts) if part.joint is not None and part.joint.kind == "hinge"]


def _carrier(model: SimulatorModel, index: int, among: set[int]) -> int:
    """Next of these parts towards the world; -1: none."""
    above = model.parts[index].parent
    while above >= 0 and above not in among:
        above = model.parts[above].parent
    return above


def _names(model: SimulatorModel, indices: Sequence[int]) -> str:
    return ", ".join(repr(_joint_of(model, index).name) for index in indices) or "none"


def _named(model: SimulatorModel, names: Sequence[str]) -> list[int]:
    """Parts of the named joints.

    Raises:
        ConfigError: unknown joint, not two or three joints, or joints that are not in a chain.
    """
    hinges = _hinges(model)
    by_name = {_joint_of(model, index).name: index for index in hinges}
    if len(names) not in (2, 3) or len(set(names)) != len(names):
        raise ConfigError(
            "--joints names two joints, of the inner and of the outer rod, and optionally that of the arm"
        )
    if unknown := [name for name in names if name not in by_name]:
        raise ConfigError(f"no hinge is named {unknown[0]!r}; hinges of the model: {_names(model, hinges)}")
    if common := [name for name in names if sum(_joint_of(model, index).name == name for index in hinges) > 1]:
        raise ConfigError(f"several hinges are named {common[0]!r}: rename them, or keep one model in the file")
    indices = [by_name[name] for name in names]
    shoulder, elbow, *arm = indices
    chain = set(indices)
    if _carrier(model, elbow, chain) != shoulder:
        raise ConfigError(f"joint {names[1]!r} is not on the rod of {names[0]!r}: give the inner joint first")
    if arm and _carrier(model, shoulder, chain) != arm[0]:
        raise ConfigError(f"joint {names[0]!r} is not on the arm of {names[2]!r}")
    return indices


def _only_choice(model: SimulatorModel) -> list[int]:
    """Inner rod, outer rod and optionally arm of a model without other hinges.

    Raises:
        ConfigError: not two or three hinges, or hinges that are not in a chain with parallel axes.
    """
    hinges = _hinges(model)
    if len(hinges) < 2:
        have = f"only one hinge, {_names(model, hinges)}" if hinges else "no hinge"
        kinds = sorted({part.joint.kind for part in model.parts if part.joint is not None} - {"hinge"})
        others = f" (joints of other kinds: {', '.join(kinds)})" if kinds else ""
        raise ConfigError(f"the model has {have}{others}; a double pendulum has two in a chain")
    if len(hinges) > 3:
        raise ConfigError(
            f"the model has {len(hinges)} hinges, {_names(model, hinges)}: choose two with --joints INNER,OUTER"
        )
    chain = set(hinges)
    ordered = sorted(hinges, key=lambda index: _depth(model, index))
    if any(_carrier(model, outer, chain) != inner for inner, outer in pairwise(ordered)):
        raise ConfigError(f"the hinges {_names(model, hinges)} are not in a chain: not a double pendulum")
    if len(ordered) == 2:
        return ordered
    arm, shoulder, elbow = ordered
    if _between(_joint_of(model, arm).axis, _joint_of(model, shoulder).axis) < math.pi / 4:
        raise ConfigError(
            f"the model has three hinges, {_names(model, ordered)}, and the first has the same axis as the"
            f" second: choose two with --joints INNER,OUTER"
        )
    return [shoulder, elbow, arm]


def _depth(model: SimulatorModel, index: int) -> int:
    depth = 0
    while index >= 0:
        index, depth = model.parts[index].parent, depth + 1
    return depth


def _between(first: Vector, second: Vector) -> float:
    """Angle between two axes without direction, rad."""
    return math.atan2(float(np.linalg.norm(np.cross(first, second))), abs(float(first @ second)))


def _refuse_tilted(joint: ModelJoint, axis: Vector, what: str, notes: list[str]) -> None:
    angle = _between(joint.axis, axis)
    if angle > CHAIN.parallel:
        raise ConfigError(
            f"the axis of {joint.name!r} is {math.degrees(angle):.3g} degrees away from {what}: dpr-lab models parallel"
            " rod axes, and an arm about the vertical"
        )
    if angle > CHAIN.noticed:
        notes.append(
            f"the axis of {joint.name!r} is {math.degrees(angle):.3g} degrees away from {what}: treated as parallel"
        )


def _others(model: SimulatorModel, indices: Sequence[int], notes: list[str]) -> None:
    """Notes on joints that are fixed at zero."""
    for index, part in enumerate(model.parts):
        if part.joint is not None and index not in indices:
            below = _carrier(model, index, set(indices)) >= 0
            location = f"; {part.mass:.6g} kg turn with the rods" if below and part.mass else ""
            notes.append(f"joint {part.joint.name!r} ({part.joint.kind}) is treated as fixed at zero{location}")


def _fixed_to(model: SimulatorModel, index: int, chain: set[int]) -> list[Part]:
    """Parts that move with a joint of the chain, the part of the joint first."""
    fixed = [i for i in range(len(model.parts)) if i not in chain and _carrier(model, i, chain) == index]
    return [model.parts[index], *(model.parts[i] for i in fixed)]


def _sum_of(parts: Sequence[Part]) -> tuple[float, Vector, Vector]:
    """Mass, centroid and (3, 3) inertia about the centroid.

    Raises:
        ConfigError: no mass.
    """
    mass = sum(part.mass for part in parts)
    if not mass > 0 or not math.isfinite(mass):
        raise ConfigError(f"the part {parts[0].name!r} and all parts fixed to it have no mass")
    centroid = sum((part.mass * part.centroid for part in parts), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for part in parts:
        r = part.centroid - centroid
        inertia += part.inertia + part.mass * (r @ r * np.eye(3) - np.outer(r, r))
    return mass, centroid, inertia


def _at_elbow(parts: Sequence[Part], joint: ModelJoint, next_joint: ModelJoint, plane: Vector) -> list[Part]:
    """Parts of the inner rod, except its own body, with their centroid on the axis of joint 2."""
    length = float(np.linalg.norm(plane @ (next_joint.anchor - joint.anchor)))
    if not length > 1e-6:
        raise ConfigError(f"the axes of {joint.name!r} and {next_joint.name!r} coincide: L1 would be zero")
    near = CHAIN.elbow * length
    return [p for p in parts[1:] if p.mass > 0 and np.linalg.norm(plane @ (p.centroid - next_joint.anchor)) < near]


def _inner(
    parts: Sequence[Part], at_elbow: Sequence[Part], joints: tuple[ModelJoint, ModelJoint], plane: Vector, e: Vector
) -> tuple[ChainRod, float]:
    """The inner rod, and its angle at zero of its joint."""
    joint, next_joint = joints
    towards = plane @ (next_joint.anchor - joint.anchor)
    length = float(np.linalg.norm(towards))
    mass, centroid, inertia = _sum_of(parts)
    place = plane @ (centroid - joint.anchor)
    distance, offset = float(place @ towards) / length, float(towards[0] * place[1] - towards[1] * place[0]) / length
    if not distance > 0:
        raise ConfigError(
            f"the centroid of the inner rod is {-distance:.3g} m behind {joint.name!r}: l1 must be above zero"
        )
    inertia_about_joint = float(e @ (inertia + sum((part.inertia for part in at_elbow), np.zeros((3, 3)))) @ e)
    angle, side = math.atan2(towards[1], towards[0]), 1 if joint.axis @ e > 0 else -1
    hanging = _wrapped(side * (math.pi - angle))
    return ChainRod(
        joint, mass, distance, inertia_about_joint, length, hanging, side, plane.T @ towards / length, offset
    ), angle


def _outer(parts: Sequence[Part], joint: ModelJoint, plane: Vector, e: Vector, inner: float) -> ChainRod:
    """The outer rod, whose direction is that of its centroid; `inner` is the angle of the inner rod, rad."""
    mass, centroid, inertia = _sum_of(parts)
    towards = plane @ (centroid - joint.anchor)
    distance = float(np.linalg.norm(towards))
    if not distance > 1e-6:
        raise ConfigError(f"the centroid of the outer rod is on the axis of {joint.name!r}: it does not swing")
    reach = [float(plane @ (end - joint.anchor) @ towards) / distance for part in parts for end in part.ends]
    length, side = max(reach, default=0.0), 1 if joint.axis @ e > 0 else -1
    hanging = _wrapped(side * (inner - math.atan2(towards[1], towards[0])))
    inertia_about_joint = float(e @ inertia @ e)
    tip = length if length > distance else None
    return ChainRod(joint, mass, distance, inertia_about_joint, tip, hanging, side, plane.T @ towards / distance)


def _wrapped(angle: float) -> float:
    """Angle in (-pi, pi], rad."""
    return -((-angle + math.pi) % (2 * math.pi) - math.pi)


def _terms(joint: ModelJoint) -> list[JointTerm]:
    values = (
        ("Coulomb friction", joint.friction, "N m"),
        ("rotor inertia (armature)", joint.armature, "kg m^2"),
        ("spring stiffness", joint.stiffness, "N m/rad"),
    )
    terms = [JointTerm(joint.name, quantity, value, unit) for quantity, value, unit in values if value]
    if joint.stiffness:
        terms.append(JointTerm(joint.name, "joint angle with the spring relaxed", joint.rest, "rad"))
    return terms


def _driven(model: SimulatorModel, joints: Sequence[ModelJoint], notes: list[str]) -> None:
    names = {joint.name for joint in joints}
    for actuator in model.actuators:
        if actuator.joint in names:
            gear = f", gear {actuator.gear:.6g}" if actuator.gear != 1.0 else ""
            notes.append(f"actuator {actuator.name!r} on joint {actuator.joint!r}: {actuator.kind}{gear}")
    for joint in joints:
        notes += [f"joint {joint.name!r}: {text} {numbers}" for text, numbers in joint.other.items()]
        if joint.limits is not None:
            lower, upper = joint.limits
            notes.append(f"joint {joint.name!r}: stops at {lower:.6g} and {upper:.6g} rad")


def _gear(model: SimulatorModel, joint: ModelJoint) -> float | None:
    actuators = [actuator for actuator in model.actuators if actuator.joint == joint.name]
    motor = len(actuators) == 1 and actuators[0].kind == "motor"
    return actuators[0].gear if motor and actuators[0].gear and math.isfinite(actuators[0].gear) else None


def _arm(
    joints: tuple[ModelJoint, ModelJoint], groups: Sequence[Sequence[Part]], up: Vector, e: Vector, notes: list[str]
) -> ChainArm:
    """The arm with the rods at its end, from its joint and that of the inner rod; `e` is the axis of the rods."""
    joint, inner = joints
    _refuse_tilted(joint, up, "the vertical", notes)
    mass, centre, inertia = _sum_of(groups[2])
    r = centre - joint.anchor
    inertia_about_axis = float(up @ inertia @ up + mass * (r @ r - (r @ up) ** 2))
    length = float(abs((_sum_of([*groups[0], *groups[1]])[1] - joint.anchor) @ e))
    if not length > 1e-6:
        raise ConfigError(f"the rods are on the axis of the arm {joint.name!r}: L0 would be zero")
    sideways = float(abs((inner.anchor - joint.anchor) @ np.cross(e, up)))
    if sideways > 1e-3 * length:
        notes.append(f"the rods are {1e3 * sideways:.3g} mm away from the radius of the arm: treated as zero")
    apart = float(abs((_sum_of(groups[0])[1] - _sum_of(groups[1])[1]) @ e))
    if apart > 1e-3 * length:
        notes.append(f"the rods are {1e3 * apart:.3g} mm apart along the arm: L0 is the distance of their centroid")
    return ChainArm(joint, length, inertia_about_axis, 1 if joint.axis @ up > 0 else -1)
