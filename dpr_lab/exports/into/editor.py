"""Define the editors that read and write the numbers of one file format."""

from abc import ABC, abstractmethod
from pathlib import Path
from typing import ClassVar

from dpr_lab.exports.into.target import BodyChange, Target
from dpr_lab.simulator_models.chain import ChainArm, ChainRod
from dpr_lab.simulator_models.tree import SimulatorModel, Vector
from dpr_lab.simulator_models.xml_edit import XmlEdit


class Editor(ABC):
    """Editor of the user's file."""

    name: ClassVar[str]
    """Name of the format."""
    words: ClassVar[frozenset[str]]
    """Elements of effects that its files can contain."""
    passive: ClassVar[bool] = True
    """Whether MuJoCo reads files of this format. A module can then apply further effects as passive forces."""

    def __init__(self, path: Path) -> None:
        self.path = path

    @abstractmethod
    def read(self, text: bytes) -> SimulatorModel:
        """Read the model from the content `text` instead of the content of the file."""

    @abstractmethod
    def move_joint(self, edit: XmlEdit, joints: tuple[str, str], shift: Vector) -> None:
        """Shift the second joint relative to the first by a (3,) vector, m.

        The vector is in the world frame.
        """

    @abstractmethod
    def set_body(self, edit: XmlEdit, joint: str, change: BodyChange) -> None:
        """Move the centre of mass of a joint's body, and scale its inertia."""

    @abstractmethod
    def set_joint(self, edit: XmlEdit, part: ChainRod | ChainArm, target: Target) -> None:
        """Set the quantities of a joint that differ from the target."""

    @abstractmethod
    def overriding(self) -> str:
        """Compose the message for a file whose other settings override the written numbers."""
