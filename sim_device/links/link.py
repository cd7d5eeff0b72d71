"""Define the interface of a link, and the capacities of the links."""

from dataclasses import dataclass
from typing import Protocol

from firmware_protocol.messages import Frame


@dataclass(frozen=True, slots=True)
class LinkLimits:
    """Capacities of the links and of the simulated board."""

    rate_max_hz: int = 4000
    """Maximum sample rate of the simulated board on any link, Hz."""
    used_share: float = 0.8
    """Share of a link's capacity that samples may use. The rest is for all other messages."""
    serial_sample_bits: int = 14 * 10
    """Number of bits of a sample on a UART: 14 bytes, each with start and stop bit."""
    can_sample_bits: int = 135
    """Number of bits of a sample on CAN: 8 data bytes with the maximum number of stuff bits."""
    fast_samples_hz: float = 60_000.0
    """Maximum number of samples per wall second under the fast clock; about the capacity of a host in Python."""
    slcan_fast_samples_hz: float = 4_000.0
    """Maximum number of samples per wall second for an SLCAN host, which reads byte by byte. At a higher rate a full
    pseudo-terminal delays the answers too long."""
    queue_bytes: int = 65536
    """Maximum number of bytes in the transmit queue. Further frames are dropped."""
    blocked_bytes: int = 4096
    """Number of bytes in the transmit queue above which the fast clock stops."""

    def carried_hz(self, bits_per_s: int, sample_bits: int) -> int:
        """Return the maximum sample rate of a link with a given bit rate."""
        return max(1, min(self.rate_max_hz, int(self.used_share * bits_per_s / sample_bits)))


LIMITS = LinkLimits()


@dataclass(frozen=True, slots=True)
class HostAddress:
    """Address of a link for the host."""

    url: str
    rate_max_hz: int
    """Maximum sample rate of the link, Hz."""
    fast_samples_hz: float = LIMITS.fast_samples_hz


class DeviceLink(Protocol):
    """Link of the device to a single host."""

    address: HostAddress

    @property
    def blocked(self) -> bool:
        """Whether the host receives frames more slowly than they are produced."""
        ...

    def receive(self) -> list[Frame]:
        """Return the frames that have arrived, without waiting."""
        ...

    def send(self, frames: list[Frame]) -> list[Frame]:
        """Queue frames and write as many as the link accepts, and return the dropped frames."""
        ...

    def wait(self, timeout: float) -> None:
        """Wait until the link is ready, for at most `timeout` s."""
        ...

    def bus_off(self) -> None:
        """Report that the controller has left its bus after too many errors.

        Nothing is transmitted from then on.
        """
        ...

    def close(self) -> None:
        """Close the link."""
        ...
