"""Search for a device by its UID on all ports: `serial://?uid=UID`, `can://slcan?uid=UID`."""

import re
import time
from collections.abc import Callable, Iterable

from dpr_lab.errors import LinkError, LinkUrlError
from dpr_lab.transports.transport import Transport
from firmware_protocol.errors import RemoteProtocolError
from firmware_protocol.host_role import HostSession


def find(url: str, uid: str, ports: Iterable[str], open_port: Callable[[str], Transport]) -> Transport:
    """Return an open link to the device whose UID ends with the given digits.

    Args:
        url: URL given by the operator
        uid: digits of the UID, see `uid_digits`
        ports: ports to search; a handshake is tried on each
        open_port: function that opens a port by its name

    Raises:
        LinkUrlError: an option is not valid on any port.
        LinkError: the device is on none of the ports; the message lists the devices that were found.
    """
    met: list[str] = []
    for name in ports:
        try:
            link = open_port(name)
        except LinkUrlError:
            raise
        except LinkError as error:
            met.append(f"{name} ({str(error).removeprefix(f'{url}: ')})")
            continue
        try:
            uid_there = uid_at(link)
        except LinkError:
            uid_there = ""
        if uid_there.endswith(uid.lower()) and uid_there:
            return link
        link.close()
        met.append(f"{name} ({f'device {uid_there}' if uid_there else 'no DPR device'})")
    looked = f"searched {', '.join(met)}" if met else "no port was found"
    raise LinkError(f"{url}: no device whose UID ends in {uid}; {looked}: check cable and power")


def uid_digits(text: str) -> str:
    """Parse a UID, or its last digits, in hexadecimal form."""
    if not re.fullmatch("[0-9A-Fa-f]{4,16}", text):
        raise ValueError("is neither the UID of a device nor its last digits: give 4 to 16 hexadecimal digits")
    return text


def uid_at(link: Transport, timeout: float = 0.7) -> str:
    """Return the UID of the device on an open link, in hexadecimal form.

    The message HELLO is repeated every 0.1 s. The UID is empty if no device answers in this protocol within `timeout`
    s.

    Raises:
        DeviceLost: the link is lost.
    """
    session = HostSession()
    deadline = time.monotonic() + timeout
    link.send(session.hello(time.monotonic()))
    while session.outcome is None and time.monotonic() < deadline:
        for frame in link.receive(0.02).frames:
            try:
                session.receive(frame)
            except RemoteProtocolError:
                continue
        for frame in session.due(time.monotonic()):
            link.send(frame)
    return session.info.uid if session.info is not None else ""
