"""Write the corrected model into the user's MJCF, URDF or SDFormat file.

Only numbers of the rods and the arm are changed.
"""

from collections.abc import Callable, Sequence
from pathlib import Path

from dpr_lab.errors import ConfigError
from dpr_lab.exports.bodies import AnyModel
from dpr_lab.exports.into.mjcf import MjcfEditor
from dpr_lab.exports.into.model_file import Editor, changed_file
from dpr_lab.exports.into.sdf import SdfEditor
from dpr_lab.exports.into.target import PatchedModel
from dpr_lab.exports.into.urdf import UrdfEditor
from dpr_lab.rig import Rig
from dpr_lab.simulator_models.xml_file import read_xml

EDITORS: dict[str, Callable[[Path], Editor]] = {"mujoco": MjcfEditor, "robot": UrdfEditor, "sdf": SdfEditor}
"""Editors of file formats, by the root element of the file."""

WORDS: dict[str, frozenset[str]] = {editor.name: editor.words for editor in (MjcfEditor, UrdfEditor, SdfEditor)}
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
    tag = read_xml(path).tag
    if tag not in EDITORS:
        raise ConfigError(f"{path}: its root element is <{tag[:50]}>; MJCF has <mujoco>, URDF <robot>, SDFormat <sdf>")
    return changed_file(model, rig, EDITORS[tag](path), joints)
