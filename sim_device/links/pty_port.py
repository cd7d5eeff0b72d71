"""Serial port as a pseudo-terminal.

It is non-blocking, and remains open when the host disconnects.
"""

import errno
import fcntl
import os
import select
import struct
import sys
import time
import tty

# struct termios2 of Linux allows every rate; termios of the standard library allows only constants such as B9600
_TCGETS2, _TCSETS2 = 0x802C542A, 0x402C542B
_TERMIOS2 = struct.Struct("4I20s2I")
_CBAUD, _BOTHER = 0o010017, 0o010000


class PtyPort:
    """Serial port: the master end of a pseudo-terminal in raw mode.

    A pseudo-terminal ignores the baud rate, but a UART does not. If the host has set another rate than the device, both
    directions therefore transmit noise, so that the host can distinguish a wrong rate from silence. If the rate of the
    host is unknown (not Linux, or `baud` None), every rate is accepted.
    """

    def __init__(self, baud: int | None) -> None:
        self.baud = baud if sys.platform.startswith("linux") else None
        self._master, slave = os.openpty()
        os.set_blocking(self._master, False)
        tty.setraw(slave)
        if self.baud is not None:
            _set_baud(slave, self.baud)
        self.path = os.ttyname(slave)
        # the slave end is closed: a hang-up on the master then indicates that no host has opened the port
        os.close(slave)

    @property
    def connected(self) -> bool:
        """Whether a host has opened the slave end."""
        return not self._poll(select.POLLIN, 0.0) & select.POLLHUP

    @property
    def _garbled(self) -> bool:
        return self.baud is not None and _baud(self._master) != self.baud

    def read(self) -> bytes:
        """Return the bytes that the host has written; noise at the wrong baud rate."""
        try:
            data = os.read(self._master, 65536)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EIO):
                return b""
            raise
        if data and self._garbled:
            self.write(data)
            return os.urandom(len(data))
        return data

    def write(self, data: bytes | bytearray) -> int:
        """Write and return the number of accepted bytes.

        Without a host all bytes are lost, as with an unplugged cable.
        """
        if not self.connected:
            return len(data)
        try:
            return os.write(self._master, os.urandom(len(data)) if self._garbled else data)
        except OSError as error:
            if error.errno == errno.EAGAIN:
                return 0
            raise

    def wait(self, timeout: float, to_write: bool) -> None:
        """Wait for bytes from the host, for room to write if `to_write`, or for `timeout` s."""
        if self._poll(select.POLLIN | (select.POLLOUT if to_write else 0), timeout) & select.POLLHUP:
            time.sleep(min(timeout, 0.02))  # a pty without a host does not support waiting

    def _poll(self, events: int, timeout: float) -> int:
        poll = select.poll()
        poll.register(self._master, events)
        events_ready = poll.poll(1000 * timeout)
        return events_ready[0][1] if events_ready else 0

    def close(self) -> None:
        """Close the port.

        The host's end then fails, as with an unplugged cable.
        """
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
