"""Write the corrected model into the user's own MJCF, URDF or SDFormat file.

Only numbers of the rods and the arm are changed.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from dpr_lab.errors import ConfigError
from dpr_lab.exports.bodies import AnyModel
from dpr_lab.exports.into.description import into_description
from dpr_lab.exports.into.mjcf import WORDS as MJCF_WORDS
from dpr_lab.exports.into.mjcf import into_mjcf
from dpr_lab.exports.into.sdf import SdfEditor
from dpr_lab.exports.into.target import PatchedModel
from dpr_lab.exports.into.urdf import UrdfEditor
from dpr_lab.rig import Rig
from dpr_lab.simulator_models.sdf import read_sdf
from dpr_lab.simulator_models.urdf import read_urdf
from dpr_lab.simulator_models.xml_file import read_xml

Writer = Callable[[AnyModel, Rig, Path, Sequence[str]], PatchedModel]

WRITERS: dict[str, Writer] = {
    "mujoco": into_mjcf,
    "robot": partial(into_description, name="URDF", read=read_urdf, editor=UrdfEditor()),
    "sdf": partial(into_description, name="SDFormat", read=read_sdf, editor=SdfEditor()),
}
"""Root element of a file -> function that writes the corrected model into such a file."""


WORDS: dict[str, frozenset[str]] = {"MJCF": MJCF_WORDS, "URDF": UrdfEditor.words, "SDFormat": SdfEditor.words}
"""Format -> elements of effects that its files can contain."""


def into_file(model: AnyModel, rig: Rig, path: Path, joints: Sequence[str] = ()) -> PatchedModel:
    """The user's file with the numbers of the corrected model.

    The root element of the file determines its format.

    Args:
        model: the corrected or identified model
        rig: its rig, as `dpr-lab rig from` wrote it from this file
        path: the file
        joints: names of the joints of inner rod, outer rod and optionally the arm; empty: detected

    Raises:
        ConfigError: the file cannot be read or changed, is of none of these formats, or its L1 or g is not that of the
            rig.
    """
    tag = read_xml(path).tag
    if tag not in WRITERS:
        raise ConfigError(f"{path}: its root element is <{tag[:50]}>; MJCF has <mujoco>, URDF <robot>, SDFormat <sdf>")
    return WRITERS[tag](model, rig, path, joints)
