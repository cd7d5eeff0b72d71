"""Text table of any logger; delimiter, header, comments and decimal sign are detected."""

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

from dpr_lab.arrays import Array, Integers
from dpr_lab.errors import RunError, printable
from dpr_lab.progress import OnImport, unwatched
from dpr_lab.run import FilmNoise
from dpr_lab.storage.tables.cells import (
    CLOCK_TIME,
    MINUS,
    NEXT,
    NOT_A_VALUE,
    ONLY_UNIT,
    QUANTITY,
    UNIT_CELL,
    are_names,
    cells_of,
    clean_rows,
    is_data,
    joined,
    labels_of,
    numbers_of,
    value_of,
)
from dpr_lab.storage.tables.content import Content, TableLimits
from dpr_lab.storage.tables.options import date_in
from dpr_lab.storage.tables.time_stamps import runs

# The order matters: in a table with another delimiter, a comma is the decimal sign.
DELIMITERS = ("|", ";", "\t", ",")
LIMITS = TableLimits()
_DECIMAL = re.compile(r"[+-]?\d+\.\d+(e[+-]?\d+)?", re.I)
_FORMS = (
    ": a table is read from rows of numbers with commas, semicolons, tabs, bars (|) or blanks between them, or from"
    " rows such as `t=0.01 theta1=1.57 theta2=0.2`"
)


@dataclass(frozen=True, slots=True)
class Table:
    """Columns of a table and their names."""

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
    """Number of values of each column that is ignored because its length differs from the others."""
    settled: bool = False
    """Whether the values are already absolute angles in rad, 0 = upright, so that no option changes them."""
    film_noise: FilmNoise | None = None
    """Noise of the angles, if they were computed from points in a video."""
    frames: Array | None = None
    """(n,) original number of each row, from 0, if frames of a video were removed; None for consecutive rows."""
    midnights: Mapping[str, float] = field(default_factory=dict)
    """Zero of each column of times with dates, s since 1970; times without a zone are local times."""
    recorded_at: str = ""
    """Date, or date and time in UTC, in the lines above the numbers; empty if they contain none."""

    @property
    def columns(self) -> Iterator[tuple[str, Array]]:
        """Name and values (n,) of each column."""
        return zip(self.names, self.values, strict=True)

    def column(self, name: str) -> Array:
        """Return the values (n,) of one column; missing values are NaN.

        Raises:
            RunError: a field is not a number; the message names line and column.
        """
        place = self.names.index(name)
        if self.strange[place]:
            raise RunError(
                f"{self.path}: {self.strange[place]} in column {name!r} is not a number: correct the field, or leave"
                " it empty if its value is missing; if another table begins there, split the file"
            )
        return self.values[place].copy()


def read_table(path: Path, on_progress: OnImport = unwatched) -> Table:
    """Read a table with at most one header line; text compressed by gzip is decompressed.

    Args:
        path: the file
        on_progress: function that is called after each block

    Raises:
        RunError: the file cannot be read, is empty, is not text, contains no numbers, or has a row of another length.
    """
    try:
        with Content(path, LIMITS, on_progress) as content:
            lines = content.lines()
            head = list(islice(lines, LIMITS.looked_at))
            if not head:
                raise RunError(f"{path}: contains no rows")
            labels = labels_of([line for _, line in head])
            delimiter = "," if labels else _delimiter([joined(line) for _, line in head])
            rows = ((number, cells_of(path, line, delimiter, labels)) for number, line in chain(head, lines))
            early: list[list[str]] = []
            for begin in rows:
                if is_data(begin[1]):
                    break
                early.append(begin[1])
                if len(early) > LIMITS.head:
                    raise RunError(f"{path}: contains no row of numbers in its first {LIMITS.head} lines{_FORMS}")
            else:
                raise RunError(f"{path}: contains no row of numbers{_FORMS}")
            comments = list(content.comments)
            last_comment = [text.split(delimiter) for text in comments[-1:]]
            if not labels and _ends_with_delimiter(begin[1], early or last_comment):
                begin = begin[0], begin[1][:-1]
            width = len(begin[1])
            early = [row if any(row[width:]) else row[:width] for row in early]
            names = labels or _of_numbers(_names(early, comments, delimiter, width), begin[1])
            if len(names) > width and not labels and NEXT not in "".join(begin[1]):
                raise RunError(
                    f"{path}: the header has {len(names)} names ({', '.join(map(printable, names))}), but line"
                    f" {begin[0]} has {width} fields: remove the names that belong to no column"
                )
            first = [begin, *islice(rows, LIMITS.looked_at - 1)]
            comma = delimiter != "," and any("," in cell for _, cells in first for cell in cells)
            columns = _Columns(path, len(names), comma)
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
    empty = [bool(np.isnan(column).all()) for column in columns.arrays]
    names = [
        name.strip() or ("" if empty[number - 1] else f"column {number} (without a name)")
        for number, name in enumerate(names, 1)
    ]
    shown = tuple(printable(_with_unit(name, unit)) for name, unit in zip(names, columns.units, strict=True))
    heading = tuple(tuple(printable(cell.strip()) for cell in row) for row in early)
    strange = tuple(columns.strange)
    midnights = {}
    for name, start in zip(shown, columns.midnights, strict=True):
        with suppress(ValueError, OverflowError, OSError):  # a date outside the range of this computer's clock
            midnights |= {name: start.timestamp()} if start else {}
    table = Table(path, shown, columns.arrays, strange, columns.line_numbers, columns.notes, heading=heading)
    title = " ".join(chain(comments, *early))
    return _in_columns(replace(table, midnights=midnights, recorded_at=date_in(title)))


def _in_columns(table: Table) -> Table:
    """Transpose a table with one quantity per row; keep other tables unchanged."""
    # drop a column with the names of the rows
    values = np.array([column for column in table.values if not np.isnan(column).all()])
    few = 2 <= len(table.lines) <= LIMITS.rows_as_columns and len(values) > LIMITS.instants * len(table.lines)
    if not (few and all(map(str.isdecimal, table.names)) and np.isfinite(values).all() and runs(values[:, 0])):
        return table
    names = tuple(str(number + 1) for number in range(values.shape[1]))
    note = f"each line of the file contains one quantity: the lines are interpreted as columns {', '.join(names)}"
    return replace(
        table,
        names=names,
        values=tuple(np.ascontiguousarray(values.T)),
        strange=("",) * len(names),
        lines=np.arange(1, len(values) + 1),
        notes=(*table.notes, note),
    )


class _Columns:
    """Columns of numbers that grow row by row."""

    def __init__(self, path: Path, width: int, decimal_comma: bool) -> None:
        self.strange = [""] * width
        self.units = [""] * width
        """Unit of each column, from its fields; empty if they contain only numbers."""
        self.midnights: list[datetime | None] = [None] * width
        """Midnight before the first row for each column of times with dates."""
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
        for number, cells in rows:
            row = numbers_of(cells)
            if len(row) == len(self._values) + 1 and not row[-1].strip():
                row.pop()  # the row ends with a delimiter
            if self._short is not None or len(row) > len(self._values):
                self._refuse(
                    *(self._short or (number, len(row))), points=any(_DECIMAL.fullmatch(cell.strip()) for cell in row)
                )
            if len(row) < len(self._values):
                self._short = (number, len(row))
                continue
            if len(self._lines) == LIMITS.rows:
                raise RunError(f"{self._path}: has more than {LIMITS.rows:,} rows: split it into recordings")
            self._lines.append(number)
            for place, cell in enumerate(row):
                self._values[place].append(self._number(cell.strip(), place, number))

    def take_block(self, number: int, text: str, delimiter: str | None) -> bool:
        """Append a block of number lines; `number` is the number of its first line.

        For other lines, nothing is appended and the result is False.
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
        """Complete the table.

        A last row that is too short is ignored, and a note is added. Such a row was truncated when the logger was
        switched off.
        """
        if self._short is None:
            return
        if not self._lines:
            self._refuse(*self._short)
        self.notes = (f"the last line, {self._short[0]}, is incomplete and was ignored",)

    def _refuse(self, number: int, length: int, points: bool = False) -> NoReturn:
        width = len(self._values)
        mend = ": correct or delete this line"
        if width < length <= 2 * width and not points:
            mend = ": if commas are decimal signs, export it with semicolons between the columns"
        elif width < length and not self._lines:
            mend = ": add the missing names to the header"
        columns = "is 1 column" if width == 1 else f"are {width} columns"
        raise RunError(f"{self._path}: line {number} has {length} fields, but there {columns}{mend}")

    def _number(self, word: str, place: int, line: int) -> float:
        """Convert a field to a number.

        A time such as `14:30:00.123` or `30:00.1` is converted to seconds. A time with an ISO date is converted to
        seconds since the midnight before the first row. All fields of a column must have the same unit.
        """
        word = word.replace(MINUS, "-")
        if (value := value_of(word, self._comma)) is not None:
            return value
        if clock := CLOCK_TIME.fullmatch(word):
            hours, minutes, seconds = clock.groups("0")
            with suppress(ValueError, TypeError):  # no date, or another zone than in the first row
                stamp = datetime.fromisoformat(word)
                below_1us = float(f"0.000000{seconds[len('00.000000') :]}")  # digits that `stamp` lacks
                self.midnights[place] = midnight = self.midnights[place] or datetime.combine(
                    stamp, time(), stamp.tzinfo
                )
                return (stamp - midnight).total_seconds() + below_1us
            return 3600.0 * int(hours) + 60.0 * int(minutes) + float(seconds.replace(",", "."))
        if (quantity := QUANTITY.fullmatch(word)) and self.units[place] in ("", quantity[2]):
            value = value_of(quantity[1], self._comma)
        if quantity and value is not None:
            self.units[place] = quantity[2]
            return value
        if word.lower() not in NOT_A_VALUE and not self.strange[place]:
            self.strange[place] = f"line {line}: {printable(word[:40])!r}"
        return np.nan


def _names(early: list[list[str]], comments: Sequence[str], delimiter: str | None, width: int) -> list[str]:
    """Find the names of the columns.

    The names are in the rows above the numbers or in a comment; otherwise, the names are column numbers.
    """
    if not early:
        early = [comment.split(delimiter) for comment in comments[-2:]]
        if not early or len(early[0]) != width or not are_names(early[0], early[-1]):
            return _commented_header(comments, delimiter, width)
    # A row with a single field is a title, or a header with another delimiter.
    wide = [row for row in early if len(row) == width and any(map(str.strip, row[1:]))]
    wide = wide or _otherwise_separated(early, delimiter, width)
    # Names of groups may precede the names of columns, and units may follow them.
    names = max(wide or early[-1:], key=lambda row: sum(bool(cell.strip()) for cell in row))
    below = wide[wide.index(names) + 1 :] if names in wide else []
    units = next((row for row in below if any(row) and all(map(UNIT_CELL, row))), ())
    return [*map(_with_unit, names, units)] if units else names


def _with_unit(name: str, unit: str) -> str:
    """Add the unit from the row below to the name of a column.

    The name is unchanged if it contains the unit or if there is no unit.
    """
    unit = unit.strip(" ()[]")
    return name if not unit or unit.lower() in re.split(r"[\W_]+", name.lower()) else f"{name} ({unit})"


def _otherwise_separated(early: list[list[str]], delimiter: str | None, width: int) -> list[list[str]]:
    """List possible headers whose delimiter differs from that of the numbers.

    Each header has one name per column. No column is named `(s),Voltage`: `(s)` is the unit of the name before it.
    """
    lines = [(delimiter or " ").join(row) for row in early]
    lines += [re.sub(r"\s+(?=[(\[])", "", line) for line in lines]  # a blank before a unit separates no names
    split = [re.split(r"\s{2,}", line.strip()) for line in lines]
    split += [line.split(other) for line in lines for other in (*DELIMITERS, None)]
    return [row for row in split if len(row) == width and len({cell.strip()[:1] in ("(", "[") for cell in row}) == 1]


def _of_numbers(names: Sequence[str], cells: Sequence[str]) -> list[str]:
    """Name each number of a row whose fields may contain several numbers.

    Such a field is a point, or contains the elements of an array.
    """
    if len(names) != len(cells):  # the first row will be refused
        return list(names)
    named: list[str] = []
    for name, cell in zip(names, cells, strict=True):
        size = len(numbers_of([cell]))
        point = cell[:1] == "(" and size <= len("xyz")
        ends = [f"_{axis}" for axis in "xyz"[:size]] if point else [f"[{number}]" for number in range(size)]
        stem, space, unit = name.strip().partition(" (")
        named += [f"{stem}{end}{space}{unit}" for end in ends] if size > 1 else [name]
    return named


def _ends_with_delimiter(row: list[str], early: list[list[str]]) -> bool:
    """Return whether a row of numbers, but not its header, ends with a delimiter."""
    names = len(row) - 1
    named = any(len(other) == names for other in early)
    wider = any(len(other) > names and other[names].strip() for other in early)
    return named and not wider and not row[-1].strip()


def _delimiter(lines: list[str]) -> str | None:
    """Return the first delimiter that most lines contain, or None for blanks."""
    return next((d for d in DELIMITERS if sum(d in line for line in lines) > len(lines) / 2), None)


def _commented_header(comments: Sequence[str], delimiter: str | None, width: int) -> list[str]:
    """Return the header from the last comment above the numbers.

    Column numbers are returned if the comment does not have one name per column.
    """
    header = comments[-1] if comments else ""
    names = header.split(delimiter)
    if header and len(names) != width:  # the header may have another delimiter
        names = next(iter(_otherwise_separated([[header]], delimiter, width)), [])
    return names if header and names else [str(n + 1) for n in range(width)]


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
