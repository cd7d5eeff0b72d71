"""Convert the untrusted messages of a run file to arrays, chunk by chunk."""

import json
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import RunError, printable
from dpr_lab.rig import JOINTS
from dpr_lab.storage.layout import CLOCK, EVENTS, LIMITS, RELEASED, SAMPLES, TORQUE_KEYS, Stored
from dpr_lab.storage.row_text import Samples

STRANGE = (ValueError, KeyError, TypeError, OverflowError, RecursionError, AttributeError)
"""Exceptions that are raised for JSON with unexpected content."""


def _decoded(rows: list[dict[str, Any]]) -> Samples:
    n, keys = len(rows), rows[0].keys() if rows else set[str]()
    torques = [_numbers(rows, key, (2,)) for key in TORQUE_KEYS if key in keys]
    return Samples(
        ticks=_numbers(rows, "tick", (), "i"),
        t=_numbers(rows, "t", ()),
        theta=_numbers(rows, "theta", (JOINTS,)),
        counts=_numbers(rows, "counts", (JOINTS,), "i") if "counts" in keys else None,
        torques=np.reshape(torques, (len(torques), n, 2)),
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
    """Samples, first release and last clock fit of a file, collected chunk by chunk as arrays."""

    release_tick: int | None = None
    """Tick of the first valid release."""
    clock: bytes = b""
    """Last clock fit, JSON."""
    strange_event: str = ""
    """Error in the first event or clock fit with unexpected content; empty if there is none."""
    strange_sample: str = ""
    """Error in the first sample with unexpected content; empty if there is none."""
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
        if len({len(part.torques) for part in parts}) > 1:
            raise RunError("only some of the samples have torques")
        self._parts = [
            Samples(
                np.concatenate([part.ticks for part in parts]),
                np.concatenate([part.t for part in parts]),
                np.concatenate([part.theta for part in parts]),
                np.concatenate(with_counts) if with_counts else None,
                np.concatenate([part.torques for part in parts], axis=1),
            )
        ]
        return self._parts[0]

    def _event(self, event: dict[str, Any]) -> None:
        tick = event.get("tick")
        if self.release_tick is None and event.get("kind") == RELEASED and isinstance(tick, int):
            self.release_tick = tick if 0 <= tick < LIMITS.ticks else None


def _numbers(rows: list[dict[str, Any]], key: str, shape: tuple[int, ...], kinds: str = "if") -> NDArray[Any]:
    """Convert the numbers of a key to an array (n, *shape).

    `kinds` contains the permitted `dtype.kind`: `i` for integers, `f` for finite floats.

    Raises:
        ValueError: a value is not of this kind or shape; the message contains the first such value.
    """
    values = [row[key] for row in rows]
    with suppress(ValueError):  # the values have different shapes
        read = np.array(values if values else np.zeros((0, *shape), dtype=np.int64))
        if read.shape == (len(rows), *shape) and read.dtype.kind in kinds and np.isfinite(read).all():
            return read if kinds == "i" else read.astype(np.float64)
    for row in rows if len(rows) > 1 else ():
        _numbers([row], key, shape, kinds)
    number = "finite number" if "f" in kinds else "64-bit integer"
    expected = f"{shape[0]} {number}s" if shape else f"one {number}"
    value, tick = (printable(repr(content)[:40]) for content in (values[0], rows[0].get("tick")))
    raise ValueError(f"{key!r} must be {expected}, not {value} (sample with tick {tick})")
