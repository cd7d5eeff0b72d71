"""Edit the numbers in SDFormat files, which are texts of elements.

Source: http://sdformat.org/spec (link, joint, axis).
"""

import numpy as np

from dpr_lab.errors import ConfigError
from dpr_lab.exports.into.description import DescriptionEditor
from dpr_lab.exports.into.target import numbers
from dpr_lab.simulator_models.sdf import read_sdf
from dpr_lab.simulator_models.tree import SimulatorModel, Vector
from dpr_lab.simulator_models.xml_edit import XmlEdit


class SdfEditor(DescriptionEditor):
    """Editor of SDFormat files."""

    name = "SDFormat"
    passive = False  # MuJoCo cannot read SDFormat
    words = frozenset({"friction", "stiffness", "rest_angle", "offset", "added_length"})
    joint_names = {  # noqa: RUF012
        "damping": "damping",
        "friction": "friction",
        "stiffness": "spring_stiffness",
        "rest": "spring_reference",
    }

    def read(self, text: bytes) -> SimulatorModel:
        """Read the links and joints of the content `text`."""
        return read_sdf(self.path, text)

    def place(self, edit: XmlEdit, owner: int) -> Vector:
        """Return the coordinates (3,) of an element that has a position, m."""
        return np.array(_pose(edit, owner)[:3], dtype=np.float64)

    def set_place(self, edit: XmlEdit, owner: int, label: str, place: Vector) -> None:
        """Set the coordinates (3,) of an element, m."""
        pose, values = edit.child(owner, "pose"), _pose(edit, owner)
        text = " ".join([numbers(place), *values[3:]])
        if pose is None:
            edit.insert_texts(owner, label, pose=text)
        else:
            edit.set_text(pose, label, text)

    def scale_inertia(self, edit: XmlEdit, inertial: int, label: str, factor: float) -> None:
        """Multiply the inertia of an element by a factor.

        If the file contains no inertia, the default of the format is multiplied: 1 kg m^2 about each axis.
        """
        inertia = edit.child(inertial, "inertia")
        if inertia is None:
            moments = dict.fromkeys(("ixx", "iyy", "izz"), numbers([factor]))
            edit.insert_texts(inertial, f"{label}, inertia", within="inertia", **moments, ixy="0", ixz="0", iyz="0")
            return
        for index, tag in enumerate(edit.tags):
            if tag.parent == inertia and float(tag.text):
                edit.set_text(index, f"{label}, inertia", numbers([factor * float(tag.text)]))

    def set_values(self, edit: XmlEdit, joint: int, label: str, values: dict[str, str]) -> None:
        """Set quantities of a joint, by their names in the format.

        Raises:
            ConfigError: the joint has no axis.
        """
        axis = edit.child(joint, "axis")
        if axis is None:
            raise ConfigError(f"{label} has no <axis> element: add this element")
        dynamics = edit.child(axis, "dynamics")
        if dynamics is None:
            required = {"spring_reference": "0", "spring_stiffness": "0"} | values
            edit.insert_texts(axis, label, within="dynamics", **required)
            return
        missing = {}
        for name, value in values.items():
            index = edit.child(dynamics, name)
            if index is None:
                missing[name] = value
            else:
                edit.set_text(index, f"{label}, dynamics", value)
        if missing:
            edit.insert_texts(dynamics, f"{label}, dynamics", **missing)

    def elbow_owner(self, joint: int, link: int) -> int:
        """Return the index of the outer link, whose frame positions the outer joint."""
        return link


def _pose(edit: XmlEdit, owner: int) -> list[str]:
    """Return position and rotation of an element as texts of the file."""
    pose = edit.child(owner, "pose")
    values = edit.tags[pose].text.split() if pose is not None else []
    return values or ["0", "0", "0", "0", "0", "0"]
