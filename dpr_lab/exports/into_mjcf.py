"""Write the corrected model into the MJCF file of the user.

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
from dpr_lab.exports.bodies import Rod, bodies, in_words, left_out
from dpr_lab.identification.model import Model
from dpr_lab.rig import Rig
from dpr_lab.simulator_models.chain import ModelChain, double_pendulum
from dpr_lab.simulator_models.mjcf import CompiledMjcf, compile_mjcf
from dpr_lab.simulator_models.tree import SimulatorModel, Vector
from dpr_lab.simulator_models.xml_edit import ChangedAttribute, XmlEdit

WORDS = frozenset({"friction", "stiffness", "rest_angle", "armature", "offset", "added_length"})
"""Elements of effects that attributes of joints and bodies represent."""


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


@dataclass(frozen=True, slots=True)
class PatchedModel:
    """The changed file."""

    text: bytes
    changes: tuple[ChangedAttribute, ...]
    lost: dict[str, str]
    """Effect -> reason why the file cannot contain it."""


@dataclass(frozen=True, slots=True)
class _File:
    """The file as read."""

    path: Path
    compiled: CompiledMjcf
    read: SimulatorModel
    chain: ModelChain
    joints: tuple[str, ...]

    def tags(self, edit: XmlEdit, number: int) -> tuple[int, int]:
        """Indices of the joint of a rod and of its body.

        Raises:
            ConfigError: the joint is not in the file itself.
        """
        name = self.chain.rods[number].joint.name
        index = edit.find("joint", name=name)
        if index is None:
            raise ConfigError(
                f"{self.path}: no <joint name={name!r}> in the file itself: add the name to the joint in this file"
            )
        return index, edit.tags[index].parent


def _read(path: Path, joints: Sequence[str], text: bytes | None = None) -> _File:
    compiled = compile_mjcf(path, text)
    read = compiled.simulator_model()
    try:
        chain = double_pendulum(read, joints)
    except ConfigError as error:
        raise ConfigError(f"{path}: {error}") from error
    parts = (*chain.rods, *((chain.arm,) if chain.arm else ()))
    return _File(path, compiled, read, chain, tuple(part.joint.name for part in parts))


def into_mjcf(model: Model, rig: Rig, path: Path, joints: Sequence[str] = ()) -> PatchedModel:
    """The file with the numbers of the corrected model.

    Args:
        model: the corrected or identified model
        rig: its rig, from the rig file that `dpr-lab rig from` wrote for this file
        path: the MJCF file
        joints: joints of inner rod, outer rod and optionally the arm; empty: detected

    Raises:
        ConfigError: the file cannot be read or changed, or its L1 or g differs from that of the rig.
    """
    file = _read(path, joints)
    refuse_other_rig(file.chain, model.rig.L1, model.rig.g, path)
    expressed = in_words(model, rig, WORDS)
    made = bodies(model, rig, expressed)
    edits = [XmlEdit(path.read_bytes(), str(path))]
    if longer := sum(words.get("added_length", 0.0) for words in expressed.values()):
        _lengthen(edits[0], file, longer)
        file = _read(path, file.joints, edits[0].text())
        edits.append(XmlEdit(edits[0].text(), str(path)))
    targets = _targets(file.chain, made.rods, made.tip_mass)
    for number, target in enumerate(targets):
        _set_body(edits[-1], file, number, target)
        _set_joint(edits[-1], file, number, target)
    text = edits[-1].text()
    _refuse_overridden(_read(path, file.joints, text).chain, targets, made.rods[0].length, path)
    changes = tuple(change for edit in edits for change in edit.changes)
    return PatchedModel(text, changes, left_out(model, expressed, "MJCF"))


def refuse_other_rig(chain: ModelChain, L1: float, g: float, path: Path) -> None:
    """Compare the double pendulum of a file with L1, m, and g, m/s^2, of a rig.

    Raises:
        ConfigError: they differ.
    """
    for name, own, wanted in (("L1", chain.rods[0].length, L1), ("g", chain.gravity, g)):
        if own is None or abs(own - wanted) > PATCH.same * wanted:
            raise ConfigError(
                f"{path}: its {name} is {own:.6g}, but that of the model is {wanted:.6g}: start from the rig file that"
                f" `dpr-lab rig from {path.name}` writes"
            )


def _targets(chain: ModelChain, rods: tuple[Rod, Rod], tip: float) -> tuple[RodTarget, RodTarget]:
    """Centroids and inertias that give the moments of the corrected model with the masses of the file."""
    length = rods[0].length
    tips = (rods[1].mass + tip) - (chain.rods[1].mass + chain.elbow_mass), 0.0
    targets = []
    for own, rod, moved in zip(chain.rods, rods, tips, strict=True):
        moment = rod.mass * rod.centroid + moved * length
        about = rod.inertia + rod.mass * (rod.centroid**2 + rod.offset**2) + moved * length**2
        centroid, offset = moment / own.mass, rod.mass * rod.offset / own.mass
        inertia = about - own.mass * (centroid**2 + offset**2)
        targets.append(RodTarget(centroid, offset, inertia, rod.damping, rod.words))
    return targets[0], targets[1]


def _set_body(edit: XmlEdit, file: _File, number: int, target: RodTarget) -> None:
    """Move the centroid of the body of a joint and scale its inertia to reach the target of the whole rod.

    The common centroid is shifted by moving this body alone.
    """
    chain, rod = file.chain, file.chain.rods[number]
    part = next(part for part in file.read.parts if part.joint is not None and part.joint.name == rod.joint.name)
    if not part.mass > 0:
        raise ConfigError(f"{file.path}: body {part.name!r} has no mass of its own: give it an <inertial> element")
    across = np.cross(chain.axis, rod.along)
    moved = (target.centroid - rod.centroid) * rod.along + (target.offset - rod.offset) * across
    shift = rod.mass / part.mass * moved
    bare = replace(part, centroid=part.centroid + shift, inertia=np.zeros((3, 3)))
    parts = tuple(bare if own is part else own for own in file.read.parts)
    rest = double_pendulum(replace(file.read, parts=parts), file.joints).rods[number].inertia
    own = float(chain.axis @ part.inertia @ chain.axis)
    factor = (target.inertia - rest) / own if own > 0 else math.nan
    if not 0 < factor < math.inf:
        raise ConfigError(
            f"{file.path}: with the masses of the file, body {part.name!r} would need the inertia"
            f" {target.inertia - rest:.3g} kg m^2: correct the masses first"
        )
    moves, scales = float(np.linalg.norm(shift)) > PATCH.negligible, abs(factor - 1) > PATCH.negligible
    if not moves and not scales:
        return
    frame, (_, body) = file.compiled.body(rod.joint.name), file.tags(edit, number)
    place, label, inertial = (
        frame.local_centroid + frame.turned.T @ shift,
        f"body {frame.name}",
        edit.child(body, "inertial"),
    )
    if inertial is None:
        values = {"pos": place, "quat": frame.local_turn, "mass": [part.mass], "diaginertia": factor * frame.principal}
        edit.insert(body, "inertial", label, **{name: _numbers(value) for name, value in values.items()})
        return
    if moves:
        edit.set(inertial, f"{label}, inertial", pos=_numbers(place))
    if scales:
        form = "fullinertia" if "fullinertia" in edit.tags[inertial].attributes else "diaginertia"
        values = np.array(edit.tags[inertial].attributes.get(form, "").split(), dtype=np.float64)
        edit.set(inertial, f"{label}, inertial", **{form: _numbers(factor * values)})


def _set_joint(edit: XmlEdit, file: _File, number: int, target: RodTarget) -> None:
    """Set the attributes of a joint that differ from the target."""
    rod, words = file.chain.rods[number], target.words
    joint = rod.joint
    values = {
        "damping": (joint.damping, target.damping),
        "frictionloss": (joint.friction, words.get("friction", 0.0)),
        "armature": (joint.armature, words.get("armature", 0.0)),
        "stiffness": (joint.stiffness, words.get("stiffness", 0.0)),
    }
    if "stiffness" in words:
        rest = rod.hanging + rod.direction * words["rest_angle"]
        turn = math.degrees(1.0) if file.compiled.degrees else 1.0
        values["springref"] = turn * joint.rest, turn * rest
    changed = {
        name: _numbers([after])
        for name, (before, after) in values.items()
        if abs(after - before) > PATCH.negligible * max(abs(after), abs(before))
    }
    edit.set(file.tags(edit, number)[0], f"joint {joint.name}", **changed)


def _lengthen(edit: XmlEdit, file: _File, longer: float) -> None:
    """Move the body of the outer rod along the inner rod."""
    (_, inner), (_, outer) = file.tags(edit, 0), file.tags(edit, 1)
    names = [rod.joint.name for rod in file.chain.rods]
    if edit.tags[outer].parent != inner:
        raise ConfigError(f"{file.path}: the body of {names[1]!r} is not directly in that of {names[0]!r}")
    frame = file.compiled.body(names[1])
    moved = file.compiled.body(names[0]).turned.T @ (longer * file.chain.rods[0].along)
    edit.set(outer, f"body {frame.name}", pos=_numbers(frame.local_place + moved))


def _refuse_overridden(chain: ModelChain, targets: tuple[RodTarget, RodTarget], length: float, path: Path) -> None:
    """Compare the changed file, read again, with the target values.

    Raises:
        ConfigError: compiler options of the file override the numbers.
    """
    pairs = [(chain.rods[0].length or 0.0, length)]
    for rod, target in zip(chain.rods, targets, strict=True):
        pairs += [(math.hypot(rod.centroid, rod.offset), math.hypot(target.centroid, target.offset))]
        pairs += [(rod.inertia, target.inertia), (rod.joint.damping, target.damping)]
        pairs += [(rod.joint.friction, target.words.get("friction", 0.0))]
        pairs += [(rod.joint.armature, target.words.get("armature", 0.0))]
        pairs += [(rod.joint.stiffness, target.words.get("stiffness", 0.0))]
    if any(abs(own - wanted) > PATCH.reached * abs(wanted) for own, wanted in pairs):
        raise ConfigError(
            f"{path}: its defaults or compiler options (inertiafromgeom, settotalmass) override the changed numbers:"
            " save the compiled model with mj_saveLastXML, and change that"
        )


def _numbers(values: Vector | Sequence[float]) -> str:
    return " ".join(f"{float(value):.{PATCH.digits}g}" for value in np.asarray(values))
