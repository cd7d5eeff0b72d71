"""Columns of row and frame numbers, which show the rows that a camera or logger lost."""

import re
from collections.abc import Collection

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.errors import RunError
from dpr_lab.storage.tables.table import Table, bare
from dpr_lab.storage.tables.time_stamps import runs

_COUNTER = re.compile(r"(frame|image|sample|row)s?(index|idx|number|num|no|nr|id)?|index|idx|number|no|nr|n|i|k")

_EVEN = 0.1
"""Maximum range of the steps of evenly spaced times, relative to their median."""


def refuse_row_numbers(table: Table, time: str, used: Collection[str]) -> None:
    """Refuse row numbers as the time if an unused column increases in equal fractional steps.

    Raises:
        RunError: the column `time` increases by 1 from row to row, and another column is probably the time.
    """
    numbered = table.column(time)
    if (numbered != np.rint(numbered)).any() or (np.diff(numbered) != 1.0).any():
        return
    for name, column in table.named:
        steps = np.diff(column)
        even = name not in used and len(steps) > 1 and steps.min() > 0 and np.ptp(steps) <= _EVEN * np.median(steps)
        if even and (column != np.rint(column)).any():
            raise RunError(
                f"{table.path}: column {time!r} counts the rows, but {name!r} increases evenly, by {np.median(steps):g}"
                f" from row to row: name the column of the time (--columns t={name!r} or t={time!r})"
            )


def counter(table: Table) -> str:
    """Return the name of a column that counts the rows, such as video frames; empty if there is none."""
    for name, column in table.named:
        steps = np.diff(column)
        if _COUNTER.fullmatch(bare(name)) and len(steps) and (steps == np.rint(steps)).all() and steps.min() > 0:
            return name
    return ""


def numbers(table: Table) -> Array:
    """Return the numbers (n,) of the rows in the recording, starting at 0.

    Numbers are missing if frames were lost. The numbers of a column that counts every k-th frame are divided by k.
    """
    if table.frames is not None:
        return table.frames
    if not (name := _frame_column(table)):
        return np.arange(len(table.lines), dtype=np.float64)
    counted = table.column(name)
    return (counted - counted[0]) / _step(counted)


def counted_frames(table: Table) -> tuple[str, int]:
    """Return the name of the column of frame numbers, and its step; an empty name and 1 without such a column."""
    name = "" if table.frames is not None else _frame_column(table)
    return name, _step(table.column(name)) if name else 1


def frame_step_note(name: str, step: int, rate_hz: float) -> str:
    """Compose the note about a column of frame numbers with steps larger than 1.

    The given rate may then be the rate of all frames, not of the rows. A column without a name may instead contain the
    times of rows at the given rate, in ms or us.
    """
    unit = {1e3: "ms", 1e6: "us"}.get(round(step * rate_hz, 6), "")
    if unit and name.isdecimal():
        option = f"--columns t={name} --time-unit {unit}"
        return f"{name!r} increases in steps of {step}, probably times in {unit}: replace --rate-hz by {option}"
    return (
        f"{name!r} increases in steps of {step}; {rate_hz:g} Hz is taken as the rate of the rows. If it is the frame"
        f" rate of the camera, give --rate-hz {rate_hz / step:.6g}"
    )


def _frame_column(table: Table) -> str:
    """Return the name of the column that counts rows or frames; empty if there is none.

    In a table without names, this is the first column if its steps are equal.

    Some steps are larger if frames were lost. Times in ms have unequal steps, unless a step is a whole number of ms.
    """
    first, column = table.names[0], table.values[0]
    whole = len(table.names) > 1 and first.isdecimal() and runs(column) and (column == np.rint(column)).all()
    return counter(table) or (first if whole and np.median(np.diff(column)) == _step(column) else "")


def _step(counted: Array) -> int:
    return int(np.gcd.reduce(np.diff(counted).astype(np.int64)))
