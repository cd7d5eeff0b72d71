"""Edit the numbers in URDF files, which are attributes of elements.

Source: https://wiki.ros.org/urdf/XML (link, joint).
"""

import numpy as np

from dpr_lab.exports.into.description import DescriptionEditor
from dpr_lab.exports.into.target import numbers
from dpr_lab.simulator_models.tree import SimulatorModel, Vector
from dpr_lab.simulator_models.urdf import read_urdf
from dpr_lab.simulator_models.xml_edit import XmlEdit

INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


class UrdfEditor(DescriptionEditor):
    """Editor of URDF files."""

    name = "URDF"
    words = frozenset({"friction", "offset", "added_length"})
    joint_names = {"damping": "damping", "friction": "friction"}  # noqa: RUF012

    def read(self, text: bytes) -> SimulatorModel:
        """Read the links and joints of the content `text`."""
        return read_urdf(self.path, text)

    def place(self, edit: XmlEdit, owner: int) -> Vector:
        """Return the coordinates (3,) of an element that has a position, m."""
        origin = edit.child(owner, "origin")
        text = "" if origin is None else edit.tags[origin].attributes.get("xyz", "")
        return np.array((text or "0 0 0").split(), dtype=np.float64)

    def set_place(self, edit: XmlEdit, owner: int, label: str, place: Vector) -> None:
        """Set the coordinates (3,) of an element, m."""
        origin = edit.child(owner, "origin")
        if origin is None:
            edit.insert(owner, "origin", label, xyz=numbers(place))
        else:
            edit.set(origin, f"{label}, origin", xyz=numbers(place))

    def scale_inertia(self, edit: XmlEdit, inertial: int, label: str, factor: float) -> None:
        """Multiply the inertia of an element by a factor."""
        inertia = edit.child(inertial, "inertia")
        if inertia is not None:
            tensor = {name: float(edit.tags[inertia].attributes.get(name, "0")) for name in INERTIA}
            scaled = {name: numbers([factor * value]) for name, value in tensor.items() if value}
            edit.set(inertia, f"{label}, inertia", **scaled)

    def set_values(self, edit: XmlEdit, joint: int, label: str, values: dict[str, str]) -> None:
        """Set quantities of a joint, by their names in the format."""
        dynamics = edit.child(joint, "dynamics")
        if dynamics is None:
            edit.insert(joint, "dynamics", label, **values)
        else:
            edit.set(dynamics, f"{label}, dynamics", **values)

    def elbow_owner(self, joint: int, link: int) -> int:
        """Return the index of the outer joint; the element of this joint contains its position."""
        return joint
