"""CAN adapter with Lawicel's ASCII protocol over a serial port: `can://slcan/dev/ttyACM0?bitrate=1000000`.

This implementation replaces that of python-can, which parses each line byte by byte and takes a third of the time of a
processor core at 1 kHz.
"""

import re
import time

from dpr_lab.errors import DeviceLost, LinkUrlError
from dpr_lab.transports.serial_port import SerialPort
from dpr_lab.transports.transport import Capacity, Received
from firmware_protocol.framing import encode_frame
from firmware_protocol.messages import Frame

BITRATE_LETTERS = {
    10_000: b"S0",
    20_000: b"S1",
    50_000: b"S2",
    100_000: b"S3",
    125_000: b"S4",
    250_000: b"S5",
    500_000: b"S6",
    800_000: b"S7",
    1_000_000: b"S8",
}
LONGEST_LINE = 64
"""Maximum length of a line of an adapter, bytes. A frame has 22; a longer line is noise."""

_FRAME = re.compile(rb"t([0-7][0-9A-Fa-f]{2})([0-8])([0-9A-Fa-f]{0,16})")
_NO_FRAME = re.compile(rb"(|[zZ]|[VNF][0-9A-Za-z]*|[TrR][0-9A-Fa-f]*)")
"""Pattern of lines without a frame for this host: answers of the adapter, and extended and remote frames of other
nodes."""


class SlcanDecoder:
    """Decoder of the frames in the bytes from an adapter.

    The bytes may arrive in pieces of any length.
    """

    def __init__(self) -> None:
        self.errors = 0
        """Number of damaged lines."""
        self._rest = b""

    def feed(self, data: bytes) -> list[Frame]:
        """Decode received bytes and return the frames of the lines that are now complete."""
        *lines, incomplete = (self._rest + data).replace(b"\a", b"\r").split(b"\r")
        if len(incomplete) > LONGEST_LINE:
            self.errors += 1
            incomplete = b""
        self._rest = incomplete
        return [frame for line in lines if (frame := self._frame(line)) is not None]

    def _frame(self, line: bytes) -> Frame | None:
        parts = _FRAME.fullmatch(line)
        if parts is not None and len(parts[3]) == 2 * int(parts[2]):
            return Frame(int(parts[1], 16), bytes.fromhex(parts[3].decode("ascii")))
        self.errors += not _NO_FRAME.fullmatch(line)
        return None


class SlcanBus:
    """`Transport` over one adapter, whose port is used exclusively by this process.

    Args:
        url: URL given by the operator
        path: serial port of the adapter
        bitrate: bit rate of the bus, bit/s
        tty_baud: baud rate of the port, bit/s
        settle: boot time of the adapter after its port is opened, s
        capacities: capacities of bus and port

    Raises:
        LinkUrlError: slcan does not define the bit rate.
        LinkError: unknown or busy port.
    """

    def __init__(
        self, url: str, path: str, bitrate: int, tty_baud: int, settle: float, capacities: tuple[Capacity, ...]
    ) -> None:
        if bitrate not in BITRATE_LETTERS:
            rates = ", ".join(map(str, BITRATE_LETTERS))
            raise LinkUrlError(f"{url}: an slcan adapter does not run at {bitrate} bit/s: choose one of {rates}")
        self.url, self.capacities = url, capacities
        self._port = SerialPort(url, path, tty_baud)
        self._decoder = SlcanDecoder()
        time.sleep(settle)
        self._port.write(b"C\r" + BITRATE_LETTERS[bitrate] + b"\rO\r")

    @property
    def errors(self) -> dict[str, int]:
        """Number of damaged lines so far, by cause."""
        return {"crc": 0, "framing": self._decoder.errors}

    def send(self, frame: Frame) -> None:
        """Send one frame."""
        self._port.write(b"t%03X%d%s\r" % (frame.id, len(frame.data), frame.data.hex().upper().encode("ascii")))

    def receive(self, timeout: float) -> Received:
        """Return all frames that have arrived; wait at most `timeout` s for the first byte."""
        frames = self._decoder.feed(self._port.read(timeout))
        return Received(time.monotonic(), tuple(frames), b"".join(map(encode_frame, frames)))

    def close(self) -> None:
        """Leave the bus and close the port; repeated calls have no effect."""
        try:
            self._port.write(b"C\r")
        except DeviceLost:
            pass  # the adapter is already lost, or was closed before
        self._port.close()
