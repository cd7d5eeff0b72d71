"""Serial port (pyserial): `serial:///dev/ttyUSB0?baud=921600`, `serial://COM3`."""

import errno
import time
from dataclasses import dataclass
from pathlib import Path

import serial

from dpr_lab.errors import DeviceLost, LinkError, LinkUrlError
from dpr_lab.transports import by_uid
from dpr_lab.transports.bytes_link import BytesLink
from dpr_lab.transports.discover import JOIN_GROUP, matching_ports, serial_ports
from dpr_lab.transports.transport import Capacity, Transport
from dpr_lab.transports.url import LinkUrl, whole_number


@dataclass(frozen=True, slots=True)
class SerialSettings:
    """Settings of a serial port, and the number of bits that a sample takes."""

    baud: int = 921_600
    """Default baud rate."""
    sample_bits: int = 14 * 10
    """Number of bits of a sample: identifier, eight data bytes, CRC, COBS overhead and delimiter, each byte with start
    and stop bit."""
    read_slice_s: float = 0.05
    """Timeout of pyserial, s. It is fixed, because changing it reconfigures the port and can corrupt data."""
    write_timeout_s: float = 3.0
    """Time after which a port that accepts no bytes counts as lost, s."""


SERIAL = SerialSettings()

# Exceptions of pyserial for an unplugged device: its own one, a bare OSError(EIO) from in_waiting, or a TypeError
# if another thread closed the descriptor.
_GONE = (serial.SerialException, OSError, TypeError)


def open_serial(url: LinkUrl, rig_file: Path | None) -> Transport:
    """Open a serial port for exclusive use by this process.

    The option `uid` selects a device by its UID, or by its last digits, on any port. If the name of the port contains a
    `*`, only matching ports are tried, as in `serial:///dev/ttyACM*?uid=51d000000001`.

    Raises:
        LinkUrlError: no port is given, or an option is not valid.
        LinkError: unknown port or device, no permission, busy port, or unsupported baud rate.
    """
    options = url.options({"baud": whole_number, "uid": by_uid.uid_digits})
    baud, name = options.get("baud", SERIAL.baud), url.host + url.path
    if "uid" in options:
        return by_uid.find(url.text, options["uid"], matching_ports(name), lambda port: _open_port(url, port, baud))
    if not name:
        raise LinkUrlError(f"{url.text}: contains no port; {_ports_found()}")
    return _open_port(url, name, baud)


def _open_port(url: LinkUrl, name: str, baud: int) -> BytesLink:
    remedy = f"{SERIAL.baud} baud" if baud < SERIAL.baud else "a faster link"
    capacity = Capacity(f"{baud} baud", baud, SERIAL.sample_bits, remedy)
    return BytesLink(url.text, SerialPort(url.text, name, baud), (capacity,))


class SerialPort:
    """Byte port over pyserial that reads in blocks."""

    def __init__(self, url: str, name: str, baud: int) -> None:
        self._url = url
        try:
            self._serial = serial.Serial(
                name, baud, timeout=SERIAL.read_slice_s, write_timeout=SERIAL.write_timeout_s, exclusive=True
            )
        except (OSError, ValueError) as error:
            raise LinkError(f"{url}: {_why_not_opened(name, baud, error)}") from error

    def read(self, timeout: float) -> bytes:
        """Return all received bytes; wait at most about `timeout` s for the first one."""
        deadline = time.monotonic() + timeout
        try:
            while True:
                data = self._serial.read(self._serial.in_waiting or 1)
                if data:
                    return data + self._serial.read(self._serial.in_waiting)
                if time.monotonic() >= deadline:
                    return b""
        except _GONE as error:
            raise self._lost(error) from error

    def write(self, data: bytes) -> None:
        """Send all of `data`."""
        try:
            self._serial.write(data)
        except _GONE as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Close the port."""
        self._serial.close()

    def _lost(self, error: BaseException) -> DeviceLost:
        return DeviceLost(
            f"{self._url}: the port is lost ({_why_lost(error)}): check cable and power, then connect again"
        )


def _why_lost(error: BaseException) -> str:
    if isinstance(error, serial.SerialTimeoutException):
        return "it accepts no more bytes"
    code = error.errno if isinstance(error, OSError) else None
    return "unplugged" if code in (None, errno.EIO, errno.ENXIO, errno.ENODEV, errno.EBADF) else str(error)


def _why_not_opened(name: str, baud: int, error: Exception) -> str:
    code = error.errno if isinstance(error, OSError) else None
    if code in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return f"there is no port {name}; {_ports_found()}"
    if code in (errno.EAGAIN, errno.EBUSY):
        return f"the port is in use by another program: close that program (`fuser {name}` shows it)"
    if code == errno.EACCES:
        return f"no permission to open {name}: {JOIN_GROUP}"
    if Path(name).exists() and not Path(name).is_char_device():
        return f"{name} is not a serial port; {_ports_found()}"
    return f"cannot be opened at {baud} baud: {error}"


def _ports_found() -> str:
    names = [port.device for port in serial_ports()]
    return f"found: {', '.join(names)}" if names else "no serial port was found: check the cable"
