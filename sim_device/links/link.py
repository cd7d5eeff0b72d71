"""What a link is: where a host connects, and frames to and from it."""

from dataclasses import dataclass
from typing import Protocol

from firmware_protocol.messages import Frame


@dataclass(frozen=True, slots=True)
class LinkLimits:
    """Capacities of links and of the simulated board."""

    rate_max_hz: int = 4000
    """What the simulated board can sample, on any link."""
    used_share: float = 0.8
    """Share of a link that samples may fill; the rest is for everything else."""
    serial_sample_bits: int = 14 * 10
    """14 bytes, each with start and stop bit."""
    can_sample_bits: int = 135
    """8 data bytes with the most stuff bits there can be."""
    fast_samples_hz: float = 60_000.0
    """Samples in a wall second under the fast clock, at most: about what a host in Python keeps up with."""
    slcan_fast_samples_hz: float = 4_000.0
    """The same for an SLCAN host, which reads byte by byte: above it, answers wait behind a full pty for too long."""
    queue_bytes: int = 65536
    """Bytes that wait for the link before frames are dropped."""
    blocked_bytes: int = 4096
    """Waiting bytes above which the fast clock stands still."""

    def carried_hz(self, bits_per_s: int, sample_bits: int) -> int:
        """Highest sample rate that a link of a bit rate carries."""
        return max(1, min(self.rate_max_hz, int(self.used_share * bits_per_s / sample_bits)))


LIMITS = LinkLimits()


@dataclass(frozen=True, slots=True)
class HostAddress:
    """Address for the host."""

    url: str
    rate_max_hz: int
    """Highest sample rate that it carries."""
    fast_samples_hz: float = LIMITS.fast_samples_hz


class DeviceLink(Protocol):
    """Link to at most one host."""

    address: HostAddress

    @property
    def blocked(self) -> bool:
        """Whether the host takes frames more slowly than they come."""
        ...

    def receive(self) -> list[Frame]:
        """The frames that have arrived, without waiting."""
        ...

    def send(self, frames: list[Frame]) -> list[Frame]:
        """Queue frames and write what the link accepts; return the frames that are dropped."""
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
