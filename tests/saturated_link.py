"""Simulated logger that sends a row at each encoder count, over a serial link with too little capacity, for tests.

The bytes of a row wait in a queue of limited size. The logger waits while the row does not fit, and reads the encoder
again afterwards. A row is stamped when its last byte arrives, or when the encoder was read.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LINE_END = 2
"""Number of bytes of a carriage return and a line feed."""
BITS_PER_BYTE = 10
"""Number of bits per byte, with start bit and stop bit."""


@dataclass(frozen=True)
class Link:
    """Serial link with the queue of the logger."""

    baud: int = 9600
    queue_bytes: int = 64


@dataclass(frozen=True)
class Rows:
    """Record of n rows."""

    read: Array
    """Instants (n,) at which the encoder was read, s."""
    arrived: Array
    """Instants (n,) at which the last byte arrived, s."""
    counts: NDArray[np.int64]


def rows_at_each_change(t: Array, counts: NDArray[np.int64], link: Link) -> Rows:
    """Rows of a logger that compares the count with the last sent count at each of the instants t (n,)."""
    byte_s = BITS_PER_BYTE / link.baud
    read, arrived, sent = [], [], []
    i, last, idle_from = 0, int(counts[0]), 0.0
    while i < len(t):
        if counts[i] == last:
            i += 1
            continue
        last = int(counts[i])
        idle_from = max(idle_from, t[i]) + (len(str(last)) + LINE_END) * byte_s
        read.append(t[i])
        arrived.append(idle_from)
        sent.append(last)
        room = idle_from - link.queue_bytes * byte_s  # the last byte of this row is in the queue
        i = max(i + 1, int(np.searchsorted(t, room)))
    return Rows(np.array(read), np.array(arrived), np.array(sent))
