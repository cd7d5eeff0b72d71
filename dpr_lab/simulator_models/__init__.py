"""Models of simulators (MJCF, URDF, SDFormat), read as a double pendulum.

Each reader turns a file into a `SimulatorModel`: parts, joints and gravity at the zero of all joints. `double_pendulum`
finds the two rods in it, and an arm where there is one.
"""

from collections.abc import Callable
from pathlib import Path

from dpr_lab.errors import ConfigError
from dpr_lab.simulator_models.mjcf import read_mjcf
from dpr_lab.simulator_models.sdf import read_sdf
from dpr_lab.simulator_models.tree import SimulatorModel
from dpr_lab.simulator_models.urdf import read_urdf
from dpr_lab.simulator_models.xml_file import read_xml

READERS: dict[str, Callable[[Path], SimulatorModel]] = {"mujoco": read_mjcf, "robot": read_urdf, "sdf": read_sdf}
"""Outermost element of a file -> its reader."""


def read_model(path: Path) -> SimulatorModel:
    """Read a model of MuJoCo, URDF or SDFormat; its outermost element says which of them it is.

    Raises:
        ConfigError: the file cannot be read, is none of these formats, or its library is not installed.
    """
    root = read_xml(path)
    if root.tag not in READERS:
        raise ConfigError(
            f"{path}: its outermost element is <{root.tag[:50]}>; MJCF has <mujoco>, URDF <robot>, SDFormat <sdf>"
        )
    return READERS[root.tag](path)
