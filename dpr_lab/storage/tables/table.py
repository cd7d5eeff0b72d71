"""Read the text table of any logger: delimiter, header, comments and decimal sign are found, not asked for."""

import codecs
import csv
from array import array
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import RunError, printable

DELIMITERS = (";", "\t", ",")  # in this order: next to a semicolon or a tab a comma is the decimal sign
COMMENTS = ("#", "%", "//")
NOT_A_VALUE = ("", "nan", "na", "n/a", "null", "none", "-")

_CONTROL = bytes(set(range(32)) - set(b"\t\n\f\r"))


@dataclass(frozen=True, slots=True)
class TableLimits:
    """What a text table is taken for; it is read in one go, a line at a time, and kept as numbers."""

    looked_at: int = 50
    """Rows from which delimiter and decimal sign are found."""
    line_length: int = 1 << 16
    rows: int = 50_000_000
    """An hour at 10 kHz has 36 million."""
    values: int = 50_000_000
    """Numbers in a file that is not text, which may be packed: 400 MB unpacked."""
    head: int = 1000
    """Lines before the first row of numbers."""
    block_bytes: int = 1 << 20


LIMITS = TableLimits()


@dataclass(frozen=True, slots=True)
class Table:
    """A table's columns."""

    path: Path
    names: tuple[str, ...]
    """Column names; `1`, `2`, ... when the table has no header."""
    values: tuple[NDArray[np.float64], ...]
    """Of each column; NaN where the logger wrote no value, or none that is a number."""
    strange: tuple[str, ...]
    """Of each column, the first field that is neither number nor missing, with its line; empty without."""
    lines: NDArray[np.int64]
    """Line number in the file of each row (row number, where it has no lines), counted from 1."""
    notes: tuple[str, ...] = ()
    kind: str = "text table"
    """What kind of file it is."""
    heading: tuple[tuple[str, ...], ...] = ()
    """The rows above the numbers, as they stand."""
    other_lengths: Mapping[str, int] = field(default_factory=dict)
    """Columns with another number of values, left out, and how many they have."""
    settled: bool = False
    """Whether the angles are absolute, 0 = upright, rad, whatever is said of the table."""

    def column(self, name: str) -> NDArray[np.float64]:
        """(n,) values of one column; NaN where the logger wrote none.

        Raises:
            RunError: a field that is not a number; names line and column.
        """
        at = self.names.index(name)
        if self.strange[at]:
            raise RunError(f"{self.path}: {self.strange[at]} in column {name!r} is not a number")
        return self.values[at].copy()


Line = tuple[int, str]


def read_table(path: Path) -> Table:
    """Read a table with one header line or none.

    Raises:
        RunError: cannot be read, empty, not text, without numbers, or a row of another length.
    """
    try:
        with _Content(path, _coding(path)) as content:
            lines = iter(content)
            head = list(islice(lines, LIMITS.looked_at))
            if not head:
                raise RunError(f"{path}: holds no rows")
            delimiter = _delimiter([line for _, line in head])
            rows = ((number, _cells(path, line, delimiter)) for number, line in chain(head, lines))
            early: list[list[str]] = []
            for begin in rows:
                if _is_data(begin[1]):
                    break
                early.append(begin[1])
                if len(early) > LIMITS.head:
                    raise RunError(f"{path}: holds no row of numbers in its first {LIMITS.head} lines")
            else:
                raise RunError(f"{path}: holds no row of numbers, so it is not a table of angles")
            early = [_trimmed(other, len(begin[1])) for other in early]
            if early:
                wide = [other for other in early if len(other) == len(begin[1])]
                # Above the names of columns, names of groups of them may stand.
                names = next((other for other in wide if all(other)), (wide or early[-1:])[0])
            else:
                names = _commented_header(content.comments, delimiter, len(begin[1]))
            begun = [begin, *islice(rows, LIMITS.looked_at - 1)]
            comma = delimiter != "," and any("," in cell for _, cells in begun for cell in cells)
            columns = _Columns(path, len(names), comma)
            columns.take(chain(begun, rows))
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    shown = tuple(printable(name.strip()) for name in names)
    heading = tuple(tuple(printable(cell.strip()) for cell in row) for row in early)
    strange = tuple(columns.strange)
    return Table(path, shown, columns.arrays, strange, columns.line_numbers, columns.notes, heading=heading)


class _Columns:
    """Columns of numbers that grow row by row."""

    def __init__(self, path: Path, width: int, decimal_comma: bool) -> None:
        self.strange = [""] * width
        self.notes: tuple[str, ...] = ()
        self._path, self._comma = path, decimal_comma
        self._values = [array("d") for _ in range(width)]
        self._lines = array("q")

    @property
    def arrays(self) -> tuple[NDArray[np.float64], ...]:
        return tuple(np.frombuffer(column, dtype=np.float64) for column in self._values)

    @property
    def line_numbers(self) -> NDArray[np.int64]:
        return np.frombuffer(self._lines, dtype=np.int64)

    def take(self, rows: Iterable[tuple[int, list[str]]]) -> None:
        """All rows; a last one that is too short was cut off by a logger that was switched off."""
        short: tuple[int, int] | None = None
        for number, row in rows:
            if short is not None or len(row) > len(self._values):
                self._refuse(*(short or (number, len(row))))
            if len(row) < len(self._values):
                short = (number, len(row))
                continue
            if len(self._lines) == LIMITS.rows:
                raise RunError(f"{self._path}: has more than {LIMITS.rows:,} rows: cut it into recordings")
            self._lines.append(number)
            for at, cell in enumerate(row):
                self._values[at].append(self._number(cell.strip(), at, number))
        if short is not None and not self._lines:
            self._refuse(*short)
        if short is not None:
            self.notes = (f"line {short[0]}, the last one, is cut off: left out",)

    def _refuse(self, number: int, length: int) -> NoReturn:
        raise RunError(f"{self._path}: line {number} has {length} fields where there are {len(self._values)} columns")

    def _number(self, word: str, at: int, line: int) -> float:
        try:
            return float(word.replace(",", ".") if self._comma else word)
        except ValueError:
            if word.lower() not in NOT_A_VALUE and not self.strange[at]:
                self.strange[at] = f"line {line}: {printable(word[:40])!r}"
            return np.nan


class _Content:
    """The lines of a text file that hold something, with their numbers; comments are set aside. A context manager."""

    def __init__(self, path: Path, coding: str) -> None:
        self.comments: deque[Line] = deque(maxlen=1)
        """The last one before what was read."""
        self._path = path
        self._file = path.open(encoding=coding, newline=None)

    def __enter__(self) -> "_Content":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __iter__(self) -> Iterator[Line]:
        number, data = 0, False
        while line := self._file.readline(LIMITS.line_length + 1):
            number += 1
            if len(line) > LIMITS.line_length:
                raise RunError(f"{self._path}: line {number} is longer than {LIMITS.line_length} characters: no table")
            text = line.strip(" \f\n")
            if text.startswith(COMMENTS):
                if not data:
                    self.comments.append((number, text))
            elif text:
                data = True
                yield number, text


def _coding(path: Path) -> str:
    """The coding of a text file, which is looked through block by block.

    Raises:
        RunError: it is empty, or no text.
    """
    decoder, something, utf8 = codecs.getincrementaldecoder("utf-8-sig")(), False, True
    with path.open("rb") as file:
        while block := file.read(LIMITS.block_bytes):
            something = something or bool(block.strip())
            if len(block.translate(None, _CONTROL)) != len(block):
                raise RunError(
                    f"{path}: is not a text table but a binary file: export it as CSV (UTF-8) from its program first"
                )
            utf8 = utf8 and _decodes(decoder, block)
        utf8 = utf8 and _decodes(decoder, b"", final=True)
    if not something:
        raise RunError(f"{path}: is empty")
    return "utf-8-sig" if utf8 else "latin-1"  # a degree sign in a header is all that this can get wrong


def _decodes(decoder: codecs.IncrementalDecoder, block: bytes, final: bool = False) -> bool:
    try:
        decoder.decode(block, final)
    except UnicodeDecodeError:
        return False
    return True


def _trimmed(row: list[str], width: int) -> list[str]:
    """A row above the numbers without the empty fields that stand beyond them."""
    return row[:width] if not any(row[width:]) else row


def _delimiter(lines: list[str]) -> str | None:
    """The first that most lines hold; None for blanks."""
    return next((d for d in DELIMITERS if sum(d in line for line in lines) > len(lines) / 2), None)


def _cells(path: Path, line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    except csv.Error as error:
        raise RunError(f"{path}: is not a table: {error}") from error


def _is_data(row: list[str]) -> bool:
    """Whether a row holds numbers, rather than names or units; a column of words beside them does not matter."""
    numbers = sum(map(_is_number, row))
    empty = sum(cell.strip().lower() in NOT_A_VALUE for cell in row)
    return numbers > 0 and 2 * (numbers + empty) >= len(row)


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell.strip().replace(",", "."))))
    except ValueError:
        return False


def _commented_header(comments: Sequence[Line], delimiter: str | None, width: int) -> list[str]:
    """The header in the last comment above the numbers, where it has as many names; else column numbers."""
    names = comments[-1][1].lstrip("#%/ ").split(delimiter) if comments else []
    return names if len(names) == width else [str(n + 1) for n in range(width)]
