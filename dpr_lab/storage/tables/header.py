"""Find the names of the columns of a text table, and the delimiter of its lines."""

import re
from collections.abc import Sequence

from dpr_lab.storage.tables.cells import UNIT_CELL, are_names, numbers_of

# The order matters: in a table with another delimiter, a comma is the decimal sign.
DELIMITERS = ("|", ";", "\t", ",")


def column_names(early: list[list[str]], comments: Sequence[str], delimiter: str | None, width: int) -> list[str]:
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
    return [*map(with_unit, names, units)] if units else names


def with_unit(name: str, unit: str) -> str:
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


def names_of_numbers(names: Sequence[str], cells: Sequence[str]) -> list[str]:
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


def ends_with_delimiter(row: list[str], early: list[list[str]]) -> bool:
    """Return whether a row of numbers, but not its header, ends with a delimiter."""
    names = len(row) - 1
    named = any(len(other) == names for other in early)
    wider = any(len(other) > names and other[names].strip() for other in early)
    return named and not wider and not row[-1].strip()


def delimiter_of(lines: list[str]) -> str | None:
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
