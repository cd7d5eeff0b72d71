"""Extensions of `mcap.writer.Writer`: a chunk index on disk, and a function that writes many messages at once."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any

import numpy as np
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, MessageIndex
from mcap.writer import Writer
from numpy.typing import NDArray

from dpr_lab.arrays import Integers


class ChunkIndices:
    """Chunk index that is kept in a temporary file while an MCAP file is written.

    `mcap.writer.Writer` copies the index to the end of the MCAP file.

    Args:
        folder: folder of the temporary file, which takes 0.15 kB per chunk

    Raises:
        OSError: the file cannot be created. `append` raises this error if the disk is full.
    """

    def __init__(self, folder: Path) -> None:
        self._file = TemporaryFile(dir=folder)
        self._count = 0

    def append(self, index: ChunkIndex) -> None:
        """Append the index of one chunk."""
        record = RecordBuilder()
        index.write(record)
        self._file.write(record.end())
        self._count += 1

    def close(self) -> None:
        """Discard all entries."""
        self._file.close()

    def __iter__(self) -> Iterator[ChunkIndex]:
        """Yield all entries in the order in which they were appended."""
        self._file.seek(0)
        stream = ReadDataStream(self._file)
        for _ in range(self._count):
            stream.read(9)  # header of an MCAP record: kind and length
            yield ChunkIndex.read(stream)


class RowIndex(MessageIndex):
    """Message index (n, 2) of one chunk: log time, ns, and byte offset."""

    def __init__(self, channel: int, entries: Integers) -> None:
        super().__init__(channel, [])
        self._entries = entries

    def write(self, stream: RecordBuilder) -> None:
        """Write the index as an MCAP record."""
        stream.start_record(Opcode.MESSAGE_INDEX)
        stream.write2(self.channel_id)
        stream.write4(self._entries.nbytes)
        stream.write(self._entries.astype("<u8").tobytes())
        stream.finish_record()


def write_rows(writer: Writer, channel: int, log_ns: Integers, records: NDArray[np.uint8]) -> None:
    """Write message records (n, width) with increasing log times (n,), ns, as one chunk."""
    writer.flush()
    chunk: Any = getattr(writer, "_Writer__chunk_builder")  # noqa: B009
    statistics: Any = getattr(writer, "_Writer__statistics")  # noqa: B009
    first, last, (n, width) = int(log_ns[0]), int(log_ns[-1]), records.shape
    offsets = chunk.count + width * np.arange(n)
    chunk.message_indices[channel] = RowIndex(channel, np.column_stack([log_ns, offsets]))
    chunk.message_start_time, chunk.message_end_time, chunk.num_messages = first, last, n
    chunk.record_writer.write(records.tobytes())
    statistics.message_start_time = min(first, statistics.message_start_time) if statistics.message_count else first
    statistics.message_end_time = max(last, statistics.message_end_time)
    statistics.channel_message_counts[channel] += n
    statistics.message_count += n
    writer.flush()


def keep_on_disk(writer: Writer, folder: Path) -> ChunkIndices:
    """Replace the chunk index of a new writer by one on disk.

    The index in memory would take 0.6 kB per chunk.
    """
    name = "_Writer__chunk_indices"
    if getattr(writer, name) != []:
        raise ValueError("this writer has already started")
    indices = ChunkIndices(folder)
    setattr(writer, name, indices)
    return indices
