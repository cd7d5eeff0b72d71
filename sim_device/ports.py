"""Byte ports: where a host connects. Non-blocking, and still there when the host comes back."""

import errno
import fcntl
import os
import select
import socket
import struct
import sys
import time
import tty
from contextlib import suppress
from typing import Protocol

from dpr_lab.errors import LinkError

READ_BYTES = 65536
UNPLUGGED_POLL = 0.02
"""How often to look whether a host has opened the pty, s; a pty without a host cannot be waited on."""

# Linux's struct termios2 carries every rate; termios of the standard library knows only those in the B... table.
_TCGETS2, _TCSETS2 = 0x802C542A, 0x402C542B
_TERMIOS2 = struct.Struct("4I20s2I")
_CBAUD, _BOTHER = 0o010017, 0o010000


class Port(Protocol):
    """A byte stream to at most one host."""

    @property
    def connected(self) -> bool:
        """Whether a host has the port open."""
        ...

    def read(self) -> bytes:
        """The bytes that have arrived, without waiting."""
        ...

    def write(self, data: bytes | bytearray) -> int:
        """How many of the bytes were taken, without waiting."""
        ...

    def wait(self, timeout: float, to_write: bool) -> None:
        """Return when there is something to read, room to write if asked for, or after `timeout` seconds."""
        ...

    def close(self) -> None:
        """Take the port away from the host."""
        ...


class PtyPort:
    """A serial port: the master end of a pseudo terminal in raw mode.

    A pseudo terminal ignores the baud rate, a UART does not: when the host has set another rate than the device's, both
    directions carry noise, and noise answers what the host sends, so that a wrong rate shows as more than silence.
    Where the host's rate cannot be known (no Linux, or `baud` None) every rate is right.
    """

    def __init__(self, baud: int | None) -> None:
        self.baud = baud if sys.platform.startswith("linux") else None
        self._master, slave = os.openpty()
        os.set_blocking(self._master, False)
        tty.setraw(slave)
        if self.baud is not None:
            _set_baud(slave, self.baud)
        self.path = os.ttyname(slave)
        # Not kept open: a hang-up on the master then tells that no host has the port open.
        os.close(slave)

    @property
    def connected(self) -> bool:
        """Whether a host has the slave end open."""
        return not self._poll(select.POLLIN, 0.0) & select.POLLHUP

    @property
    def _garbled(self) -> bool:
        return self.baud is not None and _baud(self._master) != self.baud

    def read(self) -> bytes:
        """The bytes the host has written; noise at the wrong baud rate."""
        try:
            data = os.read(self._master, READ_BYTES)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EIO):
                return b""
            raise
        if data and self._garbled:
            self.write(data)
            return os.urandom(len(data))
        return data

    def write(self, data: bytes | bytearray) -> int:
        """How many bytes were taken; without a host they are gone, as on an unplugged cable."""
        if not self.connected:
            return len(data)
        try:
            return os.write(self._master, os.urandom(len(data)) if self._garbled else data)
        except OSError as error:
            if error.errno == errno.EAGAIN:
                return 0
            raise

    def wait(self, timeout: float, to_write: bool) -> None:
        """Wait for the host's bytes, for room if `to_write`, or for `timeout` seconds."""
        if self._poll(select.POLLIN | (select.POLLOUT if to_write else 0), timeout) & select.POLLHUP:
            time.sleep(min(timeout, UNPLUGGED_POLL))

    def _poll(self, events: int, timeout: float) -> int:
        poll = select.poll()
        poll.register(self._master, events)
        found = poll.poll(1000 * timeout)
        return found[0][1] if found else 0

    def close(self) -> None:
        """Hang up: the host's end fails from now on, as when the cable is pulled."""
        os.close(self._master)


def _baud(terminal: int) -> int:
    state = bytearray(_TERMIOS2.size)
    fcntl.ioctl(terminal, _TCGETS2, state)
    return _TERMIOS2.unpack(state)[-1]


def _set_baud(terminal: int, baud: int) -> None:
    state = bytearray(_TERMIOS2.size)
    fcntl.ioctl(terminal, _TCGETS2, state)
    iflag, oflag, cflag, lflag, line, *_ = _TERMIOS2.unpack(state)
    cflag = cflag & ~_CBAUD | _BOTHER
    fcntl.ioctl(terminal, _TCSETS2, _TERMIOS2.pack(iflag, oflag, cflag, lflag, line, baud, baud))


class TcpPort:
    """A TCP server on the loopback interface, for one host at a time."""

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
        """The bytes the host has sent."""
        if not self.connected:
            return b""
        assert self._host is not None
        try:
            data = self._host.recv(READ_BYTES)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._hang_up()
        return data

    def write(self, data: bytes | bytearray) -> int:
        """How many bytes were taken; without a host they are gone."""
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
        """Wait for a connection, the host's bytes, room if `to_write`, or for `timeout` seconds."""
        end = self._host or self._server
        select.select([end], [end] if to_write and self._host else [], [], timeout)

    def _hang_up(self) -> None:
        assert self._host is not None
        self._host.close()
        self._host = None

    def close(self) -> None:
        """Drop the host and stop listening."""
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
