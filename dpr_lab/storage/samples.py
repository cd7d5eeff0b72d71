"""Convert the untrusted messages of a run file to arrays, chunk by chunk."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.arrays import Array, Integers
from dpr_lab.errors import RunError
from dpr_lab.rig import JOINTS
from dpr_lab.storage.layout import CLOCK, EVENTS, LIMITS, RELEASED, SAMPLES, TORQUE_KEYS, Stored
from dpr_lab.storage.row_text import sample_columns

STRANGE = (ValueError, KeyError, TypeError, OverflowError, RecursionError, AttributeError)
"""Exceptions that JSON with unexpected content causes."""


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
    torques: tuple[Array, ...] = ()
    """(n, 2) torques of each kind, N m, in the order of `TORQUE_KEYS`."""

    @property
    def missing(self) -> int:
        """Number of ticks between the first and the last sample that have no sample."""
        return int(self.ticks[-1] - self.ticks[0]) + 1 - len(self.ticks) if len(self.ticks) else 0


def _decoded(rows: list[dict[str, Any]]) -> Samples:
    counted = bool(rows) and "counts" in rows[0]
    return Samples(
        ticks=_whole([row["tick"] for row in rows], (len(rows),)),
        t=_finite([row["t"] for row in rows], (len(rows),)),
        theta=_finite([row["theta"] for row in rows], (len(rows), JOINTS)),
        counts=_whole([row["counts"] for row in rows], (len(rows), JOINTS)) if counted else None,
        torques=tuple(
            _finite([row[key] for row in rows], (len(rows), 2)) for key in TORQUE_KEYS if rows and key in rows[0]
        ),
    )


def json_object(content: bytes) -> dict[str, Any]:
    """Parse the content of a message as a JSON object.

    Raises:
        STRANGE: the content is not JSON, or is not an object.
    """
    read = json.loads(content)
    if not isinstance(read, dict):
        raise TypeError("no JSON object")
    return read


@dataclass(slots=True)
class Gathered:
    """Collector of the numbers in a file's messages; arrays save memory."""

    release_tick: int | None = None
    """Tick of the first valid release."""
    clock: bytes = b""
    """Last clock fit, JSON."""
    strange_event: str = ""
    strange_sample: str = ""
    _parts: list[Samples] = field(default_factory=list)

    def take(self, messages: list[Stored]) -> None:
        """Add the messages of one chunk."""
        try:
            rows = [message.data for message in messages if message.topic == SAMPLES]
            if rows and not self.strange_sample:
                self._parts.append(_decoded(json.loads(b"[" + b",".join(rows) + b"]")))
        except STRANGE as error:
            self.strange_sample = str(error) or type(error).__name__
        try:
            for message in messages:
                if message.topic == EVENTS:
                    self._event(json_object(message.data))
                elif message.topic == CLOCK:
                    self.clock = message.data
        except STRANGE as error:
            self.strange_event = str(error) or type(error).__name__

    def take_rows(self, texts: NDArray[np.uint8]) -> bool:
        """Add samples that are given as texts (n, w) of fixed width.

        For other texts, add nothing and return False.
        """
        if self.strange_sample:
            return True
        columns = sample_columns(texts)
        if columns is None:
            return False
        tick, t, *rest = columns
        counts, theta, *torques = map(_stacked, (rest[:3], rest[3:6], rest[6:8], rest[8:]))
        whole = [tick] if counts is None else [tick, counts]
        if theta is None or any(column is None or column.dtype.kind != "i" for column in whole):
            return False
        known = tuple(pair for pair in torques if pair is not None)
        self._parts.append(Samples(np.asarray(tick), np.asarray(t), theta, counts, known))
        return True

    @property
    def samples(self) -> Samples:
        """All samples in the order of the file.

        Raises:
            RunError: only some of the samples have counts or torques.
        """
        parts = self._parts or [_decoded([])]
        with_counts = [part.counts for part in parts if part.counts is not None]
        if len(with_counts) not in (0, len(parts)):
            raise RunError("only some of the samples have counts")
        with_torques = [part.torques for part in parts]
        if len(set(map(len, with_torques))) > 1:
            raise RunError("only some of the samples have torques")
        self._parts = [
            Samples(
                np.concatenate([part.ticks for part in parts]),
                np.concatenate([part.t for part in parts]),
                np.concatenate([part.theta for part in parts]),
                np.concatenate(with_counts) if with_counts else None,
                tuple(map(np.concatenate, zip(*with_torques, strict=True))),
            )
        ]
        return self._parts[0]

    def _event(self, event: dict[str, Any]) -> None:
        tick = event.get("tick")
        if self.release_tick is None and event.get("kind") == RELEASED and isinstance(tick, int):
            self.release_tick = tick if 0 <= tick < LIMITS.ticks else None


def _stacked(columns: Sequence[NDArray[Any] | None]) -> NDArray[Any] | None:
    """Stack k columns to an array (n, k); return None if the columns are missing."""
    present = [column for column in columns if column is not None]
    return np.column_stack(present) if present else None


def _whole(values: list[Any], shape: tuple[int, ...]) -> Integers:
    read = np.array(values if values else np.zeros(shape, dtype=np.int64))
    if read.shape != shape or read.dtype != np.int64:
        raise ValueError(f"a value is not a 64-bit integer, or the number of values is not {shape[1:] or 'one'}")
    return read


def _finite(values: list[Any], shape: tuple[int, ...]) -> Array:
    read = np.array(values if values else np.zeros(shape), dtype=np.float64)
    if read.shape != shape or not np.isfinite(read).all():
        raise ValueError(f"a value is not a finite number, or the number of values is not {shape[1:] or 'one'}")
    return read
