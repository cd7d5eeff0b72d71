"""Read a run file from its start to its end or to its first damage, trusting nothing in it.

The library's indexed reader needs a whole file. This one reads in order and stops at the first record that does not
hold together: every chunk has a CRC, the two records that matter have a digest, the rig has its hash, and no length
found in the file is believed before it is compared with `LIMITS`.
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
    LIMITS,
    PROVENANCE,
    RIG_ATTACHMENT,
    SAMPLES,
    Stored,
    unsealed,
)
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.row_text import message_texts
from dpr_lab.storage.samples import STRANGE, Gathered, Samples, json_object
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
"""What the libraries raise on bytes that are not what they should be."""


@dataclass(frozen=True, slots=True)
class Scan:
    """Everything that could be read from a run file."""

    path: Path
    size_bytes: int
    """Up to a hole, if it has one."""
    sha256: str
    """Of these bytes."""
    metadata: RunMetadata
    rig_sha256: str
    read: Gathered
    """Samples, first release and last clock fit, as they were gathered chunk by chunk."""
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
        if self.read.strange_event:
            raise RunError(f"{self.path}: {EVENTS} is not in the layout of a run: {self.read.strange_event}")
        return self.read.release_tick

    @property
    def newest_clock(self) -> dict[str, Any]:
        """The last clock fit written while recording; empty when there is none.

        Raises:
            RunError: it is not in the layout of a run.
        """
        try:
            return json_object(self.read.clock) if self.read.clock else {}
        except STRANGE as error:
            raise RunError(f"{self.path}: {CLOCK} is not in the layout of a run: {error}") from error

    def samples(self) -> Samples:
        """Decode the samples.

        Raises:
            RunError: the channel holds something else, or ticks that do not increase.
        """
        if self.read.strange_sample:
            raise RunError(f"{self.path}: its samples are not in the layout of a run: {self.read.strange_sample}")
        samples = self.read.samples
        backwards = np.flatnonzero(np.diff(samples.ticks) <= 0)
        if len(backwards):
            raise RunError(f"{self.path}: sample {backwards[0] + 1} does not come after the one before it")
        return samples


@dataclass(slots=True)
class _Room:
    """How many bytes the chunks of a file may still expand to."""

    left: int = LIMITS.surplus_bytes

    def take(self, packed: int, expanded: int) -> None:
        """Account for a chunk, before it is expanded.

        Raises:
            McapError: it, or all chunks together, expand beyond the limits.
        """
        credit = LIMITS.expansion * packed
        most = min(LIMITS.record_bytes, credit + LIMITS.small_chunk_bytes, credit + self.left)
        if expanded > most:
            raise McapError(f"a chunk of {packed} bytes that would expand to {expanded}, {most} is the most")
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
    """Read a run file as far as it can be trusted.

    Raises:
        RunError: not there, empty, not MCAP, an MCAP of another tool, or damaged before its first sample.
    """
    collected = _Collected()
    with mapped(path) as file:
        if file[: len(MCAP0_MAGIC)] != MCAP0_MAGIC:
            raise RunError(
                f"{path}: is not a run file: it does not start as MCAP does; tables are read by `import table`"
            )
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
    """The messages of a run file in file order, chunk by chunk, up to its end or first damage."""
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
    """How the run ended, why early if it did, and how many samples it announced."""
    end = collected.records.get(END)
    if end is None:
        return None, "", None
    try:
        return RunSummary.from_record(end), printable(end["stopped"]), int(end["samples"])
    except (KeyError, TypeError, ValueError, OverflowError, AttributeError, RecursionError) as error:
        raise RunError(f"{path}: its end record is not in the layout of a run: it is another program's") from error


@contextmanager
def mapped(path: Path) -> Iterator[mmap.mmap]:
    """The file as memory: reading past its end is short, and no damaged length makes a read allocate.

    It ends where a hole begins. No run has one: the disk never got what was to stand there, or somebody made a small
    file claim any size.
    """
    try:
        with regular(path, RunError).open("rb") as file:
            length = _until_hole(file)
            if not length:
                raise RunError(f"{path}: is empty: nothing was recorded")
            with mmap.mmap(file.fileno(), length, access=mmap.ACCESS_READ) as content:
                yield content
    except IsADirectoryError as error:
        raise RunError(f"{path}: is a folder: name the runs in it, {path}/*.mcap") from error
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error


def _until_hole(file: BinaryIO) -> int:
    """How many bytes stand in a file before its first hole, or its end."""
    if not hasattr(os, "SEEK_HOLE"):
        return os.fstat(file.fileno()).st_size
    try:
        return os.lseek(file.fileno(), 0, os.SEEK_HOLE)
    except OSError:  # an empty file, or a file system that does not know
        return os.fstat(file.fileno()).st_size


class _Reader(StreamReader):
    """Passes over the index of each chunk, which costs more than its messages and is not used here."""

    def _read_record(self, opcode: int, length: int) -> McapRecord | None:
        return None if opcode == Opcode.MESSAGE_INDEX else super()._read_record(opcode, length)


def _reader(file: mmap.mmap) -> StreamReader:
    # The mapping reads, tells and seeks like a file but is not declared as one.
    return _Reader(file, emit_chunks=True, validate_crcs=True, record_size_limit=LIMITS.record_bytes)  # pyright: ignore[reportArgumentType]


def _collect(file: mmap.mmap, collected: _Collected) -> str:
    """Gather the records in file order; returns the damage that ended it, if any."""
    reader = _reader(file)
    try:
        for record in reader.records:
            _take(record, collected)
    except DAMAGE as error:
        return f"cut off or damaged near byte {file.tell()} of {len(file)}{_reason(error)}"
    return "" if collected.finished else "cut off before its end"


def _reason(error: Exception) -> str:
    """What is wrong, in brackets, where a sentence of ours says it; a library's words help nobody at the bench."""
    if type(error) is McapError and str(error):
        return f" ({error})"
    if isinstance(error, CRCValidationError):
        return " (its content does not fit its check sum)"
    return ""


def _take(record: McapRecord, collected: _Collected) -> None:
    match record:
        case Chunk():
            content = _expanded(record, collected.room)
            if not _take_rows(content, collected):
                collected.read.take(_messages(record, content, collected.topics))
        case Metadata(name=name, metadata=content) if name in (PROVENANCE, END):
            read = unsealed(content)
            if read is None:
                raise McapError(f"the {name} record does not fit its digest")
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
    """The records of a chunk, unpacked and checked.

    Raises:
        DAMAGE: it is not one that a run holds, or does not fit its CRC.
    """
    expanded = chunk.uncompressed_size
    if chunk.compression == "zstd":
        expanded = max(expanded, zstandard.frame_content_size(chunk.data))
    elif chunk.compression:
        raise McapError(f"a chunk compressed with {chunk.compression[:20]!r}, which no run uses")
    room.take(len(chunk.data), expanded)
    if not chunk.uncompressed_crc:
        raise McapError("a chunk without a CRC")
    content = zstandard.decompress(chunk.data, expanded) if chunk.compression else chunk.data
    if zlib.crc32(content) != chunk.uncompressed_crc:
        raise McapError("a chunk that does not fit its CRC")
    return content


def _take_rows(content: bytes, collected: _Collected) -> bool:
    """Take the samples of a chunk that holds nothing but rows of one width; false for any other."""
    rows = message_texts(content)
    if rows is None or collected.topics.get(rows[0]) != SAMPLES:
        return False
    return collected.read.take_rows(rows[1])


def _messages(chunk: Chunk, content: bytes, topics: dict[int, str]) -> list[Stored]:
    """The messages of a chunk of this content."""
    records = breakup_chunk(replace(chunk, compression="", data=content))
    topics.update({record.id: record.topic for record in records if isinstance(record, Channel)})
    messages = [record for record in records if isinstance(record, Message)]
    if any(message.channel_id not in topics for message in messages):
        raise McapError("a message of a channel that was not announced")
    return [Stored(topics[m.channel_id], m.log_time, m.publish_time, m.data) for m in messages]


def _description(path: Path, collected: _Collected, damage: str) -> tuple[RunMetadata, str]:
    record = collected.records.get(PROVENANCE)
    if record is None and not damage:
        raise RunError(f"{path}: is an MCAP file of another tool: it has no dpr-lab provenance record")
    if record is None or RIG_ATTACHMENT not in collected.attachments:
        raise RunError(f"{path}: {damage}, before the rig it was recorded on: nothing can be read from it")
    try:
        return RunMetadata.from_record(record, collected.attachments[RIG_ATTACHMENT]), record["rig_sha256"]
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise RunError(f"{path}: its description is not in the layout of a run: it was changed") from error
    except RunError as error:
        raise RunError(f"{path}: {error}") from error


def _counted(collected: _Collected) -> int | None:
    if collected.statistics is None:
        return None
    counts = collected.statistics.channel_message_counts
    return sum(counts.get(channel, 0) for channel, topic in collected.topics.items() if topic == SAMPLES)
