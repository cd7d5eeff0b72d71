"""Write the corrected model into the user's MJCF, URDF or SDFormat file.

Only numbers of the rods and the arm are changed. `dpr_lab.exports.into.target` lists the changed quantities. An
`Editor` reads and writes the numbers of one format.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeAlias

from dpr_lab.effects import EFFECTS
from dpr_lab.errors import ConfigError
from dpr_lab.exports.bodies import bodies, in_words, left_out
from dpr_lab.exports.into.description import DescriptionEditor
from dpr_lab.exports.into.in_file import hinge
from dpr_lab.exports.into.mjcf import MjcfEditor
from dpr_lab.exports.into.passive import PassiveForces, passive_forces
from dpr_lab.exports.into.sdf import SdfEditor
from dpr_lab.exports.into.target import (
    PATCH,
    PatchedModel,
    Target,
    arm_change,
    arm_target,
    arm_to_change,
    body_change,
    refuse_other_rig,
    refuse_overridden,
    rod_targets,
)
from dpr_lab.exports.into.urdf import UrdfEditor
from dpr_lab.exports.rigid_bodies import added_length
from dpr_lab.identification.model import Model
from dpr_lab.identification.moving_arm.model import AnyModel
from dpr_lab.identification.moving_arm.setup import drive_gain
from dpr_lab.rig import Rig
from dpr_lab.simulator_models import of_format
from dpr_lab.simulator_models.chain import ChainArm, ChainRod, ModelChain
from dpr_lab.simulator_models.double_pendulum import double_pendulum
from dpr_lab.simulator_models.tree import SimulatorModel, Vector
from dpr_lab.simulator_models.xml_edit import ChangedAttribute, XmlEdit

Editor: TypeAlias = MjcfEditor | DescriptionEditor

EDITORS: dict[str, type[Editor]] = {"mujoco": MjcfEditor, "robot": UrdfEditor, "sdf": SdfEditor}
"""Editors of file formats, by the root element of the file."""

WORDS: dict[str, frozenset[str]] = {editor.name: editor.words for editor in EDITORS.values()}
"""Elements of effects that files can contain, by format."""


def into_file(model: AnyModel, rig: Rig, path: Path, joints: Sequence[str] = ()) -> PatchedModel:
    """Return the content of the user's file with the numbers of the corrected model.

    The root element of the file determines its format.

    Args:
        model: the corrected or identified model
        rig: rig of the model, which `dpr-lab rig from` wrote from this file
        path: the file
        joints: names of the joints of inner rod, outer rod and optionally the arm; empty: detected

    Raises:
        ConfigError: the file cannot be read or changed, or is of none of these formats; its L1, g or L0 differs from
            that of the rig; a rod has a rotor that the format cannot change; it has other rods; the model was
            identified from the inner rod alone; or it has no arm although the arm of the model moves.
    """
    editor, text, changes = of_format(EDITORS, path)(path), path.read_bytes(), list[ChangedAttribute]()
    read, chain = _read(editor, text, joints, model.rig.g)
    if isinstance(model, Model) and model.fitted:
        raise ConfigError(
            f"{path}: the model was identified from the inner rod alone, so the outer rod of the file cannot be"
            " corrected: identify from recordings of both rods"
        )
    arm = arm_to_change(model, chain, rig, path)
    refuse_other_rig(chain, model.rig.L1, model.rig.g, path)
    driven = [rod.joint.name for rod in chain.rods if rod.joint.armature]
    if driven and "armature" not in editor.words:
        raise ConfigError(
            f"{path}: the rotor inertia of joint {driven[0]!r} (drake:rotor_inertia) cannot be changed in"
            f" {editor.name}: use a copy of the file without this inertia"
        )
    expressed = {
        name: words
        for name, words in in_words(model, rig, editor.words).items()
        if "gear" not in words or hinge(chain, *EFFECTS[name].joints).gear is not None
    }
    corrected = bodies(model, rig, expressed)
    of_arm = arm_target(chain, arm, corrected, drive_gain(rig).value) if arm else None
    longer = added_length(expressed)
    for pair, shift in _moves(chain, longer, of_arm):
        text = _edited(editor, text, changes, editor.move_joint, pair, shift)
        read, chain = _read(editor, text, joints, model.rig.g)
    added = PassiveForces()
    if isinstance(model, Model) and editor.passive:
        gravity = model.rig.g if read.gravity is None else None
        added = passive_forces(model, rig, expressed, chain, path.name, gravity)
    of_rods = rod_targets(chain, corrected, added.friction)
    hinges: list[tuple[ChainRod | ChainArm, Target]] = [*zip(chain.rods, of_rods, strict=True)]
    if chain.arm and of_arm:
        hinges.append((chain.arm, of_arm))
    body_changes = [
        body_change(read, chain, joints, number, target, path)
        if isinstance(part, ChainRod)
        else arm_change(read, part, target, path)
        for number, (part, target) in enumerate(hinges)
    ]
    for (part, target), change in zip(hinges, body_changes, strict=True):
        text = _edited(editor, text, changes, editor.set_body, part.joint.name, change)
        text = _edited(editor, text, changes, editor.set_joint, part, target)
    _, chain = _read(editor, text, joints, model.rig.g)
    targets = [target for _, target in hinges]
    refuse_overridden(chain, targets, corrected.rods[0].length, editor.words, editor.overriding())
    return PatchedModel(text, tuple(changes), left_out(model, {*expressed, *added.effects}, editor.name), added)


def _read(editor: Editor, text: bytes, joints: Sequence[str], gravity: float) -> tuple[SimulatorModel, ModelChain]:
    """Read the model of a file, and find its double pendulum.

    `gravity`, m/s^2, is used if the format does not contain gravity.
    """
    read = editor.read(text)
    try:
        return read, double_pendulum(read, joints, gravity if read.gravity is None else None)
    except ConfigError as error:
        raise ConfigError(f"{editor.path}: {error}") from error


def _moves(chain: ModelChain, longer: float, of_arm: Target | None) -> list[tuple[tuple[str, str], Vector]]:
    """List the joints that must be shifted.

    Each entry contains the names of a joint and of the next joint, and the shift of the next joint in the world frame,
    m. The inner rod becomes longer by `longer`, m, and the arm gets its target length.
    """
    moves = list[tuple[tuple[str, str], Vector]]()
    if longer:
        inner, outer = chain.rods
        moves.append(((inner.joint.name, outer.joint.name), longer * inner.along))
    if chain.arm and of_arm and abs(of_arm.length - chain.arm.length) > PATCH.negligible:
        shift = (chain.arm.length - of_arm.length) * chain.axis
        moves.append(((chain.arm.joint.name, chain.rods[0].joint.name), shift))
    return moves


def _edited(
    editor: Editor, text: bytes, changes: list[ChangedAttribute], step: Callable[..., None], *arguments: object
) -> bytes:
    """Apply one step of the editor to a text, add the changed attributes to `changes`, and return the new text."""
    edit = XmlEdit(text, str(editor.path))
    step(edit, *arguments)
    changes += edit.changes
    return edit.text()
