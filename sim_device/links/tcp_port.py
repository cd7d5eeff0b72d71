"""TCP port on the loopback interface for one host.

It is non-blocking, and remains open when the host disconnects.
"""

import select
import socket
from contextlib import suppress

from dpr_lab.errors import LinkError


class TcpServerPort:
    """TCP server on the loopback interface, for one host at a time."""

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        host = host or "127.0.0.1"
        if host not in ("127.0.0.1", "localhost"):
            raise LinkError(
                f"tcp:{address}: the simulated device listens on this machine only:"
                f" write tcp:{port} or tcp:127.0.0.1:{port}"
            )
        if not port.isdecimal() or int(port) > 65535:
            raise LinkError(f"tcp:{address}: {port!r} is not a port number: write tcp:5555, or tcp:0 for any free port")
        self._server = _listen(int(port))
        self.number = self._server.getsockname()[1]
        self._host: socket.socket | None = None

    @property
    def connected(self) -> bool:
        """Whether a host is connected."""
        if self._host is None:
            with suppress(BlockingIOError):
                self._host, _ = self._server.accept()
                self._host.setblocking(False)
                self._host.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return self._host is not None

    def read(self) -> bytes:
        """Return the bytes that the host has sent."""
        if not self.connected:
            return b""
        assert self._host is not None
        try:
            data = self._host.recv(65536)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._hang_up()
        return data

    def write(self, data: bytes | bytearray) -> int:
        """Write and return the number of accepted bytes.

        Without a host all bytes are lost.
        """
        if not self.connected:
            return len(data)
        assert self._host is not None
        try:
            return self._host.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self._hang_up()
            return len(data)

    def wait(self, timeout: float, to_write: bool) -> None:
        """Wait for a connection, for bytes from the host, for room to write if `to_write`, or for `timeout` s."""
        end = self._host or self._server
        select.select([end], [end] if to_write and self._host else [], [], timeout)

    def _hang_up(self) -> None:
        assert self._host is not None
        self._host.close()
        self._host = None

    def close(self) -> None:
        """Disconnect the host and stop listening."""
        if self._host is not None:
            self._hang_up()
        self._server.close()


def _listen(port: int) -> socket.socket:
    server = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        server.bind(("127.0.0.1", port))
    except OSError as error:
        server.close()
        raise LinkError(
            f"tcp:{port}: cannot listen on 127.0.0.1:{port}: {error.strerror}: choose another port"
        ) from error
    server.listen(1)
    server.setblocking(False)
    return server
