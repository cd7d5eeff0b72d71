"""Assignment of torques to the samples of the same ticks.

Missing torques are not replaced.
"""

from collections.abc import Sequence
from typing import NamedTuple

from firmware_protocol.messages import ArmInput, Torque, TorqueKind
from firmware_protocol.stream import Row, unwrap

LATE = 2
"""Number of later samples during which a sample waits for its torques, because links may reorder frames."""
KEPT = 64
"""Number of ticks whose torques are kept for a late sample."""

Pair = tuple[int, int]


class DrivenRow(NamedTuple):
    """A `Row` with the torques of its tick."""

    tick: int
    counts: tuple[int, int, int]
    torques: tuple[Pair, ...]
    """One pair for each kind of torque, in the device's unit: torques of joints 1 and 2, or input of the arm and 0."""


class TorquePairs:
    """Assignment of the torques of one device to its samples.

    Args:
        kinds: kinds of torques that follow every sample
    """

    def __init__(self, kinds: Sequence[TorqueKind]) -> None:
        self.kinds = tuple(kinds)
        self.missing = 0
        """Number of samples discarded because torques were missing or contradictory."""
        self._received: dict[int, dict[TorqueKind, Pair | None]] = {}
        self._waiting: list[Row] = []
        self._newest = 0

    def restart(self) -> None:
        """Restart at tick 0."""
        self._received, self._waiting, self._newest = {}, [], 0

    def note(self, torque: Torque | ArmInput) -> None:
        """Process a TORQUE or an ARM_INPUT."""
        tick = unwrap(torque.tick, self._newest, 16)
        pairs = self._received.setdefault(tick, {})
        pair = (torque.input, 0) if isinstance(torque, ArmInput) else (torque.torque1, torque.torque2)
        pairs[torque.kind] = pair if pairs.get(torque.kind, pair) == pair else None
        for old in sorted(self._received)[: max(0, len(self._received) - KEPT)]:
            del self._received[old]

    def take(self, rows: Sequence[Row]) -> list[DrivenRow]:
        """Process samples in order.

        Returns:
            The samples whose torques are complete or that have waited long enough, each with its torques.
        """
        self._waiting += rows
        if rows:
            self._newest = rows[-1].tick
        return self._let_go(LATE)

    def rest(self) -> list[DrivenRow]:
        """Return the remaining samples with their torques, at the end of the stream."""
        return self._let_go(0)

    def _let_go(self, count: int) -> list[DrivenRow]:
        cut = max(0, len(self._waiting) - count)
        ready, self._waiting = self._waiting[:cut], self._waiting[cut:]
        return [row for row in map(self._with_torques, ready) if row is not None]

    def _with_torques(self, row: Row) -> DrivenRow | None:
        received = self._received.pop(row.tick, {})
        pairs = [pair for kind in self.kinds if (pair := received.get(kind)) is not None]
        if len(pairs) < len(self.kinds):
            self.missing += 1
            return None
        return DrivenRow(row.tick, row.counts, tuple(pairs))
