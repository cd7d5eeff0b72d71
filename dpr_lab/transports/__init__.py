"""Links to a device: serial port, TCP, CAN bus, simulated device; each hidden behind `transport.Transport`."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.errors import LinkUrlError
from dpr_lab.transports.url import parse_url

if TYPE_CHECKING:
    from dpr_lab.transports.transport import Transport

TRANSPORTS = {
    "serial": "dpr_lab.transports.serial_port:open_serial",
    "can": "dpr_lab.transports.can_bus:open_can",
    "socket": "dpr_lab.transports.tcp:open_tcp",
    "sim": "dpr_lab.transports.simulated:open_simulated",
}
"""URL scheme -> `module:function`, imported on demand so that one link's library never costs another's user."""

EXAMPLES = {
    "serial": "serial:///dev/ttyUSB0?baud=921600",
    "can": "can://socketcan/can0?bitrate=1000000",
    "socket": "socket://192.168.1.20:5555",
    "sim": "sim://?plant=paper&seed=1",
}
"""One URL of each scheme, as the error messages and the help show it."""


def open_transport(url: str, *, rig_file: Path | None = None) -> Transport:
    """Open the link that a URL names.

    Args:
        url: scheme://place?option=value, see `EXAMPLES`
        rig_file: the rig that a simulated device is to be; other links ignore it

    Raises:
        LinkUrlError: the URL is not written right, such as an unknown scheme or option.
        LinkError: the link cannot be opened.
    """
    parsed = parse_url(url)
    if parsed.scheme not in TRANSPORTS:
        raise LinkUrlError(f"{url}: unknown kind of link {parsed.scheme!r}; known are: {', '.join(EXAMPLES.values())}")
    module, function = TRANSPORTS[parsed.scheme].split(":")
    return getattr(import_module(module), function)(parsed, rig_file)
