"""TCP connection: `socket://192.168.1.20:5555`.

This client replaces `socket://` of pyserial, whose value `in_waiting` is only 0 or 1. pyserial also discards data that
arrive while the connection opens or closes.
"""

import select
import socket
from pathlib import Path

from dpr_lab.errors import DeviceLost, LinkError, LinkUrlError
from dpr_lab.transports.bytes_link import BytesLink
from dpr_lab.transports.url import LinkUrl


def open_tcp(url: LinkUrl, rig_file: Path | None) -> BytesLink:
    """Connect to a device that listens on TCP.

    Raises:
        LinkUrlError: the URL contains no address.
        LinkError: no program accepts the connection at this address.
    """
    url.options({})
    host, _, port = url.host.rpartition(":")
    if not host or not port.isdigit() or not 0 < int(port) < 65_536 or url.path not in ("", "/"):
        raise LinkUrlError(f"{url.text}: use socket://HOST:PORT, for example socket://192.168.1.20:5555")
    return BytesLink(url.text, TcpPort(url.text, host.strip("[]"), int(port)))


class TcpPort:
    """Byte port over a TCP connection."""

    def __init__(self, url: str, host: str, port: int, connect_timeout: float = 3.0, send_timeout: float = 1.0) -> None:
        self._url = url
        try:
            self._socket = socket.create_connection((host, port), timeout=connect_timeout)
        except OSError as error:
            reason = error.strerror or str(error)
            raise LinkError(f"{url}: no connection ({reason}): check address, port and power") from error
        self._socket.settimeout(send_timeout)
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def read(self, timeout: float) -> bytes:
        """Return all bytes that have arrived; wait at most `timeout` s for the first byte."""
        try:
            ready, _, _ = select.select([self._socket], [], [], timeout)
            data = self._socket.recv(65_536) if ready else None
        except (OSError, ValueError) as error:  # ValueError: the descriptor was closed
            raise self._lost(str(error)) from error
        if data == b"":
            raise self._lost("closed by the device")
        return data or b""

    def write(self, data: bytes) -> None:
        """Send all of `data`."""
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise self._lost(str(error)) from error

    def close(self) -> None:
        """Close the connection."""
        self._socket.close()

    def _lost(self, reason: str) -> DeviceLost:
        return DeviceLost(f"{self._url}: the connection is lost ({reason}): check network and power")
