"""Read simulator models (MJCF, URDF, SDFormat), and find the double pendulum in a model.

Each reader converts a file to a `SimulatorModel`, which contains parts, joints and gravity with all joints at zero.
`double_pendulum` finds the two rods in this model, and the arm if there is one.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TypeVar

from dpr_lab.errors import ConfigError
from dpr_lab.simulator_models.mjcf import read_mjcf
from dpr_lab.simulator_models.sdf import read_sdf
from dpr_lab.simulator_models.tree import SimulatorModel
from dpr_lab.simulator_models.urdf import read_urdf
from dpr_lab.simulator_models.xml_file import read_xml

Format = TypeVar("Format")

READERS: dict[str, Callable[[Path, bytes | None], SimulatorModel]] = {
    "mujoco": read_mjcf,
    "robot": read_urdf,
    "sdf": read_sdf,
}
"""Functions that read a file, by the root element of the file."""


def read_model(path: Path, text: bytes | None = None) -> SimulatorModel:
    """Read an MJCF, URDF or SDFormat file.

    The root element of the file determines its format.

    Args:
        path: the file
        text: content that is read instead of the content of the file; None: the content of the file

    Raises:
        ConfigError: the file cannot be read, is none of these formats, or its library is not installed.
    """
    return of_format(READERS, path, text)(path, text)


def of_format(formats: Mapping[str, Format], path: Path, text: bytes | None = None) -> Format:
    """Return the entry of a table for the root element of a file.

    Raises:
        ConfigError: the file cannot be read, or the table does not contain its root element.
    """
    tag = read_xml(path, text).tag
    if tag not in formats:
        raise ConfigError(f"{path}: its root element is <{tag[:50]}>; MJCF has <mujoco>, URDF <robot>, SDFormat <sdf>")
    return formats[tag]
