"""Interface of a link: the address for a host, and the frames in both directions."""

from dataclasses import dataclass
from typing import Protocol

from firmware_protocol.messages import Frame


@dataclass(frozen=True, slots=True)
class LinkLimits:
    """Capacities of links and of the simulated board."""

    rate_max_hz: int = 4000
    """Maximum sample rate of the simulated board on any link."""
    used_share: float = 0.8
    """Fraction of a link for samples; the remainder is for all other messages."""
    serial_sample_bits: int = 14 * 10
    """Bits of a sample on a UART: 14 bytes, each with start and stop bit."""
    can_sample_bits: int = 135
    """Bits of a sample on CAN: 8 data bytes with the maximum number of stuff bits."""
    fast_samples_hz: float = 60_000.0
    """Maximum samples per wall second under the fast clock, about the capacity of a host in Python."""
    slcan_fast_samples_hz: float = 4_000.0
    """Maximum for an SLCAN host, which reads byte by byte: at a higher rate, a full pty delays the answers too long.
    """
    queue_bytes: int = 65536
    """Number of waiting bytes from which frames are dropped."""
    blocked_bytes: int = 4096
    """Number of waiting bytes above which the fast clock stops."""

    def carried_hz(self, bits_per_s: int, sample_bits: int) -> int:
        """Maximum sample rate of a link with a given bit rate."""
        return max(1, min(self.rate_max_hz, int(self.used_share * bits_per_s / sample_bits)))


LIMITS = LinkLimits()


@dataclass(frozen=True, slots=True)
class HostAddress:
    """Address for the host."""

    url: str
    rate_max_hz: int
    """Maximum sample rate of the link."""
    fast_samples_hz: float = LIMITS.fast_samples_hz


class DeviceLink(Protocol):
    """Link to a single host."""

    address: HostAddress

    @property
    def blocked(self) -> bool:
        """Whether the host receives frames more slowly than they are produced."""
        ...

    def receive(self) -> list[Frame]:
        """The frames that have arrived, without waiting."""
        ...

    def send(self, frames: list[Frame]) -> list[Frame]:
        """Queue frames and write what the link accepts; return the frames that are dropped."""
        ...

    def wait(self, timeout: float) -> None:
        """Return when the link is ready, or after `timeout` seconds."""
        ...

    def bus_off(self) -> None:
        """Report that the controller left its bus after too many errors; nothing is transmitted from then on."""
        ...

    def close(self) -> None:
        """Cut the link."""
        ...
