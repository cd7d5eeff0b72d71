"""Write the corrected model into the user's MJCF file.

`dpr_lab.exports.into.target` lists the changed quantities.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import ARM
from dpr_lab.errors import ConfigError
from dpr_lab.exports.bodies import AnyModel, bodies, in_words, left_out
from dpr_lab.exports.into.passive import PassiveForces, passive_forces
from dpr_lab.exports.into.target import (
    PATCH,
    ArmTarget,
    BodyChange,
    PatchedModel,
    RodTarget,
    arm_change,
    arm_target,
    arm_to_change,
    body_change,
    joint_values,
    numbers,
    refuse_other_rig,
    refuse_overridden,
    rod_targets,
)
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.rig import Rig
from dpr_lab.simulator_models.chain import ChainArm, ChainRod, ModelChain
from dpr_lab.simulator_models.double_pendulum import double_pendulum
from dpr_lab.simulator_models.mjcf import SWITCHES, CompiledMjcf, compile_mjcf
from dpr_lab.simulator_models.tree import SimulatorModel, Vector
from dpr_lab.simulator_models.xml_edit import XmlEdit
from dpr_lab.simulator_models.xml_file import with_includes

WORDS = frozenset({"friction", "stiffness", "rest_angle", "armature", "offset", "added_length", "gear"})
"""Elements of effects that attributes of joints, bodies and motors can represent."""

ATTRIBUTES = {"friction": "frictionloss", "rest": "springref"}
"""Quantity of a joint -> its attribute in MJCF, where the names differ."""


@dataclass(frozen=True, slots=True)
class _File:
    """The user's file as it was read."""

    path: Path
    compiled: CompiledMjcf
    read: SimulatorModel
    chain: ModelChain
    joints: tuple[str, ...]

    def tags(self, edit: XmlEdit, name: str) -> tuple[int, int]:
        """Indices of a joint and of its body.

        Raises:
            ConfigError: the joint is not in the file itself.
        """
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
    names = tuple(part.joint.name for part in chain.parts)
    if unnamed := [name for name in names if name in compiled.unnamed]:
        raise ConfigError(f"{path}: {unnamed[0]!r} has no name in the file: give its <joint> a name")
    return _File(path, compiled, read, chain, names)


def into_mjcf(model: AnyModel, rig: Rig, path: Path, joints: Sequence[str] = ()) -> PatchedModel:
    """The user's file with the numbers of the corrected model.

    Args:
        model: the corrected or identified model
        rig: its rig, from the rig file that `dpr-lab rig from` wrote for this file
        path: the MJCF file
        joints: joints of the rods and of an arm, as for `double_pendulum`; empty: detected

    Raises:
        ConfigError: the file cannot be read or changed; its L1, g or L0 differs from that of the rig; it has other
            rods; or it has no arm although the arm of the model moves.
    """
    file = _read(path, joints)
    arm = arm_to_change(model, file.chain, rig, path)
    refuse_other_rig(file.chain, model.rig.L1, model.rig.g, path)
    expressed = {
        name: words for name, words in in_words(model, rig, WORDS).items() if "gear" not in words or _geared(file, name)
    }
    made = bodies(model, rig, expressed)
    edits = [XmlEdit(path.read_bytes(), str(path))]
    if longer := sum(words.get("added_length", 0.0) for words in expressed.values()):
        inner, outer = file.chain.rods
        _move(edits[0], file, (inner.joint.name, outer.joint.name), longer * inner.along)
        file = _read(path, file.joints, edits[0].text())
        edits.append(XmlEdit(edits[0].text(), str(path)))
    added = PassiveForces()
    if isinstance(model, Model):
        added = passive_forces(model, rig, expressed, file.chain, path.name)
    of_arm = arm_target(file.chain, arm, made, drive_gain(rig).value) if arm else None
    if arm and of_arm and abs(of_arm.length - arm.length) > PATCH.negligible:
        names = arm.joint.name, file.chain.rods[0].joint.name
        _move(edits[-1], file, names, (arm.length - of_arm.length) * file.chain.axis)
        file = _read(path, file.joints, edits[-1].text())
        edits.append(XmlEdit(edits[-1].text(), str(path)))
    targets = rod_targets(file.chain, made, added.friction)
    for number, target in enumerate(targets):
        rod = file.chain.rods[number]
        _set_body(edits[-1], file, rod, body_change(file.read, file.chain, file.joints, number, target, path))
        _set_joint(edits[-1], file, rod, target)
    if file.chain.arm and of_arm:
        _set_body(edits[-1], file, file.chain.arm, arm_change(file.read, file.chain.arm, of_arm, path))
        _set_joint(edits[-1], file, file.chain.arm, of_arm)
    text = edits[-1].text()
    reason = f"{path}: {_overriding(path)}"
    refuse_overridden(_read(path, file.joints, text).chain, targets, made.rods[0].length, WORDS, reason, of_arm)
    changes = tuple(change for edit in edits for change in edit.changes)
    return PatchedModel(text, changes, left_out(model, {*expressed, *added.effects}, "MJCF"), added)


def _overriding(path: Path) -> str:
    """Message on settings of the file that override the changed numbers, with a remedy."""
    root, switches = with_includes(path), {flag for flags in SWITCHES.values() for flag in flags}
    off = [
        f'<flag {name}="disable">'
        for flag in root.iter("flag")
        for name, state in flag.items()
        if state == "disable" and name in switches
    ]
    global_values = [
        f'<compiler {name}="{value}">'
        for compiler in root.iter("compiler")
        for name, value in compiler.items()
        if (name, value) == ("inertiafromgeom", "true") or name == "settotalmass"
    ]
    remedy = "save the compiled model with mj_saveLastXML, and change that"
    if off or global_values:
        remedy = f"remove it, or {remedy}" if global_values else "remove it, and repeat the command"
        return f"{' and '.join([*off, *global_values])} switches off or overrides the numbers to be changed: {remedy}"
    return f"a default class or compiler option overrides the changed numbers: {remedy}"


def _geared(file: _File, effect: str) -> bool:
    """Whether the joint of a torque constant has a motor with a gear that can be changed."""
    (joint,) = EFFECTS[effect].joints
    part = file.chain.arm if joint == ARM else file.chain.rods[joint]
    return part is not None and part.gear is not None


def _set_body(edit: XmlEdit, file: _File, part: ChainRod | ChainArm, change: BodyChange) -> None:
    """Move the centre of mass of a body and scale its inertia."""
    if not change.moves and not change.scales:
        return
    frame, (_, body) = file.compiled.body(part.joint.name), file.tags(edit, part.joint.name)
    place, label, inertial = (
        frame.local_centroid + frame.turned.T @ change.shift,
        f"body {frame.name}",
        edit.child(body, "inertial"),
    )
    if inertial is None:
        inertia = change.factor * frame.principal
        values = {"pos": place, "quat": frame.local_turn, "mass": [change.mass], "diaginertia": inertia}
        edit.insert(body, "inertial", f"{label}, inertial", **{name: numbers(value) for name, value in values.items()})
        return
    if change.moves:
        edit.set(inertial, f"{label}, inertial", pos=numbers(place))
    if change.scales:
        form = "fullinertia" if "fullinertia" in edit.tags[inertial].attributes else "diaginertia"
        values = np.array(edit.tags[inertial].attributes.get(form, "").split(), dtype=np.float64)
        edit.set(inertial, f"{label}, inertial", **{form: numbers(change.factor * values)})


def _set_joint(edit: XmlEdit, file: _File, part: ChainRod | ChainArm, target: RodTarget | ArmTarget) -> None:
    """Set the attributes of a joint and the gear of its motor that differ from the target."""
    turn = math.degrees(1.0) if file.compiled.degrees else 1.0
    changed = {
        ATTRIBUTES.get(name, name): numbers([turn * after if name == "rest" else after])
        for name, (_, after) in joint_values(part, target).items()
    }
    edit.set(file.tags(edit, part.joint.name)[0], f"joint {part.joint.name}", **changed)
    _set_gear(edit, file, part, target.gear)


def _set_gear(edit: XmlEdit, file: _File, part: ChainRod | ChainArm, gear: float | None) -> None:
    """Set the gear of the motor of a joint; the other five numbers of the attribute remain.

    Raises:
        ConfigError: the motor is not in the file itself.
    """
    if part.gear is None or gear is None or abs(gear - part.gear) <= PATCH.negligible * abs(part.gear):
        return
    name = part.joint.name
    motors = (i for i, tag in enumerate(edit.tags) if tag.attributes.get("joint") == name)
    index = next((i for i in motors if edit.tags[edit.tags[i].parent].tag == "actuator"), None)
    if index is None:
        raise ConfigError(f"{file.path}: the motor of joint {name!r} is not in the file itself: move it into this file")
    further = edit.tags[index].attributes.get("gear", "").split()[1:]
    edit.set(index, f"motor of joint {name}", gear=" ".join([numbers([gear]), *further]))


def _move(edit: XmlEdit, file: _File, joints: tuple[str, str], shift: Vector) -> None:
    """Shift the body of the second joint, a child of the body of the first, by a vector (3,) in the world frame, m.

    Raises:
        ConfigError: the second body is not a child of the first.
    """
    (_, carrier), (_, moved) = (file.tags(edit, name) for name in joints)
    if edit.tags[moved].parent != carrier:
        raise ConfigError(f"{file.path}: the body of {joints[1]!r} is not a child of that of {joints[0]!r}")
    frame = file.compiled.body(joints[1])
    place = frame.local_place + file.compiled.body(joints[0]).turned.T @ shift
    edit.set(moved, f"body {frame.name}", pos=numbers(place))
