"""Read the text table of any logger; delimiter, header, comments and decimal sign are detected."""

import re
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime, time
from itertools import chain, islice
from pathlib import Path
from typing import NoReturn
from unicodedata import normalize

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.errors import RunError, printable
from dpr_lab.progress import OnImport, unwatched
from dpr_lab.run import FilmNoise
from dpr_lab.storage.tables.cells import (
    CLOCK_TIME,
    DATE,
    MINUS,
    NEXT,
    NOT_A_VALUE,
    ONLY_UNIT,
    QUANTITY,
    cells_of,
    clean_rows,
    column_names,
    delimiter_of,
    ends_with_delimiter,
    has_decimal_comma,
    has_name,
    is_data,
    joined,
    labels_of,
    names_of_numbers,
    numbers_of,
    rows_above_names,
    value_of,
    with_unit,
)
from dpr_lab.storage.tables.content import Content, TableLimits
from dpr_lab.storage.tables.options import date_in
from dpr_lab.storage.tables.time_stamps import runs

LIMITS = TableLimits()
_DECIMAL = re.compile(r"[+-]?\d+\.\d+(e[+-]?\d+)?", re.I)
_FORMS = (
    ": a table is read from rows of numbers with commas, semicolons, tabs, bars (|) or blanks between them, or from"
    " rows such as `t=0.01 theta1=1.57 theta2=0.2`"
)


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """Values of a table under one name."""

    name: str
    """Name in the header, or the number of the column if the table has no header."""
    values: Array
    """(n,) values; NaN if a value is missing or not a number."""
    strange: str = ""
    """First field that is neither a number nor a missing value, with its line; empty if there is none."""
    midnight: float = 0.0
    """Zero of times with dates, s since 1970; times without a zone are local times. 0 for other values."""


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of a table."""

    path: Path
    columns: tuple[Column, ...]
    lines: Integers
    """Line number of each row in the file, from 1; the row number if the file has no lines."""
    notes: tuple[str, ...] = ()
    kind: str = "text table"
    """Kind of the file."""
    heading: tuple[tuple[str, ...], ...] = ()
    """Rows above the numbers, unchanged."""
    other_lengths: Mapping[str, int] = field(default_factory=dict)
    """Number of values of each column that is ignored because its length differs from the others."""
    settled: bool = False
    """Whether the values are already absolute angles in rad, 0 = upright, so that no option changes them."""
    film_noise: FilmNoise | None = None
    """Noise of the angles, if they were computed from points in a video."""
    frames: Array | None = None
    """(n,) original number of each row, from 0, if frames of a video were removed; None for consecutive rows."""
    recorded_at: str = ""
    """Date, or date and time in UTC, in the lines above the numbers; empty if they contain none."""
    repeated: tuple[int, ...] = ()
    """Lines in which the header is repeated."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(column.name for column in self.columns)

    @property
    def values(self) -> tuple[Array, ...]:
        """Values (n,) of the columns."""
        return tuple(column.values for column in self.columns)

    @property
    def named(self) -> Iterator[tuple[str, Array]]:
        """Name and values (n,) of each column."""
        return ((column.name, column.values) for column in self.columns)

    def rows(self, mask: Flags, *notes: str) -> "Table":
        """Return the table with the rows of a mask (n,) and further notes."""
        return replace(
            self,
            columns=tuple(replace(column, values=column.values[mask]) for column in self.columns),
            lines=self.lines[mask],
            notes=(*self.notes, *notes),
            frames=None if self.frames is None else self.frames[mask],
        )

    def column(self, name: str) -> Array:
        """Return the values (n,) of one column; missing values are NaN.

        Raises:
            RunError: a field is not a number; the message names line and column.
        """
        column = self.columns[self.names.index(name)]
        if column.strange:
            raise RunError(
                f"{self.path}: {column.strange} in column {name!r} is not a number: correct the field, or leave"
                " it empty if its value is missing; if another table begins there, split the file"
            )
        return column.values.copy()


def read_table(path: Path, on_progress: OnImport = unwatched) -> Table:
    """Read a table with at most one header line; text compressed by gzip is decompressed.

    Args:
        path: the file
        on_progress: function that is called after each block

    Raises:
        RunError: the file cannot be read, is empty, is not text, contains no numbers, or has a row with another
            number of fields.
    """
    try:
        with Content(path, LIMITS, on_progress) as content:
            lines = content.lines()
            head = list(islice(lines, LIMITS.looked_at))
            if not head:
                raise RunError(f"{path}: contains no rows")
            labels = labels_of([line for _, line in head])
            delimiter = "," if labels else delimiter_of([joined(line) for _, line in head])
            rows = ((number, cells_of(path, line, delimiter, labels)) for number, line in chain(head, lines))
            above = rows_above_names([cells_of(path, line, delimiter, labels) for _, line in head])
            early: list[list[str]] = []
            for begin in rows:
                # A setting above the names, such as `amplitude,0.5`, also contains a number.
                if is_data(begin[1]) and (len(early) >= above or not has_name(begin[1][:1])):
                    break
                early.append(begin[1])
                if len(early) > LIMITS.head:
                    raise RunError(f"{path}: contains no row of numbers in its first {LIMITS.head} lines{_FORMS}")
            else:
                raise RunError(f"{path}: contains no row of numbers{_FORMS}")
            comments = list(content.comments)
            last_comment = [text.split(delimiter) for text in comments[-1:]]
            if not labels and ends_with_delimiter(begin[1], early or last_comment):
                begin = begin[0], begin[1][:-1]
            width = len(begin[1])
            early = [row if any(row[width:]) else row[:width] for row in early]
            names = labels or names_of_numbers(column_names(early, comments, delimiter, width), begin[1])
            if len(names) > width and not labels and NEXT not in "".join(begin[1]):
                raise RunError(
                    f"{path}: the header has {len(names)} names ({', '.join(map(printable, names))}), but line"
                    f" {begin[0]} has {width} fields: remove the names that belong to no column"
                )
            first = [begin, *islice(rows, LIMITS.looked_at - 1)]
            cells = [cell for _, row in first for cell in row]
            comma = any(map(has_decimal_comma, cells)) or (delimiter != "," and any("," in cell for cell in cells))
            columns = _Columns(path, len(names), comma, early)
            # `rows` may still contain lines of `head`.
            columns.take(chain(first, islice(rows, LIMITS.looked_at)))
            for number, text in content.blocks():
                if not columns.take_block(number, text, delimiter):
                    columns.take(
                        (line_number, cells_of(path, line, delimiter, labels))
                        for line_number, line in content.lines_of(number, text)
                    )
            columns.finish()
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    heading = tuple(tuple(printable(cell.strip()) for cell in row) for row in early)
    recorded_at = date_in(" ".join(chain(comments, *early)))
    named = columns.named(names)
    table = Table(path, named, columns.line_numbers, columns.notes, heading=heading, recorded_at=recorded_at)
    return _in_columns(replace(table, repeated=tuple(columns.repeated)))


def _in_columns(table: Table) -> Table:
    """Transpose a table with one quantity per row; keep other tables unchanged."""
    # drop a column with the names of the rows
    values = np.array([column for column in table.values if not np.isnan(column).all()])
    few = 2 <= len(table.lines) <= LIMITS.rows_as_columns and len(values) > LIMITS.instants * len(table.lines)
    if not (few and all(map(str.isdecimal, table.names)) and np.isfinite(values).all() and runs(values[:, 0])):
        return table
    columns = tuple(Column(str(number), values[:, number - 1].copy()) for number in range(1, values.shape[1] + 1))
    names = [column.name for column in columns]
    note = f"each line of the file contains one quantity: the lines are interpreted as columns {', '.join(names)}"
    return replace(
        table,
        columns=columns,
        lines=np.arange(1, len(values) + 1),
        notes=(*table.notes, note),
    )


@dataclass(slots=True)
class _Growing:
    """Column of numbers that grows row by row."""

    values: "array[float]" = field(default_factory=lambda: array("d"))
    strange: str = ""
    unit: str = ""
    """Unit in the fields; empty if they contain only numbers."""
    midnight: datetime | None = None
    """Midnight before the first row, for times with dates."""
    date: str = ""
    """Last date in the fields; empty without a date."""
    day: int = 0
    """Number of changes of the date."""

    def named(self, name: str, number: int) -> Column:
        """Return the complete column; `number` is the number of the column, from 1."""
        values = np.frombuffer(self.values, dtype=np.float64)
        name = name.strip() or ("" if np.isnan(values).all() else f"column {number} (without a name)")
        midnight = 0.0
        with suppress(ValueError, OverflowError, OSError):  # a date outside the range of this computer's clock
            midnight = self.midnight.timestamp() if self.midnight else 0.0
        return Column(printable(with_unit(name, self.unit)), values, self.strange, midnight)

    def count_day(self, word: str) -> None:
        """Count a change of the date at the start of a field."""
        if date := DATE.match(word.strip()):
            self.day += date[0] != (self.date or date[0])
            self.date = date[0]

    def take(self, word: str, line: int, decimal_comma: bool, day: int) -> None:
        """Append the number in a field.

        A time such as `14:30:00.123` or `30:00.1` is converted to seconds, and a time with a date to seconds since the
        midnight before the first row. For a time without a date, `day` is the number of midnights since then. All
        fields of a column must have the same unit.
        """
        self.values.append(self._number(word.strip().replace(MINUS, "-"), line, decimal_comma, day))

    def _number(self, word: str, line: int, decimal_comma: bool, day: int) -> float:
        if (value := value_of(word, decimal_comma)) is not None:
            return value
        if clock := CLOCK_TIME.fullmatch(word):
            hours, minutes, seconds = clock.groups("0")
            day = self.day if self.date else day
            with suppress(ValueError, TypeError):  # no date, or another zone than in the first row
                stamp = datetime.fromisoformat(word)
                below_1us = float(f"0.000000{seconds[len('00.000000') :]}")  # digits that `stamp` lacks
                self.midnight = self.midnight or datetime.combine(stamp, time(), stamp.tzinfo)
                return (stamp - self.midnight).total_seconds() + below_1us
            return 86400.0 * day + 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds.replace(",", "."))
        if (quantity := QUANTITY.fullmatch(word)) and self.unit in ("", quantity[2]):
            value = value_of(quantity[1], decimal_comma)
        if quantity and value is not None:
            self.unit = quantity[2]
            return value
        if word.lower() not in NOT_A_VALUE and not self.strange:
            self.strange = f"line {line}: {printable(word[:40])!r}"
        return np.nan


class _Columns:
    """Columns of numbers that grow row by row."""

    def __init__(self, path: Path, width: int, decimal_comma: bool, header: Sequence[Sequence[str]] = ()) -> None:
        self.notes: tuple[str, ...] = ()
        self._header = {tuple(row) for row in header if len(row) == width > 1 and has_name(row)}
        self.repeated: list[int] = []
        self._path, self._comma = path, decimal_comma
        self._columns = [_Growing() for _ in range(width)]
        self._lines = array("q")
        self._short: tuple[int, int] | None = None

    def named(self, names: Sequence[str]) -> tuple[Column, ...]:
        """Return the complete columns."""
        numbers = range(1, len(names) + 1)
        return tuple(map(_Growing.named, self._columns, names, numbers))

    @property
    def line_numbers(self) -> Integers:
        return np.frombuffer(self._lines, dtype=np.int64)

    def take(self, rows: Iterable[tuple[int, list[str]]]) -> None:
        """Append rows; only the last row of the table may have too few fields."""
        for number, cells in rows:
            if tuple(cells) in self._header:
                self.repeated.append(number)
                continue
            row = numbers_of(cells)
            if len(row) == len(self._columns) + 1 and not row[-1].strip():
                row.pop()  # the row ends with a delimiter
            if self._short is not None or len(row) > len(self._columns):
                self._refuse(
                    *(self._short or (number, len(row))), points=any(_DECIMAL.fullmatch(cell.strip()) for cell in row)
                )
            if len(row) < len(self._columns):
                self._short = (number, len(row))
                continue
            if len(self._lines) == LIMITS.rows:
                raise RunError(f"{self._path}: has more than {LIMITS.rows:,} rows: split it into recordings")
            self._lines.append(number)
            for column, cell in zip(self._columns, row, strict=True):
                column.count_day(cell)
            day = max(column.day for column in self._columns)  # dates of two zones change in different rows
            for column, cell in zip(self._columns, row, strict=True):
                column.take(cell, number, self._comma, day)

    def take_block(self, number: int, text: str, delimiter: str | None) -> bool:
        """Append a block of number lines; `number` is the number of its first line.

        For other lines, nothing is appended and the result is False.
        """
        if self._short is not None:
            return False
        rows = clean_rows(text, len(self._columns), delimiter, self._comma, LIMITS.line_length)
        if rows is None or len(self._lines) + len(rows) > LIMITS.rows:
            return False
        self._lines.frombytes(np.arange(number, number + len(rows)).tobytes())
        for column, values in zip(self._columns, rows.T, strict=True):
            column.values.frombytes(values.tobytes())
        return True

    def finish(self) -> None:
        """Complete the table.

        A last row that is too short is ignored, and a note is added. Such a row was truncated when the logger was
        switched off.
        """
        if self.repeated:
            self.notes = (f"the header is repeated, first in line {self.repeated[0]}: these lines are ignored",)
        if self._short is None:
            return
        if not self._lines:
            self._refuse(*self._short)
        self.notes = (*self.notes, f"the last line, {self._short[0]}, is incomplete and was ignored")

    def _refuse(self, number: int, length: int, points: bool = False) -> NoReturn:
        width = len(self._columns)
        mend = ": correct or delete this line"
        if width < length <= 2 * width and not points:
            mend = ": if commas are decimal signs, export it with semicolons between the columns"
        elif width < length and not self._lines:
            mend = ": add the missing names to the header"
        columns = "is 1 column" if width == 1 else f"are {width} columns"
        raise RunError(f"{self._path}: line {number} has {length} fields, but there {columns}{mend}")


def own_name(name: str) -> str:
    """Return a column name without the name of its group.

    An example is `X` for `VideoAnalysis: X` in a table of Logger Pro.
    """
    unit = name.partition(": ")[2].strip()
    if not unit and name.endswith("/position"):  # name in ROS: topic, joint, quantity
        return "/".join(name.split("/")[-2:])
    return name if not unit or ONLY_UNIT.fullmatch(unit) else unit


def bare(name: str) -> str:
    """Return a column name without group, type (`Time (uint32)[1]`) or separators, in lower case with plain digits."""
    untyped = re.sub(r"\s*\(u?(int|float)\d+\)(\[1\])?$", "", own_name(name).replace("º", ""))
    return re.sub(r"[\W_]+", "", normalize("NFKC", untyped).lower())
