"""Write the corrected model into the user's MJCF, URDF or SDFormat file.

Only numbers of the rods and the arm are changed.
"""

from collections.abc import Sequence
from pathlib import Path

from dpr_lab.exports.bodies import AnyModel
from dpr_lab.exports.into.editor import Editor
from dpr_lab.exports.into.mjcf import MjcfEditor
from dpr_lab.exports.into.model_file import changed_file
from dpr_lab.exports.into.sdf import SdfEditor
from dpr_lab.exports.into.target import PatchedModel
from dpr_lab.exports.into.urdf import UrdfEditor
from dpr_lab.rig import Rig
from dpr_lab.simulator_models import of_format

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
        ConfigError: the file cannot be read or changed, is of none of these formats, or its L1 or g is not that of the
            rig.
    """
    return changed_file(model, rig, of_format(EDITORS, path)(path), joints)
