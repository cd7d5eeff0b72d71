"""Transmit frames over a byte stream: interfaces of port and codec, and the queue between them."""

from collections.abc import Callable
from typing import Protocol, TypeAlias

from firmware_protocol.framing import FrameDecoder, encode_frame
from firmware_protocol.messages import Frame
from sim_device.faults import Faults
from sim_device.links.link import LIMITS, HostAddress


class Port(Protocol):
    """Byte stream to a single host."""

    @property
    def connected(self) -> bool:
        """Whether a host has opened the port."""
        ...

    def read(self) -> bytes:
        """Return the bytes that have arrived, without waiting."""
        ...

    def write(self, data: bytes | bytearray) -> int:
        """Write without waiting and return the number of accepted bytes."""
        ...

    def wait(self, timeout: float, to_write: bool) -> None:
        """Wait for bytes to read, for room to write if `to_write`, or for `timeout` s."""
        ...

    def close(self) -> None:
        """Disconnect the host from the port."""
        ...


class FrameCodec(Protocol):
    """Conversion of frames to bytes and back."""

    def encode(self, frame: Frame) -> bytes:
        """Return the bytes of one frame."""
        ...

    def decode(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Return the frames in the bytes from the host, and bytes to answer immediately."""
        ...


Framing: TypeAlias = Callable[[], FrameCodec]
"""Function that creates a codec. It is called for each host that connects."""


class SerialCodec:
    """Framing of messages on a UART or a socket."""

    def __init__(self) -> None:
        self._decoder = FrameDecoder()

    def encode(self, frame: Frame) -> bytes:
        """Return the bytes of a frame: COBS with delimiter."""
        return encode_frame(frame)

    def decode(self, data: bytes) -> tuple[list[Frame], bytes]:
        """Return the undamaged frames in received bytes.

        The second value contains bytes to answer immediately; it is always empty on a serial line.
        """
        return self._decoder.feed(data), b""


class ByteLink:
    """Link that transmits frames over a byte port.

    The queue is bounded. No frames are lost if the sender waits while `blocked` is true.
    """

    def __init__(
        self, address: HostAddress, port: Port, new_codec: Framing, faults: Faults, queue_bytes: float
    ) -> None:
        self.address = address
        self._port, self._new_codec, self._faults = port, new_codec, faults
        self._codec = new_codec()
        self._queue_bytes = queue_bytes
        self._queue = bytearray()
        self._was_connected = False

    @property
    def blocked(self) -> bool:
        """Whether the host receives frames more slowly than they are produced."""
        return len(self._queue) > LIMITS.blocked_bytes

    def receive(self) -> list[Frame]:
        """Return the frames that have arrived.

        A new host starts with an empty queue.
        """
        connected = self._port.connected
        if self._was_connected and not connected:
            self._queue.clear()
            self._codec = self._new_codec()
        self._was_connected = connected
        frames, answer = self._codec.decode(self._faults.flipped(self._port.read()))
        self._queue += answer
        return self._faults.frames(frames)

    def send(self, frames: list[Frame]) -> list[Frame]:
        """Queue frames and write as many bytes as the port accepts, and return the dropped frames."""
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
        """Wait for the host for at most `timeout` s."""
        self._port.wait(timeout, to_write=bool(self._queue))

    def bus_off(self) -> None:
        """Do nothing, because a byte stream has no bus."""

    def close(self) -> None:
        """Close the link."""
        self._port.close()
