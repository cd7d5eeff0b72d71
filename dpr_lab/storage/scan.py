"""Read a run file from its start to its end or to its first damage, trusting nothing in it.

The library's indexed reader needs a whole file. This one reads in order and stops at the first record that does not
hold together: every chunk has a CRC, the two records that matter have a digest, the rig has its hash, and no length
found in the file is believed before it is compared with `MAX_RECORD_BYTES`.
"""

import hashlib
import json
import mmap
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.records import Attachment, Channel, Chunk, Footer, McapRecord, Message, Metadata, Statistics
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from dpr_lab.errors import RunError
from dpr_lab.rig import JOINTS
from dpr_lab.storage.layout import (
    CLOCK,
    END,
    EVENTS,
    MAX_EXPANSION,
    MAX_RECORD_BYTES,
    MOST_TICKS,
    PROVENANCE,
    RELEASED,
    RIG_ATTACHMENT,
    SAMPLES,
    SMALL_CHUNK_BYTES,
    Stored,
    unsealed,
)
from dpr_lab.storage.metadata import RunMetadata, RunSummary

DAMAGE = (McapError, zstandard.ZstdError, struct.error, ValueError, OverflowError, MemoryError)
"""What the libraries raise on bytes that are not what they should be."""


@dataclass(frozen=True, slots=True)
class Samples:
    """The `/samples` channel as arrays."""

    ticks: NDArray[np.int64]
    """(n,)"""
    t: NDArray[np.float64]
    """(n,) s since tick 0"""
    theta: NDArray[np.float64]
    """(n, 3) rad, as computed when recorded"""
    counts: NDArray[np.int64] | None
    """(n, 3)"""

    @property
    def missing(self) -> int:
        """Ticks between the first and the last that have no sample."""
        return int(self.ticks[-1] - self.ticks[0]) + 1 - len(self.ticks) if len(self.ticks) else 0


@dataclass(frozen=True, slots=True)
class Scan:
    """Everything that could be read from a run file."""

    path: Path
    size_bytes: int
    sha256: str
    metadata: RunMetadata
    rig_sha256: str
    messages: list[Stored]
    summary: RunSummary | None
    """How the run ended; None when the file ends before saying so."""
    stopped: str
    """Why the recording ended early, in the writer's words; empty when it did not."""
    samples_announced: int | None
    """Number of samples according to the end record."""
    samples_counted: int | None
    """Number of samples according to the MCAP statistics."""
    damage: str
    """What stopped the reading; empty when the file is whole."""

    @property
    def complete(self) -> bool:
        """Whether the run was finished and all of it is here."""
        return not self.damage and self.summary is not None and not self.stopped

    @property
    def release_tick(self) -> int | None:
        """Tick of the release: from the end record, or from the event when the file has lost its end.

        Raises:
            RunError: an event that is not in the layout of a run.
        """
        if self.summary is not None and self.summary.release_tick is not None:
            return self.summary.release_tick
        events = (self._object(m) for m in self.messages if m.topic == EVENTS)
        ticks = (event.get("tick") for event in events if event.get("kind") == RELEASED)
        return next((tick for tick in ticks if isinstance(tick, int) and 0 <= tick < MOST_TICKS), None)

    @property
    def newest_clock(self) -> dict[str, Any]:
        """The last clock fit written while recording; empty when there is none.

        Raises:
            RunError: it is not in the layout of a run.
        """
        return next((self._object(m) for m in reversed(self.messages) if m.topic == CLOCK), {})

    def _object(self, message: Stored) -> dict[str, Any]:
        try:
            read = json.loads(message.data)
        except (ValueError, RecursionError) as error:
            raise RunError(f"{self.path}: {message.topic} is not in the layout of a run: {error}") from error
        if not isinstance(read, dict):
            raise RunError(f"{self.path}: {message.topic} is not in the layout of a run")
        return read

    def samples(self) -> Samples:
        """Decode the samples.

        Raises:
            RunError: the channel holds something else, or ticks that do not increase.
        """
        try:
            rows = json.loads(b"[" + b",".join(m.data for m in self.messages if m.topic == SAMPLES) + b"]")
            counted = bool(rows) and "counts" in rows[0]
            samples = Samples(
                ticks=_whole([row["tick"] for row in rows], (len(rows),)),
                t=_finite([row["t"] for row in rows], (len(rows),)),
                theta=_finite([row["theta"] for row in rows], (len(rows), JOINTS)),
                counts=_whole([row["counts"] for row in rows], (len(rows), JOINTS)) if counted else None,
            )
        except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            raise RunError(f"{self.path}: its samples are not in the layout of a run: {error}") from error
        backwards = np.flatnonzero(np.diff(samples.ticks) <= 0)
        if len(backwards):
            raise RunError(f"{self.path}: sample {backwards[0] + 1} does not come after the one before it")
        return samples


def _whole(values: list[Any], shape: tuple[int, ...]) -> NDArray[np.int64]:
    read = np.array(values if values else np.zeros(shape, dtype=np.int64))
    if read.shape != shape or read.dtype != np.int64:
        raise ValueError(f"a value that is not a whole number of 64 bits, or not {shape[1:] or 'one'} of them")
    return read


def _finite(values: list[Any], shape: tuple[int, ...]) -> NDArray[np.float64]:
    read = np.array(values if values else np.zeros(shape), dtype=np.float64)
    if read.shape != shape or not np.isfinite(read).all():
        raise ValueError(f"a value that is not a finite number, or not {shape[1:] or 'one'} of them")
    return read


@dataclass(slots=True)
class _Collected:
    records: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    topics: dict[int, str] = field(default_factory=dict)
    messages: list[Stored] = field(default_factory=list)
    statistics: Statistics | None = None
    finished: bool = False


def scan(path: Path) -> Scan:
    """Read a run file as far as it can be trusted.

    Raises:
        RunError: not there, empty, not MCAP, an MCAP of another tool, or damaged before its first sample.
    """
    found = _Collected()
    with _mapped(path) as file:
        sha256, size = hashlib.sha256(file).hexdigest(), len(file)
        if file[: len(MCAP0_MAGIC)] != MCAP0_MAGIC:
            raise RunError(
                f"{path}: is not a run file: it does not start as MCAP does; tables are read by `import csv`"
            )
        damage = _collect(file, found)
    metadata, rig_sha256 = _description(path, found, damage)
    summary, stopped, samples = _ending(path, found)
    return Scan(
        path=path,
        size_bytes=size,
        sha256=sha256,
        metadata=metadata,
        rig_sha256=rig_sha256,
        messages=found.messages,
        summary=summary,
        stopped=stopped,
        samples_announced=samples,
        samples_counted=_counted(found),
        damage=damage,
    )


def _ending(path: Path, found: _Collected) -> tuple[RunSummary | None, str, int | None]:
    """How the run ended, why early if it did, and how many samples it announced."""
    end = found.records.get(END)
    if end is None:
        return None, "", None
    try:
        return RunSummary.from_record(end), end["stopped"], int(end["samples"])
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise RunError(f"{path}: its end record cannot be read: {error}") from error


@contextmanager
def _mapped(path: Path) -> Iterator[mmap.mmap]:
    """The file as memory: reading past its end is short, and no damaged length makes a read allocate."""
    try:
        with path.open("rb") as file:
            if not path.stat().st_size:
                raise RunError(f"{path}: is empty: nothing was recorded")
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
                yield content
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error


def _collect(file: mmap.mmap, found: _Collected) -> str:
    """Gather the records in file order; returns the damage that ended it, if any."""
    # The mapping reads, tells and seeks like a file but is not declared as one.
    reader = StreamReader(file, emit_chunks=True, validate_crcs=True, record_size_limit=MAX_RECORD_BYTES)  # pyright: ignore[reportArgumentType]
    try:
        for record in reader.records:
            _take(record, found)
    except DAMAGE as error:
        return f"cut off or damaged near byte {file.tell()} of {len(file)} ({str(error) or type(error).__name__})"
    return "" if found.finished else "cut off before its end"


def _take(record: McapRecord, found: _Collected) -> None:
    match record:
        case Chunk():
            found.messages += _messages(record, found.topics)
        case Metadata(name=name, metadata=content) if name in (PROVENANCE, END):
            read = unsealed(content)
            if read is None:
                raise McapError(f"the {name} record does not fit its digest")
            found.records[name] = read
        case Attachment(name=name, data=data):
            found.attachments[name] = data
        case Statistics():
            found.statistics = record
        case Footer():
            found.finished = True
        case _:
            pass


def _messages(chunk: Chunk, topics: dict[int, str]) -> list[Stored]:
    expanded = chunk.uncompressed_size
    if chunk.compression == "zstd":
        expanded = max(expanded, zstandard.frame_content_size(chunk.data))
    elif chunk.compression:
        raise McapError(f"a chunk compressed with {chunk.compression[:20]!r}, which no run uses")
    most = min(MAX_RECORD_BYTES, MAX_EXPANSION * len(chunk.data) + SMALL_CHUNK_BYTES)
    if expanded > most:
        raise McapError(f"a chunk of {len(chunk.data)} bytes that would expand to {expanded}, {most} is the most")
    if not chunk.uncompressed_crc:
        raise McapError("a chunk without a CRC")
    records = breakup_chunk(chunk, validate_crc=True)
    topics.update({record.id: record.topic for record in records if isinstance(record, Channel)})
    messages = [record for record in records if isinstance(record, Message)]
    if any(message.channel_id not in topics for message in messages):
        raise McapError("a message of a channel that was not announced")
    return [Stored(topics[m.channel_id], m.log_time, m.publish_time, m.data) for m in messages]


def _description(path: Path, found: _Collected, damage: str) -> tuple[RunMetadata, str]:
    record = found.records.get(PROVENANCE)
    if record is None and not damage:
        raise RunError(f"{path}: is an MCAP file of another tool: it has no dpr-lab provenance record")
    if record is None or RIG_ATTACHMENT not in found.attachments:
        raise RunError(f"{path}: {damage}, before the rig it was recorded on: nothing can be read from it")
    try:
        return RunMetadata.from_record(record, found.attachments[RIG_ATTACHMENT]), record["rig_sha256"]
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise RunError(f"{path}: its description cannot be read: {error}") from error
    except RunError as error:
        raise RunError(f"{path}: {error}") from error


def _counted(found: _Collected) -> int | None:
    if found.statistics is None:
        return None
    counts = found.statistics.channel_message_counts
    return sum(counts.get(channel, 0) for channel, topic in found.topics.items() if topic == SAMPLES)
