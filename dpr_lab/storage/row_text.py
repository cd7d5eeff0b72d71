"""Samples as JSON texts, one by one, or in blocks of texts with a fixed width.

A block is an array of bytes that is created without a Python call for each row. In all rows of a block, a number has
the same number of characters. Shorter numbers are preceded by blanks, which JSON allows, so any JSON reader can read
these messages. If a number needs too many digits for this format, the samples are converted one by one.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from mcap.opcode import Opcode
from numpy.typing import NDArray

from dpr_lab.arrays import Array, Integers
from dpr_lab.storage.layout import TORQUE_KEYS


@dataclass(frozen=True, slots=True)
class TextSettings:
    """Settings of the numbers in fixed-width text."""

    decimals: tuple[int, ...] = (3, 6, 9, 11)
    """Numbers of decimals to try, in this order. The first number of decimals that reproduces every value of a column
    exactly is used."""
    largest: int = 1 << 53
    """Upper limit of a number whose decimal point is removed. Integers below this limit are exact as floats, so that
    only the division by a power of ten is rounded."""


SETTINGS = TextSettings()
Bytes = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class Samples:
    """Content of the `/samples` channel as arrays."""

    ticks: Integers
    """(n,) ticks."""
    t: Array
    """(n,) time since tick 0, s."""
    theta: Array
    """(n, 3) angles computed during the recording, rad."""
    counts: Integers | None
    """(n, 3) position counts."""
    torques: Array
    """(kinds, n, 2) torques, N m, in the order of `TORQUE_KEYS`; without drives, there is no kind."""

    @property
    def missing(self) -> int:
        """Number of ticks between the first and the last sample that have no sample."""
        return int(self.ticks[-1] - self.ticks[0]) + 1 - len(self.ticks) if len(self.ticks) else 0

    @property
    def vectors(self) -> dict[str, Array | Integers]:
        """Values (n, k) by key, for each key of a sample whose value is a list."""
        counted = {} if self.counts is None else {"counts": self.counts}
        return counted | {"theta": self.theta} | dict(zip(TORQUE_KEYS, self.torques, strict=False))

    def rows(self, rows: slice) -> "Samples":
        """Return a part of the samples."""
        counts = None if self.counts is None else self.counts[rows]
        return Samples(self.ticks[rows], self.t[rows], self.theta[rows], counts, self.torques[:, rows])


_QUADS = np.frombuffer("".join(f"{n:04d}" for n in range(10_000)).encode(), dtype=np.uint32)
"""Four-digit texts of 0 to 9999, each stored as one 32-bit integer. Building text in units of four characters takes a
twentieth of the time."""
_BLANK, _MINUS, _POINT = b" -."
_HEAD = np.dtype([("kind", "u1"), ("length", "<u8"), ("channel", "<u2"), ("number", "<u4"), ("log", "<u8", 2)])


def message_records(channel: int, log_ns: Integers, texts: Bytes) -> Bytes:
    """Create the (n, 31 + w) MCAP records of messages.

    The arguments are log times (n,), ns, and texts (n, w).
    """
    head = np.zeros(len(texts), dtype=_HEAD)
    head["kind"], head["length"] = Opcode.MESSAGE, _HEAD.itemsize - 9 + texts.shape[1]
    head["channel"], head["log"] = channel, log_ns[:, None]
    return np.hstack([head.view(np.uint8).reshape(len(texts), -1), texts])


def sample_texts(samples: Samples) -> Bytes | None:
    """Return JSON texts (n, w) of equal width, or None if a number needs too many digits."""
    parts: list[Bytes | str | None] = ['{"tick":', _decimals(samples.ticks), ',"t":', _decimals(samples.t)]
    for key, vector in samples.vectors.items():
        for number, column in enumerate(vector.T):
            parts += ["," if number else f',"{key}":[', _decimals(column)]
        parts.append("]")
    parts.append("}")
    if any(part is None for part in parts):
        return None
    columns = (np.frombuffer(part.encode(), dtype=np.uint8) if isinstance(part, str) else part for part in parts)
    return np.hstack([np.broadcast_to(column, (len(samples.t), np.shape(column)[-1])) for column in columns])  # pyright: ignore[reportCallIssue, reportArgumentType]


def _decimals(values: Integers | Array) -> Bytes | None:
    """Convert numbers (n,) to decimal texts (n, w) with leading blanks.

    The result is None if no tried number of decimals is exact.
    """
    for decimals in SETTINGS.decimals if values.dtype != np.int64 else (0,):
        with np.errstate(over="ignore"):
            scaled = np.rint(values * 10.0**decimals)
        if not np.abs(scaled).max() < SETTINGS.largest:
            return None
        if (scaled / 10.0**decimals == values).all():
            return _fixed(scaled.astype(np.int64), decimals)
    return None


def _fixed(scaled: Integers, decimals: int) -> Bytes:
    """Convert integers (n,) to texts (n, w) with `decimals` digits after the point."""
    size = np.abs(scaled)
    digits = max(len(str(size.max())), decimals + 1)
    quads = [_QUADS[size // 10**power % 10_000] for power in reversed(range(0, digits, 4))]
    text = np.column_stack([_QUADS[np.zeros_like(size)], *quads]).view(np.uint8)[:, -digits - 1 :]
    text[:, 0] = _BLANK
    whole = digits - decimals
    # Each row has blanks and a sign before its first digit.
    blanks = sum((size < 10**power).astype(np.intp) for power in range(decimals + 1, digits))
    for column in range(whole - 1):
        text[blanks > column, column + 1] = _BLANK
    negative = np.flatnonzero(scaled < 0)
    text[negative, np.broadcast_to(blanks, size.shape)[negative]] = _MINUS
    if not decimals:
        return text
    point = np.full((len(size), 1), _POINT, dtype=np.uint8)
    return np.hstack([text[:, : whole + 1], point, text[:, whole + 1 :]])


def sample_messages(samples: Samples) -> Iterator[bytes]:
    """Yield the JSON text of each sample; three times as fast as `json.dumps`."""
    texts = [f'{{"tick":{tick},"t":{t}' for tick, t in zip(samples.ticks.tolist(), samples.t.tolist(), strict=True)]
    for key, vector in samples.vectors.items():
        texts = [f'{text},"{key}":{row}' for text, row in zip(texts, vector.tolist(), strict=True)]
    return (f"{text}}}".encode() for text in texts)
