"""Lines of a plain or gzip text file, read in blocks to limit the memory."""

import codecs
import gzip
import io
import mimetypes
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from dpr_lab.errors import RunError
from dpr_lab.progress import ImportProgress, OnImport

COMMENTS = ("#", "%", "//")
GZIP = b"\x1f\x8b"
_CONTROL = bytes(set(range(32)) - set(b"\t\n\f\r"))

Line = tuple[int, str]
"""Line number in the file, from 1, and text."""


@dataclass(frozen=True, slots=True)
class TableLimits:
    """Limits of a table file.

    Text is read in blocks and stored as numbers.
    """

    looked_at: int = 50
    """Number of rows used to detect delimiter and decimal sign, and maximum number of comments that are kept."""
    line_length: int = 1 << 16
    rows: int = 50_000_000
    """Maximum number of rows; an hour at 10 kHz has 36 million."""
    values: int = 50_000_000
    """Maximum number of values in a binary file, which may be compressed: 400 MB unpacked."""
    head: int = 1000
    """Maximum number of lines before the first row of numbers."""
    block_bytes: int = 1 << 20
    expansion: int = 200
    """Maximum ratio of unpacked to compressed size. Rows of constant angles have a ratio of about 30."""
    rows_as_columns: int = 7
    """Maximum number of rows that can be quantities: a time, and for arm and two rods an angle and a speed each."""
    instants: int = 5
    """Minimum ratio of columns to rows for a table whose rows are quantities and whose columns are instants."""
    named: int = 20
    """Maximum number of column names in a message."""
    small_bytes: int = 1 << 24
    """Maximum unpacked size of a small compressed file, bytes."""


class Content:
    """Text of a file that is read by line or by block; a context manager.

    Args:
        path: the file
        limits: limits of the file
        on_progress: function that is called after each block

    Raises:
        RunError: the file is empty, is not text, or is a damaged or too large compressed file. The methods raise this
            error too.
        OSError: the file cannot be read.
    """

    def __init__(self, path: Path, limits: TableLimits, on_progress: OnImport) -> None:
        self.comments: list[str] = []
        """Texts of the first comments and of the last comment above the numbers."""
        self._path, self._limits, self._on_progress = path, limits, on_progress
        coding = _coding(path, limits)
        self._packed = path.open("rb")
        self._size = path.stat().st_size
        self._file = io.TextIOWrapper(_unpacked(self._packed), encoding=coding, newline=None)
        self._text, self._at, self._number = "", 0, 1
        self._data = False

    def __enter__(self) -> "Content":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
        self._packed.close()

    def lines(self) -> Iterator[Line]:
        """Yield non-empty lines with their numbers; comments are stored separately."""
        while self._at < len(self._text) or self._read_block():
            end = self._text.find("\n", self._at)
            end = len(self._text) if end < 0 else end
            line, number = self._text[self._at : end], self._number
            self._at, self._number = end + 1, number + 1
            if cleaned := self._kept(number, line):
                yield cleaned

    def blocks(self) -> Iterator[Line]:
        """Yield blocks of complete lines, each with the number of its first line.

        Unlike `lines`, blocks include comments and empty lines. The last block may lack a line end.
        """
        while self._at < len(self._text) or self._read_block():
            number, text = self._number, self._text[self._at :]
            self._at = len(self._text)
            self._number += text.count("\n")
            yield number, text

    def lines_of(self, number: int, text: str) -> Iterator[Line]:
        """Yield the non-empty lines of a block with their numbers."""
        for line_number, line in enumerate(text.split("\n"), number):
            if cleaned := self._kept(line_number, line):
                yield cleaned

    def _kept(self, number: int, line: str) -> Line | None:
        if len(line) > self._limits.line_length:
            most = self._limits.line_length
            raise RunError(f"{self._path}: line {number} is longer than {most} characters: not a table")
        text = line.strip(" \f")
        if text.startswith(COMMENTS):
            if not self._data:
                del self.comments[self._limits.looked_at :]
                self.comments.append(text.lstrip("#%/ "))
            return None
        self._data = self._data or bool(text)
        return (number, text) if text else None

    def _read_block(self) -> bool:
        """Read complete lines; return False at the end of the file."""
        self._text = self._file.read(self._limits.block_bytes)
        if self._text and not self._text.endswith("\n"):
            self._text += self._file.readline(self._limits.line_length + 1)
        self._at = 0
        self._on_progress(ImportProgress("read", min(self._packed.tell(), self._size), self._size))
        return bool(self._text)


def _unpacked(packed: BinaryIO) -> BinaryIO:
    """Open a text file for reading as bytes, decompressed if needed."""
    start = packed.read(len(GZIP))
    packed.seek(0)
    return gzip.GzipFile(fileobj=packed) if start == GZIP else packed  # pyright: ignore[reportReturnType]


def most_unpacked(path: Path, limits: TableLimits) -> int:
    """Return the maximum unpacked size of a compressed file, bytes."""
    return limits.small_bytes + limits.expansion * path.stat().st_size


def _coding(path: Path, limits: TableLimits) -> str:
    """Determine the character encoding of a text file from the complete file.

    Spreadsheets write UTF-16 as "Unicode text".

    Raises:
        RunError: the file is empty, not text, damaged, or expands beyond the limits.
    """
    try:
        return _coding_of(path, limits)
    except (gzip.BadGzipFile, EOFError, zlib.error) as error:
        raise RunError(f"{path}: is damaged or incomplete and cannot be unpacked: copy it again") from error


def _coding_of(path: Path, limits: TableLimits) -> str:
    with path.open("rb") as packed, _unpacked(packed) as file:
        block = file.read(limits.block_bytes)
        wide = block.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE))
        coding = "utf-16" if wide else "utf-8-sig"
        decoder, something, control, valid = codecs.getincrementaldecoder(coding)(), False, False, True
        while block and (wide or not control):
            something = something or bool(block.strip())
            control = control or len(block.translate(None, _CONTROL)) != len(block)
            valid = valid and ((block.isascii() and not wide) or _decodes(decoder, block))
            block = file.read(limits.block_bytes)
            if file.tell() > most_unpacked(path, limits):
                raise RunError(f"{path}: expands to far more data than a table contains: unpack and inspect it first")
        valid = valid and _decodes(decoder, b"", final=True)
        if control and not (wide and valid):
            raise RunError(f"{path}: {_no_text(path, compressed=file is not packed)}")
    if not something:
        raise RunError(f"{path}: is empty; check the path, or write the table again")
    return coding if valid else "latin-1"  # only the degree sign in a header can be affected


def _no_text(path: Path, *, compressed: bool) -> str:
    """State why a file is not a text table, and what the user can do."""
    kind = str(mimetypes.guess_type(path)[0]).partition("/")[0]
    if kind == "video":
        return (
            "is a video: track the pivot, the elbow and the tip of the rods in it first (Tracker, DeepLabCut), then"
            " import the table of these points (docs/how-to/video.md)"
        )
    if kind == "image":
        return "is a picture: a recording is a table of times and angles"
    instruction = "unpack it with gunzip" if compressed else "export it as CSV (UTF-8) from the program that wrote it"
    return f"is a binary file and not a text table: {instruction} first"


def _decodes(decoder: codecs.IncrementalDecoder, block: bytes, final: bool = False) -> bool:
    try:
        decoder.decode(block, final)
    except UnicodeDecodeError:
        return False
    return True
