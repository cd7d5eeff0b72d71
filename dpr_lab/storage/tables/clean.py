"""Read blocks of a table that contain only numbers, without a Python call for each line."""

import io

import numpy as np
from numpy.typing import NDArray

from dpr_lab.arrays import Array

NOT_A_VALUE = frozenset(("", "nan", "na", "n/a", "null", "none", "-"))
"""Contents of a field that denote a missing value, in lower case."""

_NEWLINE, _BLANK = ord("\n"), ord(" ")


def clean_rows(text: str, width: int, delimiter: str | None, decimal_comma: bool, line_length: int) -> Array | None:
    """Read a block in which every line is a row of numbers; return None for other blocks.

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
