"""Split the lines of a table into fields, read the numbers in them, and find the names of the columns.

Blocks that contain only numbers are read without a Python call for each line.
"""

import csv
import io
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dpr_lab.arrays import Array
from dpr_lab.errors import RunError, printable

NOT_A_VALUE = frozenset(("", "nan", "na", "n/a", "null", "none", "-"))
"""Contents of a field that denote a missing value, in lower case."""

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:e[-+]?\d+)?"
_VECTOR = re.compile(rf"([(\[])\s*({_NUMBER}(?:(?:\s*[,;]\s*|\s+){_NUMBER})+)\s*[)\]]", re.I)
"""Pattern of several numbers in one field, such as the point "(1392, 685)" or the array [0.1 0.2]."""
MINUS = "\N{MINUS SIGN}"  # some programs write this sign in place of the hyphen
NEXT = "\x02"
"""Separator of the numbers of a vector within its field. Files with control characters are refused."""
_CLOCK = r"\d{1,2}:\d{2}:\d{2}\.\d+"
_STAMP = re.compile(rf"^({_CLOCK}) -> ?")
"""Pattern of the time that the serial monitor of Arduino writes before a line."""
_TIME_BEFORE = re.compile(rf"^\[?({_CLOCK}|{_NUMBER})(?:\s*->\s*|[\],;\s]+)(?=[^\W\d]\w*\s*[:=])", re.I)
"""Pattern of a time without a name before the named numbers of a line, such as `1.234 enc1=-5` or `[1.234] enc1=-5`."""
CLOCK_TIME = re.compile(r"(?:.*[ T])?(?:(\d{1,2}):)?(\d{1,2}):(\d{2}(?:[.,]\d+)?)(?:Z|[+-]\d{2}:?\d{2})?")
DATE = re.compile(r"(?:\d{4}([-./])\d{1,2}\1\d{1,2}|\d{1,2}([-./])\d{1,2}\2\d{2}(?:\d{2})?)(?=[ T]|$)")
"""Pattern of a date at the start of a field."""
_LABEL = rf"([^\W\d]\w*)\s*[:=]\s*({_CLOCK}|{_NUMBER})"
_LABELLED = re.compile(rf"\s*{_LABEL}(?:[,;\s]+{_LABEL})*[,;\s]*", re.I)
"""Pattern of a line with a name before each number, such as `angle:57.3,speed:0.1` for the plotter of Arduino."""
UNIT_WORDS = r"rad|radians?|deg|degrees?|°|counts?|ticks?|m?s|us|sec|seconds|px|pixels?|[mc]?m"
ONLY_UNIT = re.compile(rf"\W*({UNIT_WORDS})\W*|\s*(\[[^]]*\]|\([^)]*\))\s*", re.I)
UNIT_CELL = re.compile(rf"({ONLY_UNIT.pattern})?", re.I).fullmatch
_TIME_OR_ANGLE = re.compile(r"\W*(t|time|(theta|phi|angle|joint|q)[\W_]*[0-2]?)(?![a-z0-9])", re.I)
_RATE = re.compile(r"(rad|deg|degrees?|°|m)/s|omega|veloc|speed|^(?!.*(angle|pitch|roll|tilt)).*(gyro|acc(?!ura))")
"""Pattern of names of rates and accelerations, in lower case; the angle of a gyroscope is not a rate."""
_UNITS = "%|lu?x|[kmcd]?m|g|m?N|[hk]?Pa|°?[CFK]|m?A|m?W|[mµ]?T|dB|k?Hz"
_OTHER_UNIT = re.compile(rf"(?!\W*[xyXY]\b).*[(\[]\s*({_UNITS})\s*[)\]]\s*$")
"""Pattern of a name with the unit of another quantity, such as `Light (%)`. Voltages and coordinates are excluded,
because angles are computed from them."""
QUANTITY = re.compile(rf"(.*[\d.,])\s*({UNIT_WORDS})", re.I)
"""Pattern of a field with a number and its unit, such as `12.3 deg`."""
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(?:(?:,\d{3})+(?:\.\d*)?|(?:\.\d{3})+,\d*)")
"""Pattern of a number with separators between groups of three digits, such as `1,234.5` or `1.234,5`; not `0,956`."""

# The order matters: in a table with another delimiter, a comma is the decimal sign.
DELIMITERS = ("|", ";", "\t", ",")
_NEWLINE, _BLANK = ord("\n"), ord(" ")


def clean_rows(text: str, width: int, delimiter: str | None, decimal_comma: bool, line_length: int) -> Array | None:
    """Read a block of number rows; return None for other blocks.

    Each number equals `float` of its field exactly. A missing value is NaN.

    Args:
        text: complete lines
        width: number of fields in a row
        delimiter: separator of the fields; None for blanks
        decimal_comma: whether a comma is the decimal sign
        line_length: maximum number of characters of a line

    Returns:
        Numbers (n, width) of the n lines.
    """
    if not text.isascii() or '"' in text or (width < 2 and delimiter is not None):
        return None
    text = text if text.endswith("\n") else f"{text}\n"
    raw = np.frombuffer(text.encode(), dtype=np.uint8)
    ends = np.flatnonzero(raw == _NEWLINE)
    if np.diff(ends, prepend=-1).max() > line_length or not _all_wide(raw, ends, width, delimiter):
        return None
    text = text.replace(",", ".") if decimal_comma else text
    try:
        return np.loadtxt(io.StringIO(text), delimiter=delimiter, comments=None, ndmin=2)
    except ValueError:  # a missing value, a word, or a number in a notation that only Python reads
        fields = text.split() if delimiter is None else text.replace("\n", delimiter).split(delimiter)[:-1]
        values = _numbers(fields)
        return None if values is None else values.reshape(-1, width)


def _all_wide(raw: NDArray[np.uint8], ends: NDArray[np.intp], width: int, delimiter: str | None) -> bool:
    """Check whether every line has `width` fields.

    A comment may have the same number of fields. Such a comment is rejected later, because its fields are not numbers.
    """
    if delimiter is None:
        begins = raw > _BLANK
        begins[1:] &= raw[:-1] <= _BLANK
        return bool((np.diff(np.cumsum(begins)[ends], prepend=0) == width).all())
    between = np.flatnonzero(raw == ord(delimiter))
    if len(between) != len(ends) * (width - 1):
        return False
    between = between.reshape(len(ends), -1)
    return bool((between[:, -1] < ends).all() and (between[1:, 0] > ends[:-1]).all())


def _numbers(fields: list[str]) -> Array | None:
    """Convert text fields to numbers; missing values become NaN.

    The result is None if a field is neither a number nor a missing value.
    """
    try:
        known = ("nan" if field.strip().lower() in NOT_A_VALUE else field for field in fields)
        return np.fromiter(map(float, known), dtype=np.float64, count=len(fields))
    except ValueError:
        return None


def are_names(comment: Sequence[str], below: Sequence[str]) -> bool:
    """Check whether a comment contains the names of columns, and the comment below their units.

    Without units, the comment must name at least two times or angles.
    """
    named = any(map(str.strip, below)) or times_and_angles(comment) >= 2
    return named and all(map(UNIT_CELL, below))


def times_and_angles(names: Sequence[str]) -> int:
    """Count the names of times and angles."""
    return sum(map(bool, map(_TIME_OR_ANGLE.match, names)))


def names_no_angle(name: str) -> bool:
    """Check whether a column name states a rate, an acceleration, or the unit of another quantity."""
    return names_rate(name) or bool(_OTHER_UNIT.match(name))


def names_rate(name: str) -> bool:
    """Check whether the name of a column states a rate or an acceleration."""
    return bool(_RATE.search(name.lower()))


def listed(names: Sequence[str]) -> str:
    """Join column names with commas; a name that contains a comma is quoted."""
    return ", ".join(repr(name) if "," in name else name for name in names)


def labels_of(lines: list[str]) -> list[str]:
    """Return the names of the columns if most lines have a name before each number.

    The names are in the order of the first such line.
    """
    labelled = [line for line in map(_with_time, lines) if _LABELLED.fullmatch(line)]
    return [name for name, _ in re.findall(_LABEL, labelled[0], re.I)] if 2 * len(labelled) > len(lines) else []


def _with_time(line: str) -> str:
    return _TIME_BEFORE.sub(r"time=\1 ", line)


def numbers_of(cells: Sequence[str]) -> list[str]:
    """Split the vectors in a row into separate fields for each number."""
    return [part for cell in cells for part in (cell.strip()[1:].split(NEXT) if NEXT in cell else (cell,))]


def joined(line: str) -> str:
    """Join the numbers of each vector in a line to one field.

    `NEXT` replaces the delimiters between these numbers.
    """
    if "(" not in line and "[" not in line:
        return line
    return _VECTOR.sub(lambda match: match[1] + NEXT.join(re.split(r"[\s,;]+", match[2])), line)


def cells_of(path: Path, line: str, delimiter: str | None, labels: Sequence[str]) -> list[str]:
    """Split a line into fields.

    If each number is preceded by a name, only the numbers are returned.
    """
    if labels:
        line = _with_time(line)
        named = dict(re.findall(_LABEL, line, re.I)) if _LABELLED.fullmatch(line) else {}
        return [named[name] for name in labels if name in named]
    line = _STAMP.sub(rf"\1{delimiter or ' '}", joined(line), count=1)
    if delimiter is None:
        return line.split()
    if delimiter == "|" and line.startswith("|"):  # a table of Markdown
        line = line[1:].removesuffix("|")
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    except csv.Error as error:
        raise RunError(f"{path}: is not a table: this line has no fields: {printable(line[:60])!r}") from error


def is_data(row: Sequence[str]) -> bool:
    """Check whether a row contains numbers rather than names or units.

    An additional column of words is accepted.
    """
    row = [cell.strip() for cell in numbers_of(row)]
    numbers = sum(map(_is_number, row))
    empty = sum(cell.lower() in NOT_A_VALUE for cell in row)
    quantities = sum(map(_is_quantity, row))
    clocks = sum(map(_is_clock, row))
    # A header may contain names such as `10 cm`.
    complete = numbers + quantities > 0 and numbers + quantities + empty + clocks == len(row)
    return complete or (numbers > 0 and 2 * (numbers + empty) >= len(row))


def has_name(row: Sequence[str]) -> bool:
    """Check whether a row contains a field that is neither a value nor a missing value."""
    cells = [cell.strip() for cell in numbers_of(row)]
    return not all(c.lower() in NOT_A_VALUE or _is_number(c) or _is_quantity(c) or _is_clock(c) for c in cells)


def rows_above_names(rows: Sequence[Sequence[str]]) -> int:
    """Count the rows above the names of the columns.

    The names are in the first row with the most frequent number of fields. The result is 0 if that row contains
    numbers.
    """
    usual = Counter(map(len, rows)).most_common(1)[0][0]
    full = (n for n, row in enumerate(rows) if len(row) == usual and any(map(str.strip, row[1:] or row)))
    first = next(full, 0)
    return 0 if is_data(rows[first]) else first


def has_decimal_comma(cell: str) -> bool:
    """Check whether a field contains a number with a decimal comma."""
    cell = cell.strip().replace(MINUS, "-")
    return "," in cell and _is_number(cell) and not _THOUSANDS.fullmatch(cell)


def _is_number(cell: str) -> bool:
    value = value_of(cell.replace(MINUS, "-"), decimal_comma=True)
    return value is not None and bool(np.isfinite(value))


def _is_quantity(cell: str) -> bool:
    match = QUANTITY.fullmatch(cell)
    return match is not None and _is_number(match[1])


def _is_clock(cell: str) -> bool:
    return bool(CLOCK_TIME.fullmatch(cell) or DATE.fullmatch(cell))


def value_of(word: str, decimal_comma: bool) -> float | None:
    """Parse a number with or without thousands separators; return None for other words."""
    try:
        return float(word.replace(",", ".") if decimal_comma else word)
    except ValueError:
        if not _THOUSANDS.fullmatch(word):
            return None
        thousands = "," if word.find(",") < word.find(".") or "." not in word else "."
        return float(word.replace(thousands, "").replace(",", "."))


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
    names = max(wide or early[-1:], key=lambda row: (sum(bool(cell.strip()) for cell in row), times_and_angles(row)))
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

    Each header has one name per column. Headers in which only some names begin with a bracket are excluded, because a
    name such as `(s),Voltage` begins with the unit of the previous name.
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
    """Return whether the rows of numbers, but not their header, end with a delimiter."""
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
