"""Edit the numbers in URDF and SDFormat files.

The coordinates of an element can refer to any frame. The influence of a coordinate on a position in the world frame is
therefore determined numerically. The file is read again with a changed coordinate; positions are linear in each
coordinate.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import ClassVar

import numpy as np

from dpr_lab.errors import ConfigError
from dpr_lab.exports.into.target import BodyChange, Target, joint_values, numbers
from dpr_lab.simulator_models.chain import ChainArm, ChainRod
from dpr_lab.simulator_models.tree import SimulatorModel, Vector
from dpr_lab.simulator_models.xml_edit import XmlEdit


class DescriptionEditor(ABC):
    """Common part of the editors of URDF and SDFormat files."""

    name: ClassVar[str]
    """Name of the format."""
    words: ClassVar[frozenset[str]]
    """Elements of effects that its files can contain."""
    passive: ClassVar[bool] = True
    """Whether MuJoCo reads files of this format. A module can then apply further effects as passive forces."""
    joint_names: ClassVar[dict[str, str]]
    """Names of the quantities of a joint in the format."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @abstractmethod
    def read(self, text: bytes) -> SimulatorModel:
        """Read the links and joints from the content `text` instead of the content of the file."""

    @abstractmethod
    def place(self, edit: XmlEdit, owner: int) -> Vector:
        """Return the coordinates (3,) of an element that has a position."""

    @abstractmethod
    def set_place(self, edit: XmlEdit, owner: int, label: str, place: Vector) -> None:
        """Set the coordinates of an element."""

    @abstractmethod
    def scale_inertia(self, edit: XmlEdit, inertial: int, label: str, factor: float) -> None:
        """Multiply the inertia of an element by a factor."""

    @abstractmethod
    def set_values(self, edit: XmlEdit, joint: int, label: str, values: dict[str, str]) -> None:
        """Set quantities of a joint, by their names in the format."""

    @abstractmethod
    def elbow_owner(self, joint: int, link: int) -> int:
        """Return the index of the element whose position determines the position of the outer joint."""

    def move_joint(self, edit: XmlEdit, joints: tuple[str, str], shift: Vector) -> None:
        """Shift the second joint by moving the element that contains its position."""
        joint = joints[1]
        owner = self.elbow_owner(self._element(edit, "joint", joint), self._link(edit, joint))

        def anchor(changed: SimulatorModel) -> Vector:
            joint_in_file = changed.moved_by(joint).joint
            assert joint_in_file is not None
            return joint_in_file.anchor

        element = edit.tags[owner]
        self._move(edit, owner, f"{element.tag} {element.attributes['name']}", anchor, shift)

    def set_body(self, edit: XmlEdit, joint: str, change: BodyChange) -> None:
        """Change the inertial element of the link that a joint moves."""
        if not change.moves and not change.scales:
            return
        inertial, label = edit.child(self._link(edit, joint), "inertial"), f"link {change.name}"
        if inertial is None:
            raise ConfigError(f"{self.path}: link {change.name!r} has no <inertial> element: add this element")
        if change.scales:
            self.scale_inertia(edit, inertial, label, change.factor)
        if change.moves:
            self._move(edit, inertial, label, lambda changed: changed.moved_by(joint).centroid, change.shift)

    def set_joint(self, edit: XmlEdit, part: ChainRod | ChainArm, target: Target) -> None:
        """Set the quantities that the format can contain, where they differ from the target."""
        values = joint_values(part, target)
        texts = {self.joint_names[key]: numbers([v]) for key, (_, v) in values.items() if key in self.joint_names}
        if texts:
            name = part.joint.name
            self.set_values(edit, self._element(edit, "joint", name), f"joint {name}", texts)

    def overriding(self) -> str:
        """Return the message for a file that does not contain the written numbers when it is read again."""
        return (
            f"{self.path}: the changed file does not contain the written numbers when it is read again: change the file"
            " by hand"
        )

    def _element(self, edit: XmlEdit, tag: str, name: str) -> int:
        """Return the index of a joint or link.

        Raises:
            ConfigError: the element is not in the file itself.
        """
        index = edit.find(tag, name=name)
        if index is None:
            raise ConfigError(f"{self.path}: no <{tag} name={name!r}> is in the file itself")
        return index

    def _link(self, edit: XmlEdit, joint: str) -> int:
        """Return the index of the link that a joint moves."""
        return self._element(edit, "link", self.read(edit.text()).moved_by(joint).name)

    def _move(
        self, edit: XmlEdit, owner: int, label: str, measure: Callable[[SimulatorModel], Vector], shift: Vector
    ) -> None:
        """Move an element so that a derived position shifts by `shift` (3,), m.

        `measure` returns this position for a changed model, in the world frame.
        """
        place = self.place(edit, owner)

        def measured(point: Vector) -> Vector:
            tried = XmlEdit(edit.text(), str(self.path))
            self.set_place(tried, owner, label, point)
            return measure(self.read(tried.text()))

        before, step = measured(place), 0.1
        slopes = np.array([(measured(place + step * unit) - before) / step for unit in np.eye(3)]).T
        if abs(np.linalg.det(slopes)) < 0.5:
            raise ConfigError(f"{self.path}: the position of {label} is defined elsewhere: change it by hand")
        moved = place + np.linalg.solve(slopes, shift)
        self.set_place(edit, owner, label, np.where(np.abs(moved) < 1e-12, 0.0, moved))
