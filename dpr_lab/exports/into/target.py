"""Compute the target values of rods and arm, and the changes of bodies that attain these values.

A swing determines inertias, first moments and friction of the rods, but not their masses. The masses of the file are
therefore kept. Centre of mass, inertia, damping, Coulomb friction, armature, spring and length are set. Terms that the
corrected model does not contain are set to zero, so that the model of the file moves like the corrected model.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from difflib import unified_diff
from pathlib import Path

import numpy as np

from dpr_lab.effects.effect import Words
from dpr_lab.errors import ConfigError
from dpr_lab.exports.into.passive import PassiveForces
from dpr_lab.exports.mjcf import CALLBACK
from dpr_lab.exports.rigid_bodies import Bodies
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.model import AnyModel
from dpr_lab.rig import Rig
from dpr_lab.shown import in_command
from dpr_lab.simulator_models.chain import ChainArm, ChainRod, ModelChain
from dpr_lab.simulator_models.double_pendulum import double_pendulum
from dpr_lab.simulator_models.tree import SimulatorModel, Vector
from dpr_lab.simulator_models.xml_edit import ChangedAttribute
from dpr_lab.whole_file import write_text


@dataclass(frozen=True, slots=True)
class PatchSettings:
    """Tolerances within which two values count as equal."""

    same: float = 1e-6
    """Maximum relative difference of L1 and g between the rig file and the model."""
    digits: int = 9
    """Number of significant digits of a written number."""
    rounding: float = 1e-12
    """Size of a number of a vector, relative to its largest number, below which it is written as zero."""
    negligible: float = 1e-9
    """Relative change, or shift in m, below which a value is not changed."""
    reached: float = 1e-5
    """Maximum relative difference between the target values and the changed file when it is read again."""


PATCH = PatchSettings()


@dataclass(frozen=True, slots=True)
class Target:
    """Target values of a rod, or of the arm, and of its joint in the changed file, SI."""

    inertia: float
    """Inertia of a rod about its centre of mass, or of arm and rotor without the rods about the arm's axis, kg m^2."""
    damping: float
    words: Words
    gear: float | None
    """Gear ratio of the motor at the joint; None without a motor."""
    centroid: float = 0.0
    """Distance of the centre of mass of a rod from the joint along the rod, m."""
    offset: float = 0.0
    """Distance of the centre of mass of a rod from the axis of the rod, m."""
    length: float = 0.0
    """Distance of the rods' plane from the axis of an arm, m."""


@dataclass(frozen=True, slots=True)
class PatchedModel:
    """The changed file and the effects that it lacks."""

    text: bytes
    changes: tuple[ChangedAttribute, ...]
    lost: dict[str, str]
    """Effects that neither the file nor the module of passive forces can contain, with the reason for each."""
    passive: PassiveForces
    """Effects that are not in the file but in the module of passive forces."""

    def diff(self, original: Path, name: str) -> str:
        """Return a unified diff of the original and the changed file, called `name`."""
        contents = original.read_bytes(), self.text
        before, after = (content.decode("utf-8").splitlines(keepends=True) for content in contents)
        return "".join(unified_diff(before, after, str(original), name, n=1))

    def write(self, folder: Path, name: str) -> tuple[Path, Path | None]:
        """Write the file, and the module of passive forces if the file needs one; return both paths.

        Raises:
            DprError: a file cannot be written.
        """
        file, module = folder / name, folder / CALLBACK if self.passive.module else None
        write_text(file, self.text.decode("utf-8"))
        if module is not None:
            write_text(module, self.passive.module)
        return file, module


@dataclass(frozen=True, slots=True)
class BodyChange:
    """Change of the body that a joint moves."""

    name: str
    mass: float
    """Mass of the body, kg; it is not changed."""
    shift: Vector
    """(3,) shift of the centre of mass in the world frame, m."""
    factor: float
    """Factor on the inertia about the centre of mass."""

    @property
    def moves(self) -> bool:
        """Whether the centre of mass differs from that in the file."""
        return float(np.linalg.norm(self.shift)) > PATCH.negligible

    @property
    def scales(self) -> bool:
        """Whether the inertia differs from that in the file."""
        return abs(self.factor - 1) > PATCH.negligible


def refuse_other_rig(chain: ModelChain, L1: float, g: float, path: Path) -> None:
    """Check that L1 (m) and g (m/s^2) agree between a file and a rig.

    The length of a single rod is not compared.

    Raises:
        ConfigError: L1 or g differs.
    """
    length = chain.rods[0].length if len(chain.rods) == 2 else L1
    for name, in_file, wanted in (("L1", length, L1), ("g", chain.gravity, g)):
        if in_file is None or abs(in_file - wanted) > PATCH.same * wanted:
            raise ConfigError(
                f"{path}: its {name} is {in_file:.6g}, but the model has {wanted:.6g}: start from the rig file"
                f" that `dpr-lab rig from {in_command(path)}` writes"
            )


def arm_to_change(model: AnyModel, chain: ModelChain, rig: Rig, path: Path) -> ChainArm | None:
    """Return the arm of the file if it must be changed, otherwise None.

    Raises:
        ConfigError: the arm of the model moves, but the file has no arm, another number of rods, or another L0; or the
            arm of the model is clamped, but the file has a single rod.
    """
    if isinstance(model, Model):
        if len(chain.rods) == 1:
            raise ConfigError(
                f"{path}: it has one rod on an arm, but the arm of the model is clamped: identify from recordings with"
                " a free or driven arm"
            )
        return None
    if chain.arm is None:
        raise ConfigError(
            f"{path}: the identified arm moves, but no joint of the file is assigned to it: name this joint as the"
            " last of --joints"
        )
    if len(chain.rods) != rig.rods.number:
        rods, wanted = ("one rod" if count == 1 else "two rods" for count in (len(chain.rods), rig.rods.number))
        raise ConfigError(
            f"{path}: it has {rods} on the arm, but the model has {wanted}: name its joints with --joints"
        )
    if abs(chain.arm.length - rig.L0) > PATCH.same * rig.L0:
        raise ConfigError(
            f"{path}: its L0 is {chain.arm.length:.6g}, but that of the rig is {rig.L0:.6g}: start from the rig file"
            f" that `dpr-lab rig from {in_command(path)}` writes"
        )
    return chain.arm


def rod_targets(chain: ModelChain, corrected: Bodies, friction: Sequence[float]) -> list[Target]:
    """Compute target values of the rods that reproduce the moments of the corrected model.

    The masses of the file are kept.

    Args:
        chain: the rods of the file
        corrected: bodies of the corrected model
        friction: Coulomb friction at rest of the passive forces, which is added to the joints, N m
    """
    rods, length = corrected.rods, corrected.rods[0].length
    outer, outer_in_file = sum(rod.mass for rod in rods[1:]), sum(rod.mass for rod in chain.rods[1:])
    tips = (outer + corrected.tip_mass) - (outer_in_file + chain.elbow_mass), 0.0
    targets = []
    for rod_in_file, rod, moved, held in zip(chain.rods, rods, tips, friction, strict=False):
        moment = rod.mass * rod.centroid + moved * length
        inertia_about_joint = rod.inertia + rod.mass * (rod.centroid**2 + rod.offset**2) + moved * length**2
        centroid, offset = moment / rod_in_file.mass, rod.mass * rod.offset / rod_in_file.mass
        inertia = inertia_about_joint - rod_in_file.mass * (centroid**2 + offset**2)
        gear = None if rod_in_file.gear is None else rod_in_file.gear * rod.words.get("gear", 1.0)
        words = {**rod.words, "friction": rod.words.get("friction", 0.0) + held} if held else rod.words
        targets.append(Target(inertia, rod.damping, words, gear, centroid, offset))
    return targets


def arm_target(chain: ModelChain, in_file: ChainArm, corrected: Bodies, nominal_gain: float) -> Target:
    """Compute target values of the arm that reproduce the inertia of the corrected model.

    The masses of the file are kept.

    Args:
        chain: the rods of the file
        in_file: arm in the file
        corrected: bodies of the corrected model, with an arm
        nominal_gain: torque per input in the rig file; the gear of the motor is multiplied by the ratio of the gains
    """
    arm = corrected.arm
    assert arm is not None
    total = arm.inertia + sum(rod.mass for rod in corrected.rods) * arm.length**2
    carried = sum(rod.mass for rod in chain.rods) + chain.elbow_mass
    gear = None if in_file.gear is None else in_file.gear * (arm.gain / nominal_gain if arm.input else 1.0)
    words = {**arm.words, "armature": in_file.joint.armature}
    return Target(total - carried * arm.length**2, arm.damping, words, gear, length=arm.length)


def arm_change(read: SimulatorModel, in_file: ChainArm, target: Target, path: Path) -> BodyChange:
    """Compute the change of the arm's body that gives the arm its target inertia.

    Raises:
        ConfigError: no positive inertia of the body leads to the target.
    """
    part = read.moved_by(in_file.joint.name)
    axis = in_file.joint.axis
    inertia = float(axis @ part.inertia @ axis)
    needed = target.inertia - (in_file.inertia - inertia)
    if not (inertia > 0 and needed > 0):
        raise ConfigError(
            f"{path}: with the masses and the armature of the file, body {part.name!r} of the arm would need the"
            f" inertia {needed:.3g} kg m^2: correct the masses first"
        )
    return BodyChange(part.name, part.mass, np.zeros(3), needed / inertia)


def body_change(
    read: SimulatorModel, chain: ModelChain, joints: Sequence[str], number: int, target: Target, path: Path
) -> BodyChange:
    """Compute the change of the body of a joint that gives the whole rod its target values.

    Other bodies of the rod are not changed.

    Raises:
        ConfigError: the body has no mass, or no positive inertia of the body leads to the target.
    """
    rod = chain.rods[number]
    part = read.moved_by(rod.joint.name)
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


def joint_values(part: ChainRod | ChainArm, target: Target) -> dict[str, tuple[float, float]]:
    """Return the quantities of a joint that differ from the target.

    Each quantity has two values, SI: the value in the file and the value in the target.
    """
    joint, words = part.joint, target.words
    values = {
        "damping": (joint.damping, target.damping),
        "friction": (joint.friction, words.get("friction", 0.0)),
        "armature": (joint.armature, words.get("armature", 0.0)),
        "stiffness": (joint.stiffness, words.get("stiffness", 0.0)),
    }
    if "stiffness" in words:
        values["rest"] = joint.rest, part.hanging + part.direction * words["rest_angle"]
    return {
        name: (before, after)
        for name, (before, after) in values.items()
        if abs(after - before) > PATCH.negligible * max(abs(after), abs(before))
    }


def refuse_overridden(
    chain: ModelChain,
    targets: Sequence[Target],
    length: float,
    words: frozenset[str],
    reason: str,
) -> None:
    """Read the changed file again, and check that it has the target values.

    Args:
        chain: rods and arm of the changed file
        targets: target values of the rods, and of the arm if it moves
        length: length of the inner rod, m
        words: elements of effects that the format supports
        reason: error message for a difference

    Raises:
        ConfigError: other settings of the file override the numbers.
    """
    pairs = [(chain.rods[0].length or 0.0, length)] if len(chain.rods) == 2 else []
    for part, target in zip(chain.parts, targets, strict=False):
        if isinstance(part, ChainRod):
            pairs += [(math.hypot(part.centroid, part.offset), math.hypot(target.centroid, target.offset))]
        else:
            pairs += [(part.length, target.length)]
        pairs += [(part.inertia, target.inertia), (part.gear or 0.0, target.gear or 0.0)]
        pairs += [pair for name, pair in joint_values(part, target).items() if name in {"damping", *words}]
    if any(abs(in_file - wanted) > PATCH.reached * abs(wanted) for in_file, wanted in pairs):
        raise ConfigError(reason)


def numbers(values: Vector | Sequence[float]) -> str:
    """Format the numbers of a vector for a file.

    Numbers that are negligible relative to the largest number are written as zero. Examples are rounding errors of a
    rotation.
    """
    exact = np.asarray(values, dtype=np.float64)
    rounded = np.where(np.abs(exact) < PATCH.rounding * np.max(np.abs(exact)), 0.0, exact)
    return " ".join(f"{value:.{PATCH.digits}g}" for value in rounded.tolist())
