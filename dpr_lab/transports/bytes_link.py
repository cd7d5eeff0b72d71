"""Transmission of frames over a port that transmits bytes."""

import time
from typing import Protocol

from dpr_lab.transports.transport import Capacity, Received
from firmware_protocol.framing import FrameDecoder, encode_frame
from firmware_protocol.messages import Frame


class BytePort(Protocol):
    """Port that transmits bytes, and raises DeviceLost after a disconnection."""

    def read(self, timeout: float) -> bytes:
        """Return all bytes that have arrived; wait at most `timeout` s for the first one.

        The result is empty if no byte arrived.
        """
        ...

    def write(self, data: bytes) -> None:
        """Send all of `data`."""
        ...

    def close(self) -> None:
        """Close the port; repeated calls have no effect."""
        ...


class BytesLink:
    """`Transport` that sends frames in serial framing over a byte port."""

    def __init__(self, url: str, port: BytePort, capacities: tuple[Capacity, ...] = ()) -> None:
        self.url = url
        self.capacities = capacities
        self._port = port
        self._decoder = FrameDecoder()

    @property
    def errors(self) -> dict[str, int]:
        """Number of damaged frames so far, by cause."""
        return {"crc": self._decoder.crc_errors, "framing": self._decoder.framing_errors}

    def send(self, frame: Frame) -> None:
        """Send one frame."""
        self._port.write(encode_frame(frame))

    def receive(self, timeout: float) -> Received:
        """Return all frames that have arrived; wait at most `timeout` s for the first byte."""
        raw = self._port.read(timeout)
        return Received(time.monotonic(), tuple(self._decoder.feed(raw)), raw)

    def close(self) -> None:
        """Close the port."""
        self._port.close()
