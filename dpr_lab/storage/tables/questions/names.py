"""Resolve columns that are given by number, and refuse tables with ambiguous column names."""

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from dpr_lab.errors import RunError
from dpr_lab.storage.tables.options import AXES, ImportOptions
from dpr_lab.storage.tables.table import Table, bare

_SCALED_UNITS = tuple(
    (re.compile(pattern, re.I), meaning, unit, factor)
    for pattern, meaning, unit, factor in (
        (r"(m|milli)rad(ians?)?(?![a-z])|0[.,]001 ?rad", "in mrad", "", 1e-3),
        (r"([uµμ]|micro)rad(ians?)?(?![a-z])", "in microradians", "", 1e-6),
        (r"(?<![a-z])(m|milli)deg(rees?)?(?![a-z])|0[.,]001 ?(deg|°)", "in mdeg", "--unit deg ", 1e-3),
        (r"(?<![a-z])(c|centi)deg(rees?)?(?![a-z])|0[.,]01 ?(deg|°)", "in hundredths of a degree", "--unit deg ", 1e-2),
        (r"(?<![a-z])(d|deci)deg(rees?)?(?![a-z])|0[.,]1 ?(deg|°)", "in tenths of a degree", "--unit deg ", 0.1),
        (r"(?<![a-z])arc_?min(utes?)?(?![a-z])", "in arc minutes", "--unit deg ", 1 / 60),
        (r"(?<![a-z])arc_?sec(onds?)?(?![a-z])", "in arc seconds", "--unit deg ", 1 / 3600),
        (r"(?<![a-z])gons?(?![a-z])", "in gon", "--unit deg ", 0.9),
        (r"(?<![a-z])(revs?|revolutions?|turns?)(?![a-z0-9])", "in revolutions", "--unit deg ", 360.0),
        (r"_e-?3$|_x1000$", "multiplied by 1000", "", 1e-3),
    )
)
"""Patterns of names that state a unit with a factor: the pattern, its meaning, the option `--unit` and the scale."""

_COUNTS = re.compile(r"(?<![a-z])(counts?|ticks?)(?![a-z])", re.I)
"""Pattern of names in counts, which may also state the counts per revolution."""
_GRAD = re.compile(r"(?!.*winkel).*grad(?![a-z])", re.I)
"""Pattern of the unit `grad`: gon, or degrees in German. Next to the German word for angle, it denotes degrees."""
_SENSOR = re.compile("(sensor|joint|channel|signal|variable)s?(id|name|no|number)?")


def numbered(table: Table, stated: Mapping[str, str]) -> tuple[Table, dict[str, str]]:
    """Replace stated column numbers, counted from 1, by the names of these columns.

    A number that is the name of a column is not replaced. If several columns have the name of a numbered column, the
    numbered column is renamed.
    """
    columns, named = [*table.columns], dict(stated)
    every = [*table.names, *table.other_lengths]
    for quantity, text in stated.items():
        if text in every or not (text.isdecimal() and 1 <= int(text) <= len(every)):
            continue
        place = int(text) - 1
        named[quantity] = name = every[place]
        if every.count(name) > 1 and place < len(columns):
            named[quantity] = unique = f"{name} (column {text})"
            columns[place] = replace(columns[place], name=unique)
    return replace(table, columns=tuple(columns)), named


def without_scaled_unit(name: str) -> str:
    """Remove a unit with a factor, such as mrad, from a column name, unless the name contains no other letters."""
    for pattern, *_ in _SCALED_UNITS:
        if re.search(r"[^\W\d_]", remainder := pattern.sub("", name)):
            name = remainder
    return name


def refuse_scaled_units(table: Table, named: Mapping[str, str], options: ImportOptions) -> None:
    """Refuse columns of angles whose names state a unit with a factor, such as mrad, unless a scale is given.

    Raises:
        RunError: the message contains the options that convert the column.
    """
    unscaled = {axis: named[axis] for axis in AXES if axis in named and axis not in options.scale}
    unscaled = {axis: name for axis, name in unscaled.items() if options.unit != "counts" and not _COUNTS.search(name)}
    for name in unscaled.values():
        if options.unit is None and _GRAD.match(name):
            raise RunError(
                f"{table.path}: the name of column {name!r} can mean degrees or gon (400 gon = 360 degrees): for"
                " degrees, add --unit deg; for gon, convert them (--unit deg --scale 0.9)"
            )
    for pattern, meaning, unit, factor in _SCALED_UNITS:
        if axes := [axis for axis, name in unscaled.items() if pattern.search(name)]:
            number = f"{factor:.9g}"
            factors = number if "theta0" not in axes else ",".join(f"{axis}={number}" for axis in axes)
            raise RunError(
                f"{table.path}: column {unscaled[axes[0]]!r} is {meaning} by its name: convert it"
                f" ({unit}--scale {factors})"
            )


def refuse_long_form(table: Table, stated: Mapping[str, str]) -> None:
    """Refuse a table with one row per sensor.

    Raises:
        RunError: one column contains the names of few sensors, and another their values.
    """
    values = [name for name in table.names if bare(name) == "value"]
    if "theta1" in stated or not values:
        return
    for name, column in table.named:
        if _SENSOR.fullmatch(bare(name)) and np.unique(column).size <= len(AXES):
            raise RunError(
                f"{table.path}: seems to have one row per sensor ({name}, {values[0]}): export one column per joint; if"
                f" all rows are of one sensor, give --columns theta1={values[0]}"
            )
