"""Convert named arrays to the columns of a table."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dpr_lab.errors import RunError, printable
from dpr_lab.storage.tables import table as text_table
from dpr_lab.storage.tables.columns import is_time
from dpr_lab.storage.tables.content import most_unpacked
from dpr_lab.storage.tables.table import Column, Table

BROKEN = (
    ArithmeticError,
    AssertionError,
    AttributeError,
    EOFError,
    LookupError,
    NotImplementedError,
    OSError,
    RecursionError,
    RuntimeError,
    TypeError,
    ValueError,
)
"""Exceptions that libraries raise for invalid bytes."""


def refuse_large(path: Path, values: int) -> None:
    """Refuse a file that contains more numbers than a recording can have.

    Args:
        path: the file
        values: number of values, declared or counted

    Raises:
        RunError: the file contains too many numbers.
    """
    most = text_table.LIMITS.values
    if values > most:
        raise RunError(f"{path}: contains {values:,} numbers, which is more than {most:,}: cut it into recordings")


def refuse_swollen(path: Path, size: int) -> None:
    """Refuse a file of numbers whose unpacked size is too large.

    Args:
        path: the file
        size: unpacked size in bytes, declared or counted

    Raises:
        RunError: the unpacked size exceeds a limit.
    """
    refuse_large(path, size // 8)
    if size > most_unpacked(path, text_table.LIMITS):
        raise RunError(
            f"{path}: unpacks from {path.stat().st_size:,} bytes to {size:,} or more, which is too much for a"
            " recording: save its columns without compression, or as CSV"
        )


@contextmanager
def library_of(path: Path, kind: str, *errors: type[Exception]) -> Iterator[None]:
    """Provide a context in which the library of a format reads a file.

    Args:
        path: the file
        kind: kind of the file
        errors: exceptions that the library raises for invalid bytes, in addition to `BROKEN`

    Raises:
        RunError: the library cannot read the file.
    """
    try:
        yield
    except MemoryError as error:
        message = "needs more memory than is free on this computer: split it into recordings"
        raise RunError(f"{path}: {message}") from error
    except (*BROKEN, *errors) as error:
        raise RunError(
            f"{path}: is damaged or incomplete, or is not a {kind}: copy or save the file again, or export its table as"
            " CSV"
        ) from error


def table_of(path: Path, kind: str, arrays: Mapping[str, NDArray], take: Sequence[str] = ()) -> Table:
    """Convert named arrays to a table.

    A vector becomes one column, and a matrix becomes several columns. Single numbers are ignored.

    The columns of a matrix are named `NAME[1]`, `NAME[2]` and so on. The column of an array `group/name` is named
    `name` if this name is unique in the file.

    Args:
        path: the file
        kind: kind of the file, for the preview
        arrays: arrays of any shape and type; non-numeric arrays are ignored
        take: names of the arrays, and of the groups with their content, that are read

    Raises:
        RunError: there is no array of numbers, no array with a requested name, or too many numbers.
    """
    selected = _wanted(path, arrays, take)
    columns = dict(_columns(selected))
    if not columns:
        contents = ", ".join(f"{printable(name)} {_shape(array)}" for name, array in arrays.items()) or "nothing"
        raise RunError(f"{path}: contains no columns of numbers; it contains: {contents[:500]}")
    refuse_large(path, sum(map(len, columns.values())))
    last = Counter(name.rsplit("/", 1)[-1] for name in columns)
    short = {name: name if last[name.rsplit("/", 1)[-1]] > 1 else name.rsplit("/", 1)[-1] for name in columns}
    times = [len(column) for name, column in columns.items() if is_time(short[name])]
    rows = times[0] if len(times) == 1 else Counter(map(len, columns.values())).most_common(1)[0][0]
    usable = {name: column for name, column in columns.items() if len(column) == rows}
    return Table(
        path,
        tuple(Column(printable(short[name]), np.asarray(column, np.float64)) for name, column in usable.items()),
        np.arange(1, rows + 1),
        kind=kind,
        other_lengths={short[name]: len(column) for name, column in columns.items() if name not in usable},
    )


def _wanted(path: Path, arrays: Mapping[str, NDArray], take: Sequence[str]) -> Mapping[str, NDArray]:
    for name in take:
        if not any(_within(other, name) for other in arrays):
            available = ", ".join(map(printable, arrays))
            raise RunError(f"{path}: contains nothing named {name!r}; it contains: {available[:500] or 'none'}")
    return {name: a for name, a in arrays.items() if not take or any(_within(name, selected) for selected in take)}


def _within(name: str, group: str) -> bool:
    return name == group or name.startswith(f"{group}/")


def _columns(arrays: Mapping[str, NDArray]) -> Iterator[tuple[str, NDArray]]:
    for name, array in arrays.items():
        flat = np.squeeze(array)
        if array.dtype.kind not in "biuf" or flat.ndim not in (1, 2):
            continue
        if flat.ndim == 1:
            yield name, flat
            continue
        columns = flat if flat.shape[0] < flat.shape[1] else flat.T
        yield from ((f"{name}[{k + 1}]", column) for k, column in enumerate(columns))


def _shape(array: NDArray) -> str:
    return "x".join(map(str, array.shape)) if array.dtype.kind in "biuf" else "(no numbers)"
