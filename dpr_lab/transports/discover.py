"""Search for the serial ports, CAN interfaces and CAN backends of this computer."""

import fnmatch
import glob
import os
from dataclasses import dataclass
from pathlib import Path

from serial.tools import list_ports

JOIN_GROUP = "add yourself to the ports' group (sudo usermod -aG dialout $USER) and log in again"


@dataclass(frozen=True, slots=True)
class SerialPortFound:
    """A serial port of this computer."""

    device: str
    """Text after `serial://` in a URL."""
    description: str
    serial_number: str
    """USB serial number; empty if the port has none. Unlike the device path, the number does not change when devices
    are plugged in again."""
    problem: str
    """Reason why the port cannot be used, with a remedy; empty if it can be used."""


@dataclass(frozen=True, slots=True)
class Links:
    """Links of this computer, as found by `discover`."""

    serial: tuple[SerialPortFound, ...]
    can_interfaces: tuple[str, ...]
    """Network interfaces that `can://socketcan/NAME` can open."""
    can_backends: tuple[str, ...]
    """Backends of python-can. The backend for a vendor's adapters also needs the driver of this vendor."""


def discover() -> Links:
    """Find the links of this computer without opening a link."""
    return Links(serial_ports(), can_interfaces(), can_backends())


def serial_ports() -> tuple[SerialPortFound, ...]:
    """Return the serial ports of this computer, sorted by name."""
    return tuple(
        SerialPortFound(port.device, port.description or "", port.serial_number or "", _problem(port.device))
        for port in sorted(list_ports.comports())
    )


def matching_ports(pattern: str) -> list[str]:
    """Return the serial ports whose name matches a pattern with the wildcard `*`.

    An empty pattern selects all ports that can be opened. A name without `*` is returned unchanged. The ports of
    Windows, such as COM3, are not files, so they are searched in the list of ports.
    """
    if "*" in pattern:
        listed = fnmatch.filter([port.device for port in serial_ports()], pattern)
        return sorted({*glob.glob(pattern), *listed})
    return [pattern] if pattern else [port.device for port in serial_ports() if not port.problem]


def can_interfaces(root: Path = Path("/sys/class/net")) -> tuple[str, ...]:
    """Return the CAN interfaces of the Linux kernel; empty on other systems."""
    arphrd_can = "280"
    return tuple(sorted(kind.parent.name for kind in root.glob("*/type") if kind.read_text().strip() == arphrd_can))


def can_backends() -> tuple[str, ...]:
    """Return the names for `can://NAME/CHANNEL`."""
    from can.interfaces import BACKENDS

    return tuple(sorted(BACKENDS))


def _problem(device: str) -> str:
    path = Path(device)
    if not path.exists() or os.access(device, os.R_OK | os.W_OK):
        return ""
    return f"no permission: {JOIN_GROUP}"
