"""Write the corrected model into the MJCF file of the user (`dpr_lab.exports.into.target` says what changes)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dpr_lab.effects import EFFECTS
from dpr_lab.errors import ConfigError
from dpr_lab.exports.bodies import bodies, in_words, left_out
from dpr_lab.exports.into.passive import passive_forces
from dpr_lab.exports.into.target import (
    PATCH,
    PatchedModel,
    RodTarget,
    body_change,
    joint_values,
    numbers,
    refuse_other_rig,
    refuse_overridden,
    rod_targets,
)
from dpr_lab.identification.model import Model
from dpr_lab.rig import Rig
from dpr_lab.simulator_models.chain import ModelChain, double_pendulum
from dpr_lab.simulator_models.mjcf import CompiledMjcf, compile_mjcf
from dpr_lab.simulator_models.tree import SimulatorModel
from dpr_lab.simulator_models.xml_edit import XmlEdit

WORDS = frozenset({"friction", "stiffness", "rest_angle", "armature", "offset", "added_length", "gear"})
"""Elements of effects that attributes of joints, bodies and motors represent."""

ATTRIBUTES = {"friction": "frictionloss", "rest": "springref"}
"""Quantity of a joint -> its attribute, if the names differ."""


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
    expressed = {
        name: words
        for name, words in in_words(model, rig, WORDS).items()
        if "gear" not in words or file.chain.rods[EFFECTS[name].joints[0]].gear is not None
    }
    made = bodies(model, rig, expressed)
    edits = [XmlEdit(path.read_bytes(), str(path))]
    if longer := sum(words.get("added_length", 0.0) for words in expressed.values()):
        _lengthen(edits[0], file, longer)
        file = _read(path, file.joints, edits[0].text())
        edits.append(XmlEdit(edits[0].text(), str(path)))
    added = passive_forces(model, rig, expressed, file.chain, path.name)
    targets = rod_targets(file.chain, made, added.friction)
    for number, target in enumerate(targets):
        _set_body(edits[-1], file, number, target)
        _set_joint(edits[-1], file, number, target)
        _set_gear(edits[-1], file, number, target)
    text = edits[-1].text()
    reason = (
        f"{path}: a <flag> switches off what would change, or its defaults or compiler options (inertiafromgeom,"
        " settotalmass) override the changed numbers: remove the flag, or save the compiled model with mj_saveLastXML,"
        " and change that"
    )
    refuse_overridden(_read(path, file.joints, text).chain, targets, made.rods[0].length, WORDS, reason)
    changes = tuple(change for edit in edits for change in edit.changes)
    return PatchedModel(text, changes, left_out(model, {*expressed, *added.effects}, "MJCF"), added)


def _set_body(edit: XmlEdit, file: _File, number: int, target: RodTarget) -> None:
    """Move the centroid of a body and scale its inertia."""
    change = body_change(file.read, file.chain, file.joints, number, target, file.path)
    if not change.moves and not change.scales:
        return
    frame, (_, body) = file.compiled.body(file.chain.rods[number].joint.name), file.tags(edit, number)
    place, label, inertial = (
        frame.local_centroid + frame.turned.T @ change.shift,
        f"body {frame.name}",
        edit.child(body, "inertial"),
    )
    if inertial is None:
        inertia = change.factor * frame.principal
        values = {"pos": place, "quat": frame.local_turn, "mass": [change.mass], "diaginertia": inertia}
        edit.insert(body, "inertial", label, **{name: numbers(value) for name, value in values.items()})
        return
    if change.moves:
        edit.set(inertial, f"{label}, inertial", pos=numbers(place))
    if change.scales:
        form = "fullinertia" if "fullinertia" in edit.tags[inertial].attributes else "diaginertia"
        values = np.array(edit.tags[inertial].attributes.get(form, "").split(), dtype=np.float64)
        edit.set(inertial, f"{label}, inertial", **{form: numbers(change.factor * values)})


def _set_joint(edit: XmlEdit, file: _File, number: int, target: RodTarget) -> None:
    """Set the attributes of a joint that differ from the target."""
    turn = math.degrees(1.0) if file.compiled.degrees else 1.0
    changed = {
        ATTRIBUTES.get(name, name): numbers([turn * after if name == "rest" else after])
        for name, (_, after) in joint_values(file.chain, number, target).items()
    }
    edit.set(file.tags(edit, number)[0], f"joint {file.chain.rods[number].joint.name}", **changed)


def _set_gear(edit: XmlEdit, file: _File, number: int, target: RodTarget) -> None:
    """Set the gear of the motor of a joint; the other five numbers of the attribute stay.

    Raises:
        ConfigError: the motor is not in the file itself.
    """
    rod = file.chain.rods[number]
    if rod.gear is None or target.gear is None or abs(target.gear - rod.gear) <= PATCH.negligible * abs(rod.gear):
        return
    name = rod.joint.name
    motors = (i for i, tag in enumerate(edit.tags) if tag.attributes.get("joint") == name)
    index = next((i for i in motors if edit.tags[edit.tags[i].parent].tag == "actuator"), None)
    if index is None:
        raise ConfigError(f"{file.path}: the motor of joint {name!r} is not in the file itself: move it into this file")
    further = edit.tags[index].attributes.get("gear", "").split()[1:]
    edit.set(index, f"motor of joint {name}", gear=" ".join([numbers([target.gear]), *further]))


def _lengthen(edit: XmlEdit, file: _File, longer: float) -> None:
    """Move the body of the outer rod along the inner rod."""
    (_, inner), (_, outer) = file.tags(edit, 0), file.tags(edit, 1)
    names = [rod.joint.name for rod in file.chain.rods]
    if edit.tags[outer].parent != inner:
        raise ConfigError(f"{file.path}: the body of {names[1]!r} is not a child of that of {names[0]!r}")
    frame = file.compiled.body(names[1])
    moved = file.compiled.body(names[0]).turned.T @ (longer * file.chain.rods[0].along)
    edit.set(outer, f"body {frame.name}", pos=numbers(frame.local_place + moved))
