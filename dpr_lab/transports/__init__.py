"""Links to a device: serial port, TCP, CAN bus and simulated device.

All of them implement `transport.Transport`.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.errors import LinkUrlError
from dpr_lab.plugins.rows import plugin_rows
from dpr_lab.transports.url import LinkUrl, parse_url

if TYPE_CHECKING:
    from dpr_lab.transports.transport import Transport


@dataclass(frozen=True, slots=True)
class LinkKind:
    """Kind of link: the transport of a URL scheme."""

    name: str
    """Description for the operator."""
    opener: str
    """Location of the function that opens the link, `module:function`. The module is imported on demand, so
    that only the libraries of this link are needed. The function receives the parsed URL and the rig file, and returns
    a `Transport`."""
    example: str
    """Example of a URL for error messages and help."""


TRANSPORTS: dict[str, LinkKind] = {
    "serial": LinkKind(
        "serial port", "dpr_lab.transports.serial_port:open_serial", "serial:///dev/ttyUSB0?baud=921600"
    ),
    "can": LinkKind("CAN", "dpr_lab.transports.can_bus:open_can", "can://socketcan/can0?bitrate=1000000"),
    "socket": LinkKind("TCP", "dpr_lab.transports.tcp:open_tcp", "socket://192.168.1.20:5555"),
    "sim": LinkKind("simulated rig", "dpr_lab.transports.simulated:open_simulated", "sim://?plant=paper&seed=1"),
}
TRANSPORTS |= plugin_rows("transports", LinkKind, TRANSPORTS)
"""Kind of link for each URL scheme. A new kind of link requires one module and one entry in this table."""


def open_transport(url: str, *, rig_file: Path | None = None) -> Transport:
    """Open the link given by a URL.

    Args:
        url: scheme://place?option=value, see the examples in `TRANSPORTS`
        rig_file: rig of a simulated device; other links ignore it

    Raises:
        LinkUrlError: the URL is not valid, for example an unknown scheme or option.
        LinkError: the link cannot be opened.
    """
    link = known_link(url)
    module, function = TRANSPORTS[link.scheme].opener.split(":")
    return getattr(import_module(module), function)(link, rig_file)


def known_link(url: str) -> LinkUrl:
    """Parse a link URL of a known kind.

    Raises:
        LinkUrlError: the text is not a link URL, or its scheme is unknown.
    """
    link = parse_url(url)
    if link.scheme not in TRANSPORTS:
        known = ", ".join(kind.example for kind in TRANSPORTS.values())
        raise LinkUrlError(f"{url}: unknown kind of link {link.scheme!r}; use for example: {known}")
    return link
