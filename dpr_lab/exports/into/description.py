"""Write the corrected model into the user's URDF or SDFormat file.

`dpr_lab.exports.into.target` lists the changed quantities. The coordinates of an element can refer to any frame. The
influence of a coordinate is therefore determined numerically: the file is read again with a changed coordinate, and
positions are linear in each coordinate.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

import numpy as np

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
from dpr_lab.simulator_models.tree import Part, SimulatorModel, Vector
from dpr_lab.simulator_models.xml_edit import XmlEdit

Read = Callable[[Path, bytes | None], SimulatorModel]


class Editor(Protocol):
    """Interface of a description format: its names of quantities, and functions that read and write its numbers."""

    words: frozenset[str]
    """Elements of effects that it supports."""
    joint_names: dict[str, str]
    """Quantity of a joint -> its name in the format."""

    def place(self, edit: XmlEdit, owner: int) -> Vector:
        """(3,) coordinates of an element that has a position."""
        ...

    def set_place(self, edit: XmlEdit, owner: int, label: str, place: Vector) -> None:
        """Set the coordinates of an element."""
        ...

    def scale_inertia(self, edit: XmlEdit, inertial: int, label: str, factor: float) -> None:
        """Multiply the inertia of an element by a factor."""
        ...

    def set_joint(self, edit: XmlEdit, joint: int, label: str, values: dict[str, str]) -> None:
        """Set quantities of a joint, by their names in the format."""
        ...

    def elbow_owner(self, joint: int, link: int) -> int:
        """Index of the element whose position determines the position of the outer joint."""
        ...


@dataclass(frozen=True, slots=True)
class _File:
    path: Path
    name: str
    """Name of the format."""
    read: Read
    editor: Editor
    joints: tuple[str, ...]
    gravity: float | None
    """Gravity for a format that does not contain it, m/s^2; None if it does."""

    def model(self, edit: XmlEdit) -> SimulatorModel:
        return self.read(self.path, edit.text())

    def chain(self, model: SimulatorModel) -> ModelChain:
        try:
            return double_pendulum(model, self.joints, self.gravity if model.gravity is None else None)
        except ConfigError as error:
            raise ConfigError(f"{self.path}: {error}") from error

    def editable(self, text: bytes) -> XmlEdit:
        return XmlEdit(text, str(self.path))

    def joint(self, edit: XmlEdit, name: str) -> int:
        """Index of the element of a joint.

        Raises:
            ConfigError: the element is not in the file itself.
        """
        index = edit.find("joint", name=name)
        if index is None:
            raise ConfigError(f"{self.path}: no <joint name={name!r}> is in the file itself")
        return index

    def link(self, edit: XmlEdit, part: Part) -> int:
        """Index of the element of a link; errors are those of `joint`."""
        index = edit.find("link", name=part.name)
        if index is None:
            raise ConfigError(f"{self.path}: no <link name={part.name!r}> is in the file itself")
        return index


def into_description(
    model: AnyModel, rig: Rig, path: Path, joints: Sequence[str], name: str, read: Read, editor: Editor
) -> PatchedModel:
    """The user's file with the numbers of the corrected model.

    Args:
        model: the corrected or identified model
        rig: its rig, as `dpr-lab rig from` wrote it from this file
        path: the file
        joints: joints of the rods and of an arm, as for `double_pendulum`; empty: detected
        name: name of the format
        read: function that reads the file
        editor: functions that read and write its numbers

    Raises:
        ConfigError: the file cannot be read or changed; its L1, g or L0 differs from that of the rig; a rod has a
            rotor; it has other rods; or it has no arm although the arm of the model moves.
    """
    file = _File(path, name, read, editor, tuple(joints), model.rig.g)
    edit = file.editable(path.read_bytes())
    chain = file.chain(file.model(edit))
    arm = arm_to_change(model, chain, rig, path)
    refuse_other_rig(chain, model.rig.L1, model.rig.g, path)
    if driven := [rod.joint.name for rod in chain.rods if rod.joint.armature]:
        raise ConfigError(
            f"{path}: the rotor inertia of joint {driven[0]!r} (drake:rotor_inertia) cannot be changed in {name}:"
            " use a copy of the file without it"
        )
    expressed = in_words(model, rig, editor.words)
    made = bodies(model, rig, expressed)
    changes = []
    of_arm = arm_target(chain, arm, made, drive_gain(rig).value) if arm else None
    moved: list[tuple[str, Vector]] = []
    if longer := sum(words.get("added_length", 0.0) for words in expressed.values()):
        inner, outer = chain.rods
        moved.append((outer.joint.name, longer * inner.along))
    if arm and of_arm and abs(of_arm.length - arm.length) > PATCH.negligible:
        moved.append((chain.rods[0].joint.name, (arm.length - of_arm.length) * chain.axis))
    for joint, shift in moved:
        edit = _with_moved_joint(file, edit, joint, shift)
        changes += edit.changes
        edit = file.editable(edit.text())
        chain = file.chain(file.model(edit))
    added = PassiveForces()
    if isinstance(model, Model) and name == "URDF":  # MuJoCo cannot read SDFormat
        added = passive_forces(model, rig, expressed, chain, path.name, model.rig.g)
    targets = rod_targets(chain, made, added.friction)
    hinges: list[tuple[ChainRod | ChainArm, RodTarget | ArmTarget]] = list(zip(chain.rods, targets, strict=True))
    if chain.arm and of_arm:
        hinges.append((chain.arm, of_arm))
    for hinge, target in hinges:
        joint = hinge.joint.name
        edit = _with_body(file, edit, joint, _change(file, edit, joint, target))
        changes += edit.changes
        edit = file.editable(edit.text())
        values = joint_values(hinge, target)
        words = {editor.joint_names[key]: numbers([v]) for key, (_, v) in values.items() if key in editor.joint_names}
        if words:
            editor.set_joint(edit, file.joint(edit, joint), f"joint {joint}", words)
            changes += edit.changes
            edit = file.editable(edit.text())
    reason = (
        f"{path}: the changed file does not contain the written numbers when it is read again: change the file by hand"
    )
    refuse_overridden(file.chain(file.model(edit)), targets, made.rods[0].length, editor.words, reason, of_arm)
    return PatchedModel(edit.text(), tuple(changes), left_out(model, {*expressed, *added.effects}, name), added)


def _part(model: SimulatorModel, joint: str) -> Part:
    return next(part for part in model.parts if part.joint is not None and part.joint.name == joint)


def _with_moved_joint(file: _File, edit: XmlEdit, joint: str, shift: Vector) -> XmlEdit:
    """Shift a joint relative to its parent part by a vector (3,) in the world frame, m."""
    model = file.model(edit)
    owner = file.editor.elbow_owner(file.joint(edit, joint), file.link(edit, _part(model, joint)))

    def anchor(changed: SimulatorModel) -> Vector:
        joint_in_file = _part(changed, joint).joint
        assert joint_in_file is not None
        return joint_in_file.anchor

    element = edit.tags[owner]
    return _moved(file, edit, owner, f"{element.tag} {element.attributes['name']}", anchor, shift)


def _change(file: _File, edit: XmlEdit, joint: str, target: RodTarget | ArmTarget) -> BodyChange:
    """Change of the body at a joint after which it has the target values."""
    model = file.model(edit)
    chain = file.chain(model)
    if isinstance(target, ArmTarget):
        assert chain.arm is not None
        return arm_change(model, chain.arm, target, file.path)
    number = [rod.joint.name for rod in chain.rods].index(joint)
    return body_change(model, chain, file.joints, number, target, file.path)


def _with_body(file: _File, edit: XmlEdit, joint: str, change: BodyChange) -> XmlEdit:
    """Change the body of a joint: move its centre of mass and scale its inertia."""
    model = file.model(edit)
    if not change.moves and not change.scales:
        return edit
    link = file.link(edit, _part(model, joint))
    inertial, label = edit.child(link, "inertial"), f"link {change.name}"
    if inertial is None:
        raise ConfigError(f"{file.path}: link {change.name!r} has no <inertial> element: add this element")
    if change.scales:
        file.editor.scale_inertia(edit, inertial, label, change.factor)
    if not change.moves:
        return edit
    return _moved(file, edit, inertial, label, lambda changed: _part(changed, joint).centroid, change.shift)


def _moved(
    file: _File, edit: XmlEdit, owner: int, label: str, measure: Callable[[SimulatorModel], Vector], shift: Vector
) -> XmlEdit:
    """Move an element so that a position derived from it shifts by a vector (3,) in the world frame, m."""
    place = file.editor.place(edit, owner)

    def measured(point: Vector) -> Vector:
        tried = file.editable(edit.text())
        file.editor.set_place(tried, owner, label, point)
        return measure(file.model(tried))

    before, step = measured(place), 0.1
    slopes = np.array([(measured(place + step * unit) - before) / step for unit in np.eye(3)]).T
    if abs(np.linalg.det(slopes)) < 0.5:
        raise ConfigError(f"{file.path}: the position of {label} is defined elsewhere: change it by hand")
    moved = place + np.linalg.solve(slopes, shift)
    file.editor.set_place(edit, owner, label, np.where(np.abs(moved) < 1e-12, 0.0, moved))
    return edit
