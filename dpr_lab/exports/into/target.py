"""Target values of the rods in the user's file, and the change of a body that reaches them.

The swing determines inertias, first moments and friction of the rods, but not their masses. Therefore the masses of the
file are kept, and centroid, inertia, damping, Coulomb friction, armature, spring and length are set. Terms that the
corrected model does not contain are set to zero, so that the file has the motion of the corrected model.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dpr_lab.effects.effect import Words
from dpr_lab.errors import ConfigError
from dpr_lab.exports.bodies import Bodies
from dpr_lab.exports.into.passive import PassiveForces
from dpr_lab.simulator_models.chain import ModelChain, double_pendulum
from dpr_lab.simulator_models.tree import SimulatorModel, Vector
from dpr_lab.simulator_models.xml_edit import ChangedAttribute


@dataclass(frozen=True, slots=True)
class PatchSettings:
    """Tolerances for equal values."""

    same: float = 1e-6
    """Relative difference of L1 and g between the rig file and the model."""
    digits: int = 9
    """Significant digits of a written number."""
    negligible: float = 1e-9
    """Relative change, or shift in m, that is ignored."""
    reached: float = 1e-5
    """Maximum relative error of the changed file when it is read again."""


PATCH = PatchSettings()


@dataclass(frozen=True, slots=True)
class RodTarget:
    """Target values of a rod in the changed file; SI."""

    centroid: float
    """Distance of the centroid along the rod."""
    offset: float
    """Distance of the centroid across the rod."""
    inertia: float
    """Inertia about the centroid."""
    damping: float
    words: Words
    gear: float | None
    """Gear of the motor of its joint; None without one."""


@dataclass(frozen=True, slots=True)
class PatchedModel:
    """The changed file."""

    text: bytes
    changes: tuple[ChangedAttribute, ...]
    lost: dict[str, str]
    """Effect -> reason why neither the file nor the module of passive forces can contain it."""
    passive: PassiveForces
    """Effects that only the module of passive forces contains."""


@dataclass(frozen=True, slots=True)
class BodyChange:
    """Change of the body on a joint."""

    name: str
    mass: float
    """Mass, kg; unchanged."""
    shift: Vector
    """(3,) shift of its centroid in the world, m."""
    factor: float
    """Factor of its inertia about its centroid."""

    @property
    def moves(self) -> bool:
        """Whether the centroid moves."""
        return float(np.linalg.norm(self.shift)) > PATCH.negligible

    @property
    def scales(self) -> bool:
        """Whether the inertia changes."""
        return abs(self.factor - 1) > PATCH.negligible


def refuse_other_rig(chain: ModelChain, L1: float, g: float, path: Path) -> None:
    """Compare the double pendulum of a file with L1, m, and g, m/s^2, of a rig.

    Raises:
        ConfigError: they differ.
    """
    for name, in_file, wanted in (("L1", chain.rods[0].length, L1), ("g", chain.gravity, g)):
        if in_file is None or abs(in_file - wanted) > PATCH.same * wanted:
            raise ConfigError(
                f"{path}: its {name} is {in_file:.6g}, but that of the model is {wanted:.6g}: start from the rig file"
                f" that `dpr-lab rig from {path.name}` writes"
            )


def rod_targets(chain: ModelChain, made: Bodies, friction: Sequence[float]) -> tuple[RodTarget, RodTarget]:
    """Centroids and inertias that give the moments of the corrected model with the masses of the file.

    Args:
        chain: the double pendulum of the file
        made: bodies of the corrected model
        friction: Coulomb friction at rest of passive forces, which the joints also get, N m
    """
    rods, length = made.rods, made.rods[0].length
    tips = (rods[1].mass + made.tip_mass) - (chain.rods[1].mass + chain.elbow_mass), 0.0
    targets = []
    for rod_in_file, rod, moved, held in zip(chain.rods, rods, tips, friction, strict=True):
        moment = rod.mass * rod.centroid + moved * length
        inertia_about_joint = rod.inertia + rod.mass * (rod.centroid**2 + rod.offset**2) + moved * length**2
        centroid, offset = moment / rod_in_file.mass, rod.mass * rod.offset / rod_in_file.mass
        inertia = inertia_about_joint - rod_in_file.mass * (centroid**2 + offset**2)
        gear = None if rod_in_file.gear is None else rod_in_file.gear * rod.words.get("gear", 1.0)
        words = {**rod.words, "friction": rod.words.get("friction", 0.0) + held} if held else rod.words
        targets.append(RodTarget(centroid, offset, inertia, rod.damping, words, gear))
    return targets[0], targets[1]


def body_change(
    read: SimulatorModel, chain: ModelChain, joints: Sequence[str], number: int, target: RodTarget, path: Path
) -> BodyChange:
    """Move the centroid of the body of a joint and scale its inertia to reach the target of the whole rod.

    The common centroid is shifted by moving this body alone.

    Raises:
        ConfigError: the body has no mass, or no positive inertia gives the target.
    """
    rod = chain.rods[number]
    part = next(part for part in read.parts if part.joint is not None and part.joint.name == rod.joint.name)
    if not part.mass > 0:
        raise ConfigError(f"{path}: body {part.name!r} has no mass of its own: give it an <inertial> element")
    across = np.cross(chain.axis, rod.along)
    moved = (target.centroid - rod.centroid) * rod.along + (target.offset - rod.offset) * across
    shift = rod.mass / part.mass * moved
    bare = replace(part, centroid=part.centroid + shift, inertia=np.zeros((3, 3)))
    parts = tuple(bare if inertia is part else inertia for inertia in read.parts)
    without_inertia = double_pendulum(
        replace(read, parts=parts), joints, chain.gravity if read.gravity is None else None
    )
    inertia = float(chain.axis @ part.inertia @ chain.axis)
    factor = (target.inertia - without_inertia.rods[number].inertia) / inertia if inertia > 0 else math.nan
    if not 0 < factor < math.inf:
        raise ConfigError(
            f"{path}: with the masses of the file, body {part.name!r} would need the inertia"
            f" {target.inertia - without_inertia.rods[number].inertia:.3g} kg m^2: correct the masses first"
        )
    return BodyChange(part.name, part.mass, shift, factor)


def joint_values(chain: ModelChain, number: int, target: RodTarget) -> dict[str, tuple[float, float]]:
    """Quantity of a joint -> its values in the file and in the target, if they differ; SI."""
    rod, words = chain.rods[number], target.words
    joint = rod.joint
    values = {
        "damping": (joint.damping, target.damping),
        "friction": (joint.friction, words.get("friction", 0.0)),
        "armature": (joint.armature, words.get("armature", 0.0)),
        "stiffness": (joint.stiffness, words.get("stiffness", 0.0)),
    }
    if "stiffness" in words:
        values["rest"] = joint.rest, rod.hanging + rod.direction * words["rest_angle"]
    return {
        name: (before, after)
        for name, (before, after) in values.items()
        if abs(after - before) > PATCH.negligible * max(abs(after), abs(before))
    }


def refuse_overridden(
    chain: ModelChain, targets: tuple[RodTarget, RodTarget], length: float, words: frozenset[str], reason: str
) -> None:
    """Compare the changed file, read again, with the target values.

    Args:
        chain: of the changed file
        targets: target values of its rods
        length: length of the inner rod, m
        words: elements of the format
        reason: the message if they differ

    Raises:
        ConfigError: something in the file overrides the numbers.
    """
    pairs = [(chain.rods[0].length or 0.0, length)]
    for rod, target in zip(chain.rods, targets, strict=True):
        pairs += [(math.hypot(rod.centroid, rod.offset), math.hypot(target.centroid, target.offset))]
        pairs += [(rod.inertia, target.inertia), (rod.joint.damping, target.damping)]
        pairs += [(rod.gear or 0.0, target.gear or 0.0)]
        of_joint = {name: float(getattr(rod.joint, name)) for name in ("friction", "armature", "stiffness")}
        pairs += [(in_file, target.words.get(name, 0.0)) for name, in_file in of_joint.items() if name in words]
    if any(abs(in_file - wanted) > PATCH.reached * abs(wanted) for in_file, wanted in pairs):
        raise ConfigError(reason)


def numbers(values: Vector | Sequence[float]) -> str:
    """Numbers as text for a file."""
    return " ".join(f"{float(value):.{PATCH.digits}g}" for value in np.asarray(values))
