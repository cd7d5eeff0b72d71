"""Messages of one read of the link, and conversion of samples to arrays."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.rig import JOINTS
from firmware_protocol.messages import Message
from firmware_protocol.stream import Row
from firmware_protocol.torques import DrivenRow

AnyRow = Row | DrivenRow


@dataclass(frozen=True, slots=True)
class Batch:
    """Messages of one read of the link, in order of arrival."""

    host_time: float
    """`time.monotonic()` of the read, s."""
    raw: bytes
    rows: tuple[AnyRow, ...]
    """Samples with unwrapped ticks and positions, and with their torques if the device has drives."""
    messages: tuple[Message, ...]
    """All messages except samples and torques."""
    lost_before: Mapping[str, int] = field(default_factory=dict)
    """Number of samples and frames lost before this batch, by cause (`dpr_lab.run.LOSS_CAUSES`)."""


def torques_of(rows: Sequence[AnyRow], unit_uNm: int) -> Array | None:
    """Return the known torques (kinds, n, 2) of joints 1 and 2, N m.

    The result is None if the unit of the torques is unknown. For a driven arm, the first value is the input of its
    drive in its own unit, and the second is 0.
    """
    if not unit_uNm:
        return None
    driven = [row.torques for row in rows if isinstance(row, DrivenRow)]
    return np.round(np.array(driven).swapaxes(0, 1) * (unit_uNm * 1e-6), 6) if driven else None


def arrays(rows: Sequence[AnyRow]) -> tuple[Integers, Integers]:
    """Return the ticks (n,) and position counts (n, 3) of samples."""
    ticks = np.array([row.tick for row in rows], dtype=np.int64)
    return ticks, np.array([row.counts for row in rows], dtype=np.int64).reshape(-1, JOINTS)


class Counter:
    """Running total of a 16-bit counter of the device, which wraps, and restarts at 0 with every stream."""

    def __init__(self) -> None:
        self.total = 0
        self._last = 0

    def read(self, low: int) -> None:
        """Update the total with a reading of the counter."""
        self.total += (low - self._last) & 0xFFFF
        self._last = low

    def restart(self) -> None:
        """Expect a counter that restarts at 0 with a new stream; the total is kept."""
        self._last = 0
