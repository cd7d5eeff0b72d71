"""Links: how frames reach a host and come back. Serial over a pty, TCP on the loopback, CAN as SLCAN or in-process."""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol, TypeAlias

from dpr_lab.errors import LinkError
from firmware_protocol.framing import FrameDecoder, encode_frame
from firmware_protocol.messages import Frame
from sim_device.faults import Faults
from sim_device.ports import Port, PtyPort, TcpPort
from sim_device.slcan import BITRATES, SlcanCodec

if TYPE_CHECKING:
    import can

RATE_MAX_HZ = 4000
"""What the simulated board can sample, whatever the link carries."""

USED_SHARE = 0.8
"""Share of a link that samples may fill; the rest is for everything else."""

SERIAL_SAMPLE_BITS = 14 * 10  # 14 bytes, each with start and stop bit
CAN_SAMPLE_BITS = 135  # 8 data bytes with the most stuff bits there can be
CAN_ERR_BUSOFF = 0x40

FAST_SAMPLES_HZ = 60_000.0
"""Samples in a wall second under the fast clock, at most: about what a host in Python keeps up with."""

SLCAN_FAST_SAMPLES_HZ = 4_000.0
"""The same for an SLCAN host, which reads byte by byte: beyond this, answers wait behind a full pty for too long."""

QUEUE_BYTES = 65536
"""Bytes that wait for the link before frames are dropped."""

BLOCKED_BYTES = 4096
"""Waiting bytes above which the fast clock stands still."""


@dataclass(frozen=True, slots=True)
class Line:
    """What a host connects to."""

    url: str
    rate_max_hz: int
    """Highest sample rate that it carries."""
    fast_samples_hz: float = FAST_SAMPLES_HZ


class Link(Protocol):
    """Frames to and from at most one host."""

    line: Line

    @property
    def blocked(self) -> bool:
        """Whether the host takes frames more slowly than they come."""
        ...

    def receive(self) -> list[Frame]:
        """The frames that have arrived, without waiting."""
        ...

    def send(self, frames: list[Frame]) -> list[Frame]:
        """Queue frames and pass on what the link takes; returns those that found no room and were dropped."""
        ...

    def wait(self, timeout: float) -> None:
        """Return when something can be done, or after `timeout` seconds."""
        ...

    def bus_off(self) -> None:
        """Say what a controller says that leaves its bus after too many errors; nothing passes from then on."""
        ...

    def close(self) -> None:
        """Cut the link."""
        ...


class Codec(Protocol):
    """Frames as bytes."""

    def encode(self, frame: Frame) -> bytes:
        """Bytes of one frame."""
        ...

    def decode(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Frames in the host's bytes, and bytes to answer at once."""
        ...


Framing: TypeAlias = Callable[[], Codec]
"""Makes a codec, one for every host that connects."""


class SerialCodec:
    """Frames framed for a UART or a socket."""

    def __init__(self) -> None:
        self._decoder = FrameDecoder()

    def encode(self, frame: Frame) -> bytes:
        """COBS frame with its delimiter."""
        return encode_frame(frame)

    def decode(self, data: bytes) -> tuple[list[Frame], bytes]:
        """The undamaged frames."""
        return self._decoder.feed(data), b""


class ByteLink:
    """Frames over a byte port, with a queue that is bounded unless the sender watches `blocked`."""

    def __init__(
        self, line: Line, port: Port, new_codec: Callable[[], Codec], faults: Faults, queue_bytes: float
    ) -> None:
        self.line = line
        self._port, self._new_codec, self._faults = port, new_codec, faults
        self._codec = new_codec()
        self._queue_bytes = queue_bytes
        self._queue = bytearray()
        self._was_connected = False

    @property
    def blocked(self) -> bool:
        """Whether the host takes frames more slowly than they come."""
        return len(self._queue) > BLOCKED_BYTES

    def receive(self) -> list[Frame]:
        """The frames that have arrived; a new host starts with an empty queue."""
        connected = self._port.connected
        if self._was_connected and not connected:
            self._queue.clear()
            self._codec = self._new_codec()
        self._was_connected = connected
        frames, answer = self._codec.decode(self._faults.flipped(self._port.read()))
        self._queue += answer
        return self._faults.frames(frames)

    def send(self, frames: list[Frame]) -> list[Frame]:
        """Queue frames and write what the port takes."""
        dropped, fresh = list[Frame](), bytearray()
        for frame in self._faults.frames(frames):
            data = self._faults.framed(self._codec.encode(frame))
            if len(self._queue) + len(fresh) + len(data) > self._queue_bytes:
                dropped.append(frame)
            else:
                fresh += data
        self._queue += self._faults.to_host(bytes(fresh))
        if self._queue:
            del self._queue[: self._port.write(self._queue)]
        return dropped

    def wait(self, timeout: float) -> None:
        """Wait for the host."""
        self._port.wait(timeout, to_write=bool(self._queue))

    def bus_off(self) -> None:
        """Nothing is said: a line of bytes just falls silent."""

    def close(self) -> None:
        """Cut the link."""
        self._port.close()


class CanLink:
    """Frames on a python-can bus; the bus keeps the queue."""

    def __init__(self, line: Line, bus: "can.BusABC", faults: Faults) -> None:
        self.line, self.blocked = line, False
        self._bus, self._faults = bus, faults
        self._arrived: deque[can.Message] = deque()

    def receive(self) -> list[Frame]:
        """The frames that have arrived."""
        while (message := self._bus.recv(0.0)) is not None:
            self._arrived.append(message)
        plain = [m for m in self._arrived if not (m.is_extended_id or m.is_remote_frame or m.is_error_frame)]
        self._arrived.clear()
        return self._faults.frames([Frame(m.arbitration_id, bytes(m.data)) for m in plain])

    def send(self, frames: list[Frame]) -> list[Frame]:
        """Put the frames on the bus; none is dropped."""
        import can

        for frame in self._faults.frames(frames):
            self._bus.send(can.Message(arbitration_id=frame.id, data=frame.data, is_extended_id=False))
        return []

    def wait(self, timeout: float) -> None:
        """Wait for a frame."""
        message = self._bus.recv(timeout)
        if message is not None:
            self._arrived.append(message)

    def bus_off(self) -> None:
        """An error frame of the class that SocketCAN gives for it."""
        import can

        self._bus.send(can.Message(arbitration_id=CAN_ERR_BUSOFF, is_error_frame=True, dlc=8, data=bytes(8)))

    def close(self) -> None:
        """Leave the bus."""
        self._bus.shutdown()


def open_link(
    name: str,
    baud: int | None = None,
    faults: Faults | None = None,
    lossless: bool = False,
    framing: Framing = SerialCodec,
) -> Link:
    """Open a link by its name on the command line.

    Args:
        name: `pty`, `slcan`, `tcp:PORT` or `virtual:CHANNEL`
        baud: bits per second of the serial port or the bus; None takes the usual 921600 and 1000000
        faults: what goes wrong on the way
        lossless: keep everything that does not go out at once, for a device that waits while the link is blocked
        framing: makes what turns frames into the bytes of a serial line and back

    Raises:
        LinkError: no such link, or it cannot be opened.
    """
    kind, _, address = name.partition(":")
    if kind not in LINKS:
        raise LinkError(f"{name}: there is no link {kind!r} (there are: pty, slcan, tcp:PORT, virtual:CHANNEL)")
    return LINKS[kind](address, baud, faults or Faults(), math.inf if lossless else QUEUE_BYTES, framing)


def _pty(address: str, baud: int | None, faults: Faults, queue_bytes: float, framing: Framing) -> Link:
    baud = baud or 921_600
    port = PtyPort(baud)
    line = Line(f"serial://{port.path}?baud={baud}", _carried_hz(baud, SERIAL_SAMPLE_BITS))
    return ByteLink(line, port, framing, faults, queue_bytes)


def _tcp(address: str, baud: int | None, faults: Faults, queue_bytes: float, framing: Framing) -> Link:
    port = TcpPort(address)
    line = Line(f"socket://127.0.0.1:{port.number}", RATE_MAX_HZ)
    return ByteLink(line, port, framing, faults, queue_bytes)


def _slcan(address: str, baud: int | None, faults: Faults, queue_bytes: float, framing: Framing) -> Link:
    bitrate = _can_bitrate(baud)
    _refuse_byte_faults(faults)
    port = PtyPort(None)
    url = f"can://slcan{port.path}?bitrate={bitrate}"
    line = Line(url, _carried_hz(bitrate, CAN_SAMPLE_BITS), SLCAN_FAST_SAMPLES_HZ)
    return ByteLink(line, port, lambda: SlcanCodec(bitrate), faults, queue_bytes)


def _virtual(address: str, baud: int | None, faults: Faults, queue_bytes: float, framing: Framing) -> Link:
    import can

    bitrate = _can_bitrate(baud)
    _refuse_byte_faults(faults)
    channel = address or "dpr"
    line = Line(f"can://virtual/{channel}?bitrate={bitrate}", _carried_hz(bitrate, CAN_SAMPLE_BITS))
    return CanLink(line, can.Bus(channel, interface="virtual"), faults)


LINKS: dict[str, Callable[[str, int | None, Faults, float, Framing], Link]] = {
    "pty": _pty,
    "slcan": _slcan,
    "tcp": _tcp,
    "virtual": _virtual,
}
"""Kind of link -> how to open it. `virtual` is python-can's in-process bus: its host lives in the same process."""


def _carried_hz(bits_per_s: int, sample_bits: int) -> int:
    return max(1, min(RATE_MAX_HZ, int(USED_SHARE * bits_per_s / sample_bits)))


def _can_bitrate(baud: int | None) -> int:
    bitrate = baud or 1_000_000
    if bitrate not in BITRATES:
        raise LinkError(f"CAN does not run at {bitrate} bit/s: choose one of {', '.join(map(str, BITRATES))}")
    return bitrate


def _refuse_byte_faults(faults: Faults) -> None:
    if faults.strikes_bytes():
        raise LinkError(
            "flip, garbage and truncate damage bytes, which a CAN controller never passes on: use pty or tcp, or drop"
        )
