"""Read a text table of any logger; delimiter, header, comments and decimal sign are detected."""

import csv
import re
from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain, islice
from pathlib import Path
from typing import NoReturn

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.errors import RunError, printable
from dpr_lab.progress import OnImport, unwatched
from dpr_lab.run import FilmNoise
from dpr_lab.storage.tables.clean import NOT_A_VALUE, clean_rows
from dpr_lab.storage.tables.content import Content, Line, TableLimits

DELIMITERS = (";", "\t", ",")  # The order matters: in a table with semicolons or tabs, a comma is the decimal sign.
LIMITS = TableLimits()
_CLOCK_TIME = re.compile(r"(?:.*[ T])?(?:(\d{1,2}):)?(\d{1,2}):(\d{2}(?:[.,]\d+)?)(?:Z|[+-]\d{2}:?\d{2})?")


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of a table, with their names."""

    path: Path
    names: tuple[str, ...]
    """Column names; `1`, `2`, ... if the table has no header."""
    values: tuple[Array, ...]
    """Values of each column; NaN if a value is missing or not a number."""
    strange: tuple[str, ...]
    """For each column, its first field that is neither a number nor a missing value, with its line; empty if there is
    none."""
    lines: Integers
    """Line number of each row in the file, from 1; the row number if the file has no lines."""
    notes: tuple[str, ...] = ()
    kind: str = "text table"
    """Kind of the file."""
    heading: tuple[tuple[str, ...], ...] = ()
    """Rows above the numbers, unchanged."""
    other_lengths: Mapping[str, int] = field(default_factory=dict)
    """Column -> number of its values, for columns that are ignored because their length differs from the others."""
    settled: bool = False
    """Whether the values are already absolute angles in rad, 0 = upright, so that no option changes them."""
    film_noise: FilmNoise | None = None
    """Noise of the angles, if they were computed from points in a video."""
    frames: Array | None = None
    """(n,) original number of each row, from 0, if frames of a video were removed; None for consecutive rows."""

    def column(self, name: str) -> Array:
        """(n,) values of one column; NaN for missing values.

        Raises:
            RunError: a field that is not a number; the message names line and column.
        """
        place = self.names.index(name)
        if self.strange[place]:
            raise RunError(
                f"{self.path}: {self.strange[place]} in column {name!r} is not a number: correct it, or leave"
                f" the field empty if its value is missing; if another table begins there, split the file"
            )
        return self.values[place].copy()


def read_table(path: Path, on_progress: OnImport = unwatched) -> Table:
    """Read a table with at most one header line; text compressed by gzip is decompressed.

    Args:
        path: the file
        on_progress: called after each block

    Raises:
        RunError: the file cannot be read, is empty, not text, without numbers, or has a row of another length.
    """
    try:
        with Content(path, LIMITS, on_progress) as content:
            lines = content.lines()
            head = list(islice(lines, LIMITS.looked_at))
            if not head:
                raise RunError(f"{path}: contains no rows")
            delimiter = _delimiter([line for _, line in head])
            rows = ((number, _cells(path, line, delimiter)) for number, line in chain(head, lines))
            early: list[list[str]] = []
            for begin in rows:
                if _is_data(begin[1]):
                    break
                early.append(begin[1])
                if len(early) > LIMITS.head:
                    raise RunError(f"{path}: contains no row of numbers in its first {LIMITS.head} lines")
            else:
                raise RunError(f"{path}: contains no row of numbers, so it is not a table of angles")
            early = [_trimmed(other, len(begin[1])) for other in early]
            names = _names(early, content.comments, delimiter, len(begin[1]))
            first = [begin, *islice(rows, LIMITS.looked_at - 1)]
            comma = delimiter != "," and any("," in cell for _, cells in first for cell in cells)
            columns = _Columns(path, len(names), comma)
            # `rows` may still contain lines of `head`.
            columns.take(chain(first, islice(rows, LIMITS.looked_at)))
            for number, text in content.blocks():
                if not columns.take_block(number, text, delimiter):
                    columns.take(
                        (line_number, _cells(path, line, delimiter))
                        for line_number, line in content.lines_of(number, text)
                    )
            columns.finish()
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
        self._short: tuple[int, int] | None = None

    @property
    def arrays(self) -> tuple[Array, ...]:
        return tuple(np.frombuffer(column, dtype=np.float64) for column in self._values)

    @property
    def line_numbers(self) -> Integers:
        return np.frombuffer(self._lines, dtype=np.int64)

    def take(self, rows: Iterable[tuple[int, list[str]]]) -> None:
        """Append rows.

        Only the last row may be too short.
        """
        for number, row in rows:
            if self._short is not None or len(row) > len(self._values):
                self._refuse(*(self._short or (number, len(row))))
            if len(row) < len(self._values):
                self._short = (number, len(row))
                continue
            if len(self._lines) == LIMITS.rows:
                raise RunError(f"{self._path}: has more than {LIMITS.rows:,} rows: split it into recordings")
            self._lines.append(number)
            for place, cell in enumerate(row):
                self._values[place].append(self._number(cell.strip(), place, number))

    def take_block(self, number: int, text: str, delimiter: str | None) -> bool:
        """Append a block of lines that contain only numbers, from line `number` on.

        Returns False, and appends nothing, for other lines.
        """
        if self._short is not None:
            return False
        rows = clean_rows(text, len(self._values), delimiter, self._comma, LIMITS.line_length)
        if rows is None or len(self._lines) + len(rows) > LIMITS.rows:
            return False
        self._lines.frombytes(np.arange(number, number + len(rows)).tobytes())
        for column, values in zip(self._values, rows.T, strict=True):
            column.frombytes(values.tobytes())
        return True

    def finish(self) -> None:
        """End the table.

        A short last row was truncated when the logger was switched off, so it is ignored with a note.
        """
        if self._short is None:
            return
        if not self._lines:
            self._refuse(*self._short)
        self.notes = (f"line {self._short[0]}, the last one, is incomplete: ignored",)

    def _refuse(self, number: int, length: int) -> NoReturn:
        width = len(self._values)
        decimal = ": if commas are decimal signs, export it with semicolons between the columns"
        raise RunError(
            f"{self._path}: line {number} has {length} fields, but there are {width} columns"
            + (decimal if width < length <= 2 * width else "")
        )

    def _number(self, word: str, place: int, line: int) -> float:
        """A field as number.

        A time such as `14:30:00.123`, `30:00.1`, or with a date before it, is converted to seconds.
        """
        try:
            return float(word.replace(",", ".") if self._comma else word)
        except ValueError:
            if clock := _CLOCK_TIME.fullmatch(word):
                hours, minutes, seconds = clock.groups("0")
                return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds.replace(",", "."))
            if word.lower() not in NOT_A_VALUE and not self.strange[place]:
                self.strange[place] = f"line {line}: {printable(word[:40])!r}"
            return np.nan


def _names(early: list[list[str]], comments: Sequence[Line], delimiter: str | None, width: int) -> list[str]:
    """Names of the columns: from the rows above the numbers, or from the last comment, or else column numbers."""
    if not early:
        return _commented_header(comments, delimiter, width)
    wide = [row for row in early if len(row) == width] or _otherwise_separated(early, delimiter, width)
    # Names of groups may precede the names of columns.
    return next((row for row in wide if all(row)), (wide or early[-1:])[0])


def _otherwise_separated(early: list[list[str]], delimiter: str | None, width: int) -> list[list[str]]:
    """Possible header rows with one name per column, if the header has another delimiter than the numbers."""
    lines = [(delimiter or " ").join(row) for row in early]
    split = [line.split(other) for line in lines for other in (*DELIMITERS, None)]
    return [names for names in split if len(names) == width]


def _trimmed(row: list[str], width: int) -> list[str]:
    """Row above the numbers, without empty fields beyond the width of the table."""
    return row[:width] if not any(row[width:]) else row


def _delimiter(lines: list[str]) -> str | None:
    """First delimiter that most lines contain; None for blanks."""
    return next((d for d in DELIMITERS if sum(d in line for line in lines) > len(lines) / 2), None)


def _cells(path: Path, line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    except csv.Error as error:
        raise RunError(f"{path}: is not a table: this line has no fields: {printable(line[:60])!r}") from error


def _is_data(row: list[str]) -> bool:
    """Whether a row contains numbers rather than names or units; an additional column of words is accepted."""
    numbers = sum(map(_is_number, row))
    empty = sum(cell.strip().lower() in NOT_A_VALUE for cell in row)
    return numbers > 0 and 2 * (numbers + empty) >= len(row)


def _is_number(cell: str) -> bool:
    try:
        return bool(np.isfinite(float(cell.strip().replace(",", "."))))
    except ValueError:
        return False


def _commented_header(comments: Sequence[Line], delimiter: str | None, width: int) -> list[str]:
    """Header in the last comment above the numbers.

    Column numbers are returned if the comment does not have one name per column.
    """
    names = comments[-1][1].lstrip("#%/ ").split(delimiter) if comments else []
    return names if len(names) == width else [str(n + 1) for n in range(width)]
