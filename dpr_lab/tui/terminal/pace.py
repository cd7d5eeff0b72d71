"""Rate limit of the frames, which keeps the output within the capacity of the line."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class PaceSettings:
    """Limits on unconfirmed output."""

    bytes_per_cell_s: float = 3.5
    """Maximum output rate per cell during animations, bytes/s. An 80x24 terminal then gets 6.7 kB/s, below the capacity
    of 115200 baud."""
    burst_per_cell: float = 6.0
    """Number of bytes per cell that may be sent before the rate is limited: a whole screen in colours."""
    lost_after_s: float = 2.0
    """Time after which an unconfirmed frame no longer delays the next one, s."""


SETTINGS = PaceSettings()


class Pace:
    """Rate control of the output, based on the sent and the confirmed frames.

    The methods get the current time as an argument.

    Args:
        cells: number of cells of the terminal
        now: current time, s
    """

    def __init__(self, cells: int, now: float) -> None:
        self._cells = cells
        self._credit, self._counted_at = SETTINGS.burst_per_cell * cells, now
        self._out: dict[int, float] = {}

    def wait(self, now: float) -> float:
        """Return the waiting time until the next frame may be sent, s."""
        self._count(now)
        budget = max(-self._credit, 0.0) / (SETTINGS.bytes_per_cell_s * self._cells)
        return max(budget, *(sent_at + SETTINGS.lost_after_s - now for sent_at in self._out.values()), 0.0)

    def refill(self) -> None:
        """Allow an immediate frame after a key press."""
        self._credit = SETTINGS.burst_per_cell * self._cells

    def sent(self, frame: int, size: int, now: float) -> None:
        """Register a sent frame and its size in bytes."""
        self._count(now)
        self._credit -= size
        self._out[frame] = now

    def confirmed(self, frame: int, now: float) -> float | None:
        """Confirm a frame and all earlier ones; return the round trip time, s.

        The result is None for an unknown frame.
        """
        sent = self._out.get(frame)
        self._out = {other: sent_at for other, sent_at in self._out.items() if other > frame}
        return None if sent is None else now - sent

    def _count(self, now: float) -> None:
        most = SETTINGS.burst_per_cell * self._cells
        self._credit = min(self._credit + (now - self._counted_at) * SETTINGS.bytes_per_cell_s * self._cells, most)
        self._counted_at = now
