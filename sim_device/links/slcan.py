"""CAN adapter with Lawicel's ASCII protocol ("SLCAN"), as used by the `slcan` backend of python-can."""

import re

from firmware_protocol.messages import Frame

BITRATES = (10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000)
"""Bit rates that the commands S0 to S8 select, bit/s."""

LONGEST_LINE = 64
"""Maximum length of a line, bytes. More bytes without a carriage return are not SLCAN and are dropped."""

_DATA_FRAME = re.compile(rb"([0-7][0-9A-Fa-f]{2})([0-8])([0-9A-Fa-f]*)")

OK, REFUSED = b"\r", b"\a"


class SlcanCodec:
    """Codec with one CAN frame per line: `tIIILDD..` and a carriage return.

    III is the identifier, L the length, and DD the data in hexadecimal digits. The adapter transmits frames while its
    channel is open and set to the bit rate of the bus. Extended and remote frames are acknowledged and discarded,
    because no node on this bus uses them.

    Source: Lawicel CAN232 manual, list of commands.
    """

    def __init__(self, bitrate: int) -> None:
        self._bus_bitrate = bitrate
        self._bitrate = bitrate
        self._open = False
        self._line = bytearray()

    @property
    def _on_bus(self) -> bool:
        return self._open and self._bitrate == self._bus_bitrate

    def encode(self, frame: Frame) -> bytes:
        """Return the line that the host receives for a frame on the bus; empty while the channel is closed."""
        return b"t%03X%d%s\r" % (frame.id, len(frame.data), frame.data.hex().encode()) if self._on_bus else b""

    def decode(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Return the frames for the bus, and the adapter's answers, from the bytes of the host."""
        frames, answers = list[Frame](), bytearray()
        *lines, rest = (bytes(self._line) + data).split(b"\r")
        self._line[:] = rest if len(rest) <= LONGEST_LINE else b""
        for line in lines:
            answers += self._execute(line, frames)
        return frames, bytes(answers)

    def _execute(self, line: bytes, frames: list[Frame]) -> bytes:
        command, arguments = line[:1], line[1:]
        match command:
            case b"t" | b"T" | b"r" | b"R":
                return self._transmit(command, arguments, frames)
            case b"S" if arguments.isdigit() and int(arguments) < len(BITRATES) and not self._open:
                self._bitrate = BITRATES[int(arguments)]
            case b"O" | b"L" if not self._open:
                self._open = True
            case b"C":
                self._open = False
            case b"V":
                return b"V1013\r"
            case b"N":
                return b"NS1M0\r"
            case b"F" if self._open:
                return b"F00\r"
            case b"":
                pass
            case _:
                return REFUSED
        return OK

    def _transmit(self, command: bytes, arguments: bytes, frames: list[Frame]) -> bytes:
        if not self._open:
            return REFUSED
        if command != b"t":
            return b"z\r" if command == b"r" else b"Z\r"
        parts = _DATA_FRAME.fullmatch(arguments)
        if parts is None or 2 * int(parts[2]) != len(parts[3]):
            return REFUSED
        if self._on_bus:
            frames.append(Frame(int(parts[1], 16), bytes.fromhex(parts[3].decode("ascii"))))
        return b"z\r"
