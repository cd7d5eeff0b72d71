"""Frames on a byte stream: COBS(id | data | crc) 0x00.

Identifier and CRC have 16 bits, little-endian. The CRC is CRC-16/IBM-3740 (polynomial 0x1021, start 0xFFFF) over
identifier and data. COBS removes all zeros from a packet, so a zero always ends a packet. A reader that starts late or
receives noise is synchronised again at the next zero.
"""

import struct
from binascii import crc_hqx

from firmware_protocol.errors import LocalProtocolError, RemoteProtocolError
from firmware_protocol.messages import MAX_DATA, Frame

MAX_ID = 0x7FF
"""Maximum identifier: 11 bits, as on a CAN bus."""
MIN_PACKET = 4
"""Number of bytes of a frame without data: identifier and CRC."""
MAX_PACKET = MIN_PACKET + MAX_DATA
MAX_ENCODED = MAX_PACKET + 1
"""Number of bytes of the longest packet after COBS, without the final zero."""

_HEAD = struct.Struct("<H")


def crc16(data: bytes) -> int:
    """Compute the CRC-16/IBM-3740, also called CCITT-FALSE; it is 0x29B1 for b"123456789"."""
    return crc_hqx(data, 0xFFFF)


def cobs_encode(data: bytes) -> bytes:
    """Encode data by COBS. The result contains no zeros.

    It has one byte more than the data, and at most one further byte for each 254 bytes of data.

    Source: Cheshire & Baker (1999), IEEE/ACM Transactions on Networking 7(2) 159-172.
    """
    out = bytearray()
    for run in data.split(b"\0"):
        while len(run) >= 254:
            out += b"\xff" + run[:254]
            run = run[254:]
        out.append(len(run) + 1)
        out += run
    return bytes(out)


def cobs_decode(data: bytes) -> bytes:
    """Decode COBS; inverse of `cobs_encode`.

    Raises:
        RemoteProtocolError: the data contain a zero, or their end is missing.
    """
    if not data or 0 in data:
        raise RemoteProtocolError("a COBS packet is empty or has a zero inside")
    out = bytearray()
    position, end = 0, len(data)
    while position < end:
        code = data[position]
        out += data[position + 1 : position + code]
        position += code
        if code != 0xFF and position < end:
            out.append(0)
    if position != end:
        raise RemoteProtocolError("a COBS packet ends too early")
    return bytes(out)


def encode_frame(frame: Frame) -> bytes:
    """Convert a frame to bytes of a serial line, with the final zero: 14 bytes for 8 bytes of data.

    Raises:
        LocalProtocolError: the identifier exceeds 11 bits, or there are more than eight bytes of data.
    """
    if not 0 <= frame.id <= MAX_ID or len(frame.data) > MAX_DATA:
        raise LocalProtocolError(
            f"{frame} is not a valid frame: 11 bits of identifier and at most {MAX_DATA} bytes of data"
        )
    body = _HEAD.pack(frame.id) + frame.data
    return cobs_encode(body + _HEAD.pack(crc16(body))) + b"\0"


class FrameDecoder:
    """Decoder of the frames in a byte stream.

    The stream may arrive in pieces of any size.
    """

    def __init__(self) -> None:
        self.crc_errors = 0
        """Number of complete packets that did not match their CRC."""
        self.framing_errors = 0
        """Number of invalid packets: damaged COBS, too short, too long, or an identifier beyond 11 bits."""
        self._rest = b""
        self._skipping = False

    def feed(self, data: bytes) -> list[Frame]:
        """Decode received bytes and return the completed valid frames.

        Invalid packets are counted.
        """
        *packets, rest = (self._rest + data).split(b"\0")
        if packets and self._skipping:
            del packets[0]
            self._skipping = False
        frames = [frame for packet in packets if packet and (frame := self._frame(packet))]
        self._keep(rest)
        return frames

    def _keep(self, rest: bytes) -> None:
        if self._skipping:
            rest = b""
        elif len(rest) > MAX_ENCODED:
            self.framing_errors += 1
            self._skipping, rest = True, b""
        self._rest = rest

    def _frame(self, packet: bytes) -> Frame | None:
        try:
            body = cobs_decode(packet)
        except RemoteProtocolError:
            self.framing_errors += 1
            return None
        if not MIN_PACKET <= len(body) <= MAX_PACKET:
            self.framing_errors += 1
            return None
        if crc16(body[:-2]) != _HEAD.unpack_from(body, len(body) - 2)[0]:
            self.crc_errors += 1
            return None
        (identifier,) = _HEAD.unpack_from(body)
        if identifier > MAX_ID:
            self.framing_errors += 1
            return None
        return Frame(identifier, body[2:-2])
