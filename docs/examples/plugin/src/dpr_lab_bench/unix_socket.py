"""Link: the serial protocol over a Unix socket, `unix:///run/rig.sock`."""

import socket
from pathlib import Path

from dpr_lab.errors import DeviceLost, LinkError, LinkUrlError
from dpr_lab.transports import LinkKind
from dpr_lab.transports.bytes_link import BytesLink
from dpr_lab.transports.url import LinkUrl


def open_unix(url: LinkUrl, rig_file: Path | None) -> BytesLink:
    """Connect to a device that listens on a Unix socket.

    Raises:
        LinkUrlError: no path in the URL.
        LinkError: nothing listens there.
    """
    url.options({})
    if url.host or len(url.path) < 2:
        raise LinkUrlError(f"{url.text}: use unix:///PATH, for example {LINK.example}")
    return BytesLink(url.text, UnixPort(url.text, url.path))


class UnixPort:
    """Byte port over a Unix socket."""

    def __init__(self, url: str, path: str) -> None:
        self._url = url
        try:
            self._socket = socket.socket(socket.AF_UNIX)
            self._socket.connect(path)
        except (AttributeError, OSError) as error:  # AttributeError: this system has no such sockets
            raise LinkError(f"{url}: no connection ({error}): start the program of the device first") from error

    def read(self, timeout: float) -> bytes:
        """All bytes that have arrived, waiting at most `timeout` s for the first."""
        self._socket.settimeout(max(timeout, 1e-3))
        try:
            data = self._socket.recv(65_536)
        except TimeoutError:
            return b""
        except OSError as error:
            raise self._lost() from error
        if not data:
            raise self._lost()
        return data

    def write(self, data: bytes) -> None:
        """Send all of `data`."""
        try:
            self._socket.sendall(data)
        except OSError as error:
            raise self._lost() from error

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _lost(self) -> DeviceLost:
        return DeviceLost(f"{self._url}: the connection is lost: look at the program of the device")


LINK = LinkKind("Unix socket", "dpr_lab_bench.unix_socket:open_unix", "unix:///run/rig.sock")
