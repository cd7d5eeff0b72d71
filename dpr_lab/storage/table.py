"""Read the text table of any logger: delimiter, header, comments and decimal sign are found, not asked for."""

import csv
import re
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import RunError

DELIMITERS = (";", "\t", ",")  # in this order: next to a semicolon or a tab a comma is the decimal sign
COMMENTS = ("#", "%", "//")
NOT_A_VALUE = ("", "nan", "na", "n/a", "null", "none", "-")

_CONTROL = bytes(set(range(32)) - set(b"\t\n\f\r"))
_SAMPLE_ROWS = 50


@dataclass(frozen=True, slots=True)
class Table:
    """A table's text, cut into fields."""

    path: Path
    names: tuple[str, ...]
    """Column names; `1`, `2`, ... when the table has no header."""
    rows: list[list[str]]
    lines: list[int]
    """Line number in the file of each row, counted from 1."""
    decimal_comma: bool
    notes: tuple[str, ...] = ()

    def column(self, name: str) -> NDArray[np.float64]:
        """(n,) values of one column; NaN where the logger wrote none.

        Raises:
            RunError: a field that is not a number; names line and column.
        """
        at = self.names.index(name)
        return np.array([self._number(row[at], name, line) for row, line in zip(self.rows, self.lines, strict=True)])

    def _number(self, text: str, name: str, line: int) -> float:
        word = text.strip()
        try:
            return float(word.replace(",", ".") if self.decimal_comma else word)
        except ValueError:
            if word.lower() in NOT_A_VALUE:
                return np.nan
            raise RunError(f"{self.path}: line {line}: {word[:40]!r} in column {name!r} is not a number") from None


def read_table(path: Path) -> Table:
    """Read a table with one header line or none.

    Raises:
        RunError: cannot be read, empty, not text, without numbers, or a row of another length.
    """
    numbered = _significant(_text(path))
    content = [(number, line) for number, line in numbered if not line.startswith(COMMENTS)]
    if not content:
        raise RunError(f"{path}: holds no rows")
    delimiter = _delimiter([line for _, line in content[:_SAMPLE_ROWS]])
    cells = [_cells(path, line, delimiter) for _, line in content]
    first = next((i for i, row in enumerate(cells) if _is_data(row)), None)
    if first is None:
        raise RunError(f"{path}: holds no row of numbers, so it is not a table of angles")
    rows, lines = cells[first:], [number for number, _ in content[first:]]
    if first:
        names = next((row for row in cells[:first] if len(row) == len(rows[0])), cells[first - 1])
    else:
        names = _commented_header(numbered, lines[0], delimiter, len(rows[0]))
    notes = _drop_cut_row(rows, lines, len(names))
    _check_lengths(path, rows, lines, len(names))
    comma = delimiter != "," and any("," in cell for row in islice(rows, _SAMPLE_ROWS) for cell in row)
    return Table(path, tuple(name.strip() for name in names), rows, lines, comma, notes)


def _text(path: Path) -> str:
    try:
        content = path.read_bytes()
    except OSError as error:
        raise RunError(f"{path}: cannot be read: {error.strerror}") from error
    if not content.strip():
        raise RunError(f"{path}: is empty")
    if len(content.translate(None, _CONTROL)) != len(content):
        raise RunError(
            f"{path}: is not a text table but a binary file: export it as CSV (UTF-8) from its program first"
        )
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")  # a degree sign in a header is all that this can get wrong


def _significant(text: str) -> list[tuple[int, str]]:
    lines = re.split(r"\r\n|\r|\n", text)
    return [(number, line.strip(" \f")) for number, line in enumerate(lines, start=1) if line.strip()]


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


def _commented_header(numbered: list[tuple[int, str]], before: int, delimiter: str | None, width: int) -> list[str]:
    """The header in the last comment above the numbers, where it has as many names; else column numbers."""
    above = [line for number, line in numbered if number < before]
    names = above[-1].lstrip("#%/ ").split(delimiter) if above else []
    return names if len(names) == width else [str(n + 1) for n in range(width)]


def _drop_cut_row(rows: list[list[str]], lines: list[int], width: int) -> tuple[str, ...]:
    """A logger that was switched off leaves half a row at the end: leave it out, and say so."""
    if len(rows) < 2 or len(rows[-1]) >= width:
        return ()
    rows.pop()
    return (f"line {lines.pop()}, the last one, is cut off: left out",)


def _check_lengths(path: Path, rows: list[list[str]], lines: list[int], width: int) -> None:
    for row, line in zip(rows, lines, strict=True):
        if len(row) != width:
            raise RunError(f"{path}: line {line} has {len(row)} fields where there are {width} columns")
