"""Interface of links for the device driver: frames in both directions, errors and capacity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

from dpr_lab.errors import LinkError

if TYPE_CHECKING:
    from firmware_protocol.messages import Frame


@dataclass(frozen=True, slots=True)
class Capacity:
    """Capacity of a link, and the number of bits that a sample takes."""

    name: str
    """Name for the operator, for example `115200 baud`."""
    bits_per_s: int
    bits_per_sample: int
    remedy: str
    """Remedy if the samples exceed the capacity, for example `a faster bus`."""
    usable_share: float = 0.8
    """Maximum share of the capacity for samples. The rest is reserved for answers, status and arbitration."""

    @property
    def max_rate_hz(self) -> int:
        """Maximum sample rate within the usable share, Hz."""
        return int(self.usable_share * self.bits_per_s / self.bits_per_sample)

    def with_frames(self, frames: int) -> Capacity:
        """Return the capacity for several frames per sample, for example with torques."""
        return replace(self, bits_per_sample=frames * self.bits_per_sample)

    def load(self, rate_hz: int) -> str:
        """Describe the share of the capacity that a sample rate needs, with the calculation."""
        needed = rate_hz * self.bits_per_sample
        return (
            f"{rate_hz} Hz needs {needed:,} bit/s, {100 * needed / self.bits_per_s:.0f} % of {self.name}"
            f" (at most {100 * self.usable_share:.0f} % may be used)"
        )

    def check(self, rate_hz: int) -> None:
        """Check that the link can carry a sample rate.

        Raises:
            LinkError: the link cannot carry the rate; the message contains the calculation and the maximum rate.
        """
        if rate_hz > self.max_rate_hz:
            raise LinkError(f"{self.load(rate_hz)}: choose at most {self.max_rate_hz} Hz or {self.remedy}")


@dataclass(frozen=True, slots=True)
class Received:
    """Result of one read of a link."""

    host_time: float
    """Time right after the read, `time.monotonic()`, s."""
    frames: tuple[Frame, ...]
    raw: bytes
    """Received bytes; for a CAN bus, the received frames in serial framing."""


class Transport(Protocol):
    """Open link to a device.

    `send` may be called while another thread is inside `receive`. All other methods belong to one thread.
    """

    @property
    def url(self) -> str:
        """URL of the link."""
        ...

    @property
    def errors(self) -> dict[str, int]:
        """Number of damaged frames so far, by cause: `crc` and `framing`.

        They are zero for a link without such errors.
        """
        ...

    @property
    def capacities(self) -> tuple[Capacity, ...]:
        """Capacities that limit the sample rate; there are none for a link without limits."""
        ...

    def send(self, frame: Frame) -> None:
        """Send one frame.

        Raises:
            DeviceLost: the link is lost.
        """
        ...

    def receive(self, timeout: float) -> Received:
        """Return all frames that have arrived; wait at most `timeout` s for the first byte.

        Raises:
            DeviceLost: the link is lost.
        """
        ...

    def close(self) -> None:
        """Close the link; repeated calls have no effect."""
        ...
