"""The seam between a link and the device driver: frames out, frames in."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from dpr_lab.errors import LinkError

if TYPE_CHECKING:
    from firmware_protocol.messages import Frame


@dataclass(frozen=True, slots=True)
class Capacity:
    """Capacity of a link and the load of one sample."""

    name: str
    """As the operator knows it: `115200 baud`."""
    bits_per_s: int
    bits_per_sample: int
    remedy: str
    """What to change when samples do not fit."""
    usable_share: float = 0.8
    """Share of the link that samples may fill; the rest is left for answers, status and arbitration."""

    @property
    def max_rate_hz(self) -> int:
        """The fastest sample rate that leaves the reserve, Hz."""
        return int(self.usable_share * self.bits_per_s / self.bits_per_sample)

    def load(self, rate_hz: int) -> str:
        """Load of a sample rate on the link, with the arithmetic."""
        needed = rate_hz * self.bits_per_sample
        return (
            f"{rate_hz} Hz needs {needed:,} bit/s, {100 * needed / self.bits_per_s:.0f} % of {self.name}"
            f" (at most {100 * self.usable_share:.0f} % may be used)"
        )

    def check(self, rate_hz: int) -> None:
        """Refuse a sample rate the link cannot carry.

        Raises:
            LinkError: with the arithmetic and what to choose instead.
        """
        if rate_hz > self.max_rate_hz:
            raise LinkError(f"{self.load(rate_hz)}: choose at most {self.max_rate_hz} Hz or {self.remedy}")


@dataclass(frozen=True, slots=True)
class Received:
    """Result of one read of a link."""

    host_time: float
    """`time.monotonic()` right after the read, s."""
    frames: tuple[Frame, ...]
    raw: bytes
    """The bytes as they came. A CAN bus has none, so there its frames stand in their serial framing."""


class Transport(Protocol):
    """An open link to a device.

    `send` may be called while another thread is inside `receive`; all else belongs to one thread.
    """

    @property
    def url(self) -> str:
        """The URL it was opened with."""
        ...

    @property
    def errors(self) -> dict[str, int]:
        """Damaged frames so far, by cause: both `crc` and `framing`, zero where the link has none of them."""
        ...

    @property
    def capacities(self) -> tuple[Capacity, ...]:
        """Limits on the sample rate; empty if the link has none."""
        ...

    def send(self, frame: Frame) -> None:
        """Send one frame.

        Raises:
            DeviceLost: the link is gone.
        """
        ...

    def receive(self, timeout: float) -> Received:
        """All that has arrived, waiting at most `timeout` s for the first byte.

        Raises:
            DeviceLost: the link is gone.
        """
        ...

    def close(self) -> None:
        """Close the link; closing twice is harmless."""
        ...
