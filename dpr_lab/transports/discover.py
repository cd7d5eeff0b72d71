"""What links this computer has: serial ports and CAN backends."""

import glob
import os
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

from serial.tools import list_ports

JOIN_GROUP = "add yourself to the ports' group (sudo usermod -aG dialout $USER) and log in again"


@dataclass(frozen=True, slots=True)
class SerialPortFound:
    """A serial port of this computer."""

    device: str
    """What to write after `serial://`."""
    description: str
    serial_number: str
    """The USB serial number, which stays when the device path changes; empty when it has none."""
    problem: str
    """Why it cannot be used as it is, and what to do; empty when it can."""


@dataclass(frozen=True, slots=True)
class Links:
    """Result of `discover`."""

    serial: tuple[SerialPortFound, ...]
    can_interfaces: tuple[str, ...]
    """Network interfaces that `can://socketcan/NAME` can open."""
    can_backends: tuple[str, ...]
    """Backends of python-can; those for vendors' adapters also need the vendor's driver."""


def discover() -> Links:
    """Look for links; opens none."""
    return Links(serial_ports(), can_interfaces(), can_backends())


def serial_ports() -> tuple[SerialPortFound, ...]:
    """The serial ports of this computer, in order of their names."""
    return tuple(
        SerialPortFound(port.device, port.description or "", port.serial_number or "", _problem(port.device))
        for port in sorted(list_ports.comports())
    )


def matching_ports(pattern: str) -> list[str]:
    """Serial ports that match a name with `*`; for an empty name all that can be opened."""
    return sorted(glob.glob(pattern)) if pattern else [port.device for port in serial_ports() if not port.problem]


def can_interfaces(root: Path = Path("/sys/class/net")) -> tuple[str, ...]:
    """CAN network interfaces of a Linux kernel; none elsewhere."""
    arphrd_can = "280"
    return tuple(sorted(kind.parent.name for kind in root.glob("*/type") if kind.read_text().strip() == arphrd_can))


def can_backends() -> tuple[str, ...]:
    """Names that `can://NAME/CHANNEL` accepts; none when python-can is not installed."""
    if find_spec("can") is None:
        return ()
    from can.interfaces import BACKENDS

    return tuple(sorted(BACKENDS))


def _problem(device: str) -> str:
    path = Path(device)
    if not path.exists() or os.access(device, os.R_OK | os.W_OK):
        return ""
    return f"no permission: {JOIN_GROUP}"
