"""Detection of links that may lead to a simulated device.

The time of such a device may differ from real time.
"""

import os
import re
from ipaddress import ip_address

from dpr_lab.errors import LinkUrlError
from dpr_lab.transports.discover import matching_ports
from dpr_lab.transports.url import LinkUrl, parse_url

_PSEUDO_TERMINAL = re.compile(r"/dev/(pts/\d+|ttys\d+)")
"""Pattern of the names of pseudo-terminals on Linux and macOS."""


def leads_to_software(url: str) -> bool:
    """Return whether a URL leads to software on this computer.

    This is the case for a simulated device, a pseudo-terminal, a loopback address or a virtual bus. A link over a
    serial port, over an adapter or to another computer does not count, even if the device declares simulated time.
    """
    try:
        link = parse_url(url)
    except LinkUrlError:
        return False
    match link.scheme:
        case "sim":
            return True
        case "serial":
            return _is_pseudo_terminal(link.host + link.path)
        case "socket":
            return _is_loopback(link.host)
        case "can":
            return _is_virtual_bus(link)
        case _:
            return False


def _is_pseudo_terminal(pattern: str) -> bool:
    ports = matching_ports(pattern)
    return bool(ports) and all(_PSEUDO_TERMINAL.fullmatch(os.path.realpath(port)) for port in ports)


def _is_loopback(place: str) -> bool:
    host = place.rpartition(":")[0].strip("[]")
    try:
        return host == "localhost" or ip_address(host).is_loopback
    except ValueError:
        return False


def _is_virtual_bus(link: LinkUrl) -> bool:
    if link.host == "slcan":
        return _is_pseudo_terminal(link.path)
    return link.host == "virtual" or (link.host == "socketcan" and link.path.startswith("/vcan"))
