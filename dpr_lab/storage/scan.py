"""Read an untrusted run file up to its end or to the first damage.

The indexed reader of the MCAP library needs a complete file. This reader reads the records in order and stops at the
first inconsistent record. Every chunk has a CRC, the two essential records have a digest, and the rig has a hash. Every
length in the file is compared with `LIMITS`.
"""

import hashlib
import mmap
import os
import struct
import zlib
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Footer, McapRecord, Message, Metadata, Statistics
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from mcap.writer import MCAP0_MAGIC

from dpr_lab.errors import RunError, printable
from dpr_lab.storage.layout import (
    CLOCK,
    END,
    EVENTS,
    INTERRUPTED,
    LIMITS,
    PROVENANCE,
    RIG_ATTACHMENT,
    SAMPLES,
    Stored,
    unsealed,
)
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.row_text import Samples
from dpr_lab.storage.samples import STRANGE, Gathered, json_object
from dpr_lab.storage.sidecar import SIDECAR_SUFFIX
from dpr_lab.whole_file import regular

DAMAGE = (
    McapError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    OverflowError,
    MemoryError,
    LookupError,
    TypeError,
    AttributeError,
    AssertionError,
)
"""Exceptions that the libraries raise for invalid bytes."""


@dataclass(frozen=True, slots=True)
class Scan:
    """Readable content of a run file."""

    path: Path
    size_bytes: int
    """Size of the file in bytes, up to its first hole."""
    sha256: str
    """SHA-256 of the file up to its first hole."""
    metadata: RunMetadata
    rig_sha256: str
    read: Gathered
    """Samples, first release and last clock fit, collected chunk by chunk."""
    summary: RunSummary | None
    """End record of the run; None if the file has no end record."""
    stopped: str = ""
    """Reason why the recording ended early, from the writer; empty if it did not end early."""
    samples_announced: int | None = None
    """Number of samples according to the end record."""
    samples_counted: int | None = None
    """Number of samples according to the MCAP statistics."""
    damage: str = ""
    """Reason why reading stopped; empty if the file is complete."""

    @property
    def complete(self) -> bool:
        """Whether the file is complete, and the recording was not interrupted."""
        return not self.damage and self.summary is not None and not self.interrupted

    @property
    def interrupted(self) -> str:
        """Reason why the recording ended early; empty if it did not end early.

        A recovered file has the reason of the original file.
        """
        return self.stopped or self.metadata.extra.get(INTERRUPTED, "")

    @property
    def release_tick(self) -> int | None:
        """Tick of the release from the end record, or from the event if the end record lacks it.

        Raises:
            RunError: an event does not have the layout of a run.
        """
        if self.summary is not None and self.summary.release_tick is not None:
            return self.summary.release_tick
        if self.read.strange_event:
            raise RunError(f"{self.path}: {EVENTS} does not have the layout of a run: {self.read.strange_event}")
        return self.read.release_tick

    @property
    def newest_clock(self) -> dict[str, Any]:
        """Last clock fit during the recording, or an empty mapping.

        Raises:
            RunError: the message of the clock fit does not have the layout of a run file.
        """
        try:
            return json_object(self.read.clock) if self.read.clock else {}
        except STRANGE as error:
            raise RunError(f"{self.path}: {CLOCK} does not have the layout of a run: {error}") from error

    def samples(self) -> Samples:
        """Return the samples of the run.

        Raises:
            RunError: the channel has other content, or its ticks do not increase.
        """
        if self.read.strange_sample:
            raise RunError(
                f"{self.path}: its samples do not have the layout of a run: {self.read.strange_sample}. The file was"
                " written or changed by another program: use the original recording, or correct the value there"
            )
        samples = self.read.samples
        backwards = np.flatnonzero(np.diff(samples.ticks) <= 0)
        if len(backwards):
            raise RunError(f"{self.path}: sample {backwards[0] + 1} is not later than the previous one")
        return samples


@dataclass(slots=True)
class _Room:
    """Limit on the unpacked size of all chunks of a file."""

    left: int = LIMITS.surplus_bytes
    """Remaining budget, bytes."""

    def take(self, packed: int, expanded: int) -> None:
        """Check the unpacked size of a chunk, and subtract it from the budget.

        The chunk is unpacked afterwards.

        Raises:
            McapError: the chunk, or all chunks together, exceed the limits.
        """
        credit = LIMITS.expansion * packed
        most = min(LIMITS.record_bytes, credit + LIMITS.small_chunk_bytes, credit + self.left)
        if expanded > most:
            raise McapError(f"a chunk of {packed} bytes that would expand to {expanded}; the maximum is {most}")
        self.left += credit - expanded


@dataclass(slots=True)
class _Collected:
    records: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    topics: dict[int, str] = field(default_factory=dict)
    read: Gathered = field(default_factory=Gathered)
    room: _Room = field(default_factory=_Room)
    statistics: Statistics | None = None
    finished: bool = False


def scan(path: Path) -> Scan:
    """Read a run file up to its end or to the first damage.

    Raises:
        RunError: the file is missing, empty, not MCAP, of another tool, or damaged before its first sample.
    """
    collected = _Collected()
    with mapped(path) as file:
        if file[: len(MCAP0_MAGIC)] != MCAP0_MAGIC:
            if path.suffix == SIDECAR_SUFFIX:
                raise RunError(f"{path}: is the hash of a run, not the run itself: give only the .mcap files")
            raise RunError(f"{path}: is not a run file: it has no MCAP header; import a table with `import table`")
        sha256, size = hashlib.sha256(file).hexdigest(), len(file)
        damage = _collect(file, collected)
    metadata, rig_sha256 = _description(path, collected, damage)
    summary, stopped, samples = _ending(path, collected)
    return Scan(
        path=path,
        size_bytes=size,
        sha256=sha256,
        metadata=metadata,
        rig_sha256=rig_sha256,
        read=collected.read,
        summary=summary,
        stopped=stopped,
        samples_announced=samples,
        samples_counted=_counted(collected),
        damage=damage,
    )


def stored_messages(path: Path) -> Generator[Stored]:
    """Yield the messages of a run file up to its end or the first damage."""
    topics: dict[int, str] = {}
    room = _Room()
    with mapped(path) as file:
        reader = _reader(file)
        try:
            for record in reader.records:
                if isinstance(record, Chunk):
                    yield from _messages(record, _expanded(record, room), topics)
        except DAMAGE:
            return


def _ending(path: Path, collected: _Collected) -> tuple[RunSummary | None, str, int | None]:
    """Return the summary, the reason for an early end, and the sample count in the end record."""
    end = collected.records.get(END)
    if end is None:
        return None, "", None
    try:
        return RunSummary.from_record(end), printable(end["stopped"]), int(end["samples"])
    except STRANGE as error:
        raise RunError(
            f"{path}: its end record does not have the layout of a run: it was written by another program"
        ) from error


@contextmanager
def mapped(path: Path) -> Iterator[mmap.mmap]:
    """Map a file into memory, up to its first hole.

    Reads past the end return fewer bytes, so a damaged length causes no large allocation. A valid run has no hole. A
    hole means that a part of the file was never written to the disk, or that the size of a small file was set
    artificially.
    """
    try:
        with regular(path, RunError).open("rb") as file:
            length = _until_hole(file)
            if not length:
                raise RunError(f"{path}: is empty: nothing was recorded; record or import it again")
            with mmap.mmap(file.fileno(), length, access=mmap.ACCESS_READ) as content:
                yield content
    except IsADirectoryError as error:
        raise RunError(f"{path}: is a folder: give the run files in this folder, {path}/*.mcap") from error
    except FileNotFoundError as error:
        raise no_such_file(path) from error
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error


def no_such_file(path: Path) -> RunError:
    """Create the error for a file that does not exist, with a hint for a pattern such as `'*.mcap'`."""
    return RunError(
        f"{path}: no such file; {'write * outside quotation marks' if '*' in path.name else 'check the path'}"
    )


def _until_hole(file: BinaryIO) -> int:
    """Return the number of bytes before the first hole of a file.

    Without a hole, this is the size of the file.
    """
    if not hasattr(os, "SEEK_HOLE"):
        return os.fstat(file.fileno()).st_size
    try:
        return os.lseek(file.fileno(), 0, os.SEEK_HOLE)
    except OSError:  # an empty file, or a file system that cannot find holes
        return os.fstat(file.fileno()).st_size


class _Reader(StreamReader):
    """Stream reader that skips the message index of each chunk.

    The index is not needed, and reading the index takes more time than reading the messages.
    """

    def _read_record(self, opcode: int, length: int) -> McapRecord | None:
        return None if opcode == Opcode.MESSAGE_INDEX else super()._read_record(opcode, length)


def _reader(file: mmap.mmap) -> StreamReader:
    # The mapping has read, tell and seek but is not typed as a file.
    return _Reader(file, emit_chunks=True, validate_crcs=True, record_size_limit=LIMITS.record_bytes)  # pyright: ignore[reportArgumentType]


def _collect(file: mmap.mmap, collected: _Collected) -> str:
    """Collect the records of a file; describe the damage at its end.

    The description is empty if the file is complete.
    """
    reader = _reader(file)
    try:
        for record in reader.records:
            _take(record, collected)
    except DAMAGE as error:
        return f"incomplete or damaged near byte {file.tell()} of {len(file)}{_reason(error)}"
    return "" if collected.finished else "incomplete: the end is missing"


def _reason(error: Exception) -> str:
    """Return the reason for damage that this package or a checksum detected, in brackets.

    Messages of libraries are omitted.
    """
    if type(error) is McapError and str(error):
        return f" ({error})"
    if isinstance(error, CRCValidationError):
        return " (its content does not match its checksum)"
    return ""


def _take(record: McapRecord, collected: _Collected) -> None:
    match record:
        case Chunk():
            content = _expanded(record, collected.room)
            collected.read.take(_messages(record, content, collected.topics))
        case Metadata(name=name, metadata=content) if name in (PROVENANCE, END):
            read = unsealed(content)
            if read is None:
                raise McapError(f"the {name} record does not match its digest")
            collected.records[name] = read
        case Attachment(name=name, data=data):
            collected.attachments[name] = data
        case Statistics():
            collected.statistics = record
        case Footer():
            collected.finished = True
        case _:
            pass


def _expanded(chunk: Chunk, room: _Room) -> bytes:
    """Unpack the records of a chunk and check their CRC.

    Raises:
        DAMAGE: the chunk is not valid in a run, or does not match its CRC.
    """
    expanded = chunk.uncompressed_size
    if chunk.compression == "zstd":
        expanded = max(expanded, zstandard.frame_content_size(chunk.data))
    elif chunk.compression:
        raise McapError(f"a chunk compressed with {chunk.compression[:20]!r}, which is not used in runs")
    room.take(len(chunk.data), expanded)
    if not chunk.uncompressed_crc:
        raise McapError("a chunk without a CRC")
    content = zstandard.decompress(chunk.data, expanded) if chunk.compression else chunk.data
    if zlib.crc32(content) != chunk.uncompressed_crc:
        raise McapError("a chunk that does not match its CRC")
    return content


def _messages(chunk: Chunk, content: bytes, topics: dict[int, str]) -> list[Stored]:
    """Return the messages of an unpacked chunk."""
    records = breakup_chunk(replace(chunk, compression="", data=content))
    topics.update({record.id: record.topic for record in records if isinstance(record, Channel)})
    messages = [record for record in records if isinstance(record, Message)]
    if any(message.channel_id not in topics for message in messages):
        raise McapError("a message of a channel that was not announced")
    return [Stored(topics[m.channel_id], m.log_time, m.publish_time, m.data) for m in messages]


def _description(path: Path, collected: _Collected, damage: str) -> tuple[RunMetadata, str]:
    record = collected.records.get(PROVENANCE)
    if record is None and not damage:
        raise RunError(f"{path}: is an MCAP file of another tool: it contains no provenance record of dpr-lab")
    if record is None or RIG_ATTACHMENT not in collected.attachments:
        raise RunError(f"{path}: {damage}. The damage precedes the description of the rig, so the file cannot be read")
    try:
        return RunMetadata.from_record(record, collected.attachments[RIG_ATTACHMENT]), record["rig_sha256"]
    except STRANGE as error:
        raise RunError(f"{path}: its metadata are not those of a run: the file was changed") from error
    except RunError as error:
        raise RunError(f"{path}: {error}") from error


def _counted(collected: _Collected) -> int | None:
    if collected.statistics is None:
        return None
    counts = collected.statistics.channel_message_counts
    return sum(counts.get(channel, 0) for channel, topic in collected.topics.items() if topic == SAMPLES)
