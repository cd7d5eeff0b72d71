"""The index of a run file under way, kept on disk so that memory stays flat however long the recording lasts."""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryFile

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.records import ChunkIndex
from mcap.writer import Writer


class ChunkIndices:
    """What `mcap.writer.Writer` keeps of every chunk until it writes the index at the end, as bytes in a nameless file.

    Args:
        folder: where there is room for 0.15 kB a chunk

    Raises:
        OSError: there is none, here or in `append`.
    """

    def __init__(self, folder: Path) -> None:
        self._file = TemporaryFile(dir=folder)
        self._count = 0

    def append(self, index: ChunkIndex) -> None:
        """Keep one more."""
        record = RecordBuilder()
        index.write(record)
        self._file.write(record.end())
        self._count += 1

    def close(self) -> None:
        """Forget them."""
        self._file.close()

    def __iter__(self) -> Iterator[ChunkIndex]:
        """All of them, in the order they came."""
        self._file.seek(0)
        stream = ReadDataStream(self._file)
        for _ in range(self._count):
            stream.read(9)  # the header of an MCAP record: its kind and its length
            yield ChunkIndex.read(stream)


def keep_on_disk(writer: Writer, folder: Path) -> ChunkIndices:
    """Give a writer that has not begun an index on disk in place of its list, which takes 0.6 kB a chunk."""
    name = "_Writer__chunk_indices"
    if getattr(writer, name) != []:
        raise ValueError("this writer has begun")
    indices = ChunkIndices(folder)
    setattr(writer, name, indices)
    return indices
