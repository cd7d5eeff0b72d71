"""Find the meaning of the columns of a table from options, names, or their order."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.errors import RunError
from dpr_lab.storage.tables.cells import listed, names_no_angle, names_rate
from dpr_lab.storage.tables.options import AXES, ImportOptions
from dpr_lab.storage.tables.questions.frame_numbers import counter, refuse_row_numbers
from dpr_lab.storage.tables.questions.names import numbered, refuse_long_form, refuse_scaled_units, without_scaled_unit
from dpr_lab.storage.tables.table import LIMITS, Column, Table, bare, own_name
from dpr_lab.storage.tables.time_stamps import different_times, never_falls, runs, varies, without_speed

TO_RADIANS = {"rad": 1.0, "deg": math.pi / 180}
TO_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
UNITS = ("rad", "deg", "counts")
NO_ROD = "joint 2, without a rod"
"""Name of the substitute column for joint 2 of a rig with one rod."""

_TIME_NAME = r"(t|(date|clock|host|elapsed)?time(stamp)?|clock|elapsed|tout|zeit|temps|tempo|tiempo)?({unit})?(?<=.)"
_DURATION = "(dt|deltat(ime)?|timestep|duration)({unit})?"
"""Pattern of the duration of a row, used only without a column of times."""
_TIME_SUFFIX = {"s": "s|sec|seconds", "ms": "ms|msec|milliseconds|millis", "us": "us|usec|microseconds|micros"}
_ANY_TIME = "|".join(_TIME_SUFFIX.values())
_ANGLE_UNIT = r"(rad(?:ians?)?|deg|degrees?|degr[eé]s|gra(?:us|dos|di|den|d))"
_ANGLE_WORD = "(theta|th|phi|q|angle|angulo|angolo|winkel|joint|pos|position|gon|θ|φ)"
_MEASURED = "(meas|measured|act|actual|exp|experimental?|obs|observed|real)"
_ANGLE_NAME = (
    rf"{_ANGLE_WORD}{{axis}}{_ANGLE_UNIT}?|(enc|encoder){{axis}}{_ANGLE_UNIT}"
    r"|joint{axis}(pos|position)"
)
_MEASURED_NAME = rf"{_ANGLE_WORD}({{axis}}{_MEASURED}|{_MEASURED}{{axis}}){_ANGLE_UNIT}?"
_ARM_NAME = rf"arm(angle|pos|position)?{_ANGLE_UNIT}?"
_OTHER_ANGLE = "(alpha|beta|psi|α|β|ψ)"  # used last, because alpha is also an angular acceleration
JOINT_NAMES = {
    "theta1": "shoulder|(inner|upper)(rod|link|arm)|inner",
    "theta2": "elbow|(outer|lower)(rod|link|arm)|outer",
}
_ON_ARM = {"theta0": f"theta{_ANGLE_UNIT}?", "theta1": f"alpha{_ANGLE_UNIT}?"}
"""Patterns of the angles of arm and rod in the notation of Quanser."""
_ROD_NAME = rf"(rod|pole|pend(ulum|ulo|ule|el)?)(angle|pos|position)?{_ANGLE_UNIT}?"
_COUNT_NAME = rf"(counts?|enc|encoder){{axis}}(counts?|ticks?)?|{_ANGLE_WORD}{{axis}}(counts?|ticks?)"
_ONE_COUNT = re.compile("(enc|encoder|counts?|ticks?)(counts?|ticks?|val|value)?(unwrapped)?")
_ONE_ROD = re.compile(
    f"{_ANGLE_NAME}|{_COUNT_NAME}|{_ROD_NAME}|(abs|absolute|{_MEASURED}){_ANGLE_WORD}{_ANGLE_UNIT}?".format(axis="")
)
_PLACE = re.compile("pos(ition)?([cm]?m)?")
"""Pattern of a position: the position of a cart if another column is an angle, otherwise the angle of the rod."""
_COORDINATE = re.compile(r"\W*[xy][\W_]*([cm]?m|px|pixels?)?\W*|.*[\W_][xy][\W_]*([cm]?m|px|pixels?)\W*", re.I)
_TIME_UNIT_IN_NAME = re.compile(r"(?<![a-z])(ms|us|s)(?![a-z])")
UNIT_IN_NAME = re.compile(
    r"((?<![a-z])rad|(?<![a-z])counts|(?<!m)(?<!milli)deg)(ians|rees|r[eé]s)?(?![a-z])|[°º˚]|gra(us|dos|di|den|d)(?![a-z])"
)
_ERROR = re.compile(r"d[xyt]|(delta|δ|unc|uncertainty|sigma|std)\w*")
"""Pattern of a column with the error of a value, as programs for curve fitting write it."""
_NO_NAME = re.compile(r"\d+|.+\[\d+\]|[xy]", re.I)
"""Pattern of names without a meaning: numbers, elements of an array, and axes of a plot."""
_JOINT_STATES = (re.compile(r"(?:.*[/.])?positions?\[\d+\]", re.I), re.compile(r".+/position", re.I))
"""Patterns of joint angles in tables of ROS: `/joint_states/position[0]`, `/joint_states/shoulder/position`."""


@dataclass(frozen=True, slots=True)
class Columns:
    """Meaning and unit of each column."""

    names: Mapping[str, str]
    """Column name of each quantity: t and each axis."""
    unit: str
    time_unit: str
    notes: tuple[str, ...] = ()


def is_time(name: str, unit: str | None = None) -> bool:
    """Check whether a name is a common name of a time column, in any unit or in `unit`."""
    return bool(re.fullmatch(_TIME_NAME.format(unit=_TIME_SUFFIX.get(unit or "", _ANY_TIME)), bare(name)))


def is_duration(name: str) -> bool:
    """Check whether a name is a common name of the durations of rows."""
    return bool(re.fullmatch(_DURATION.format(unit=_ANY_TIME), bare(name)))


def guess_columns(names: Sequence[str], unit: str = "rad", time_unit: str = "s") -> dict[str, str]:
    """Find columns by common names; ambiguous quantities are omitted.

    A time whose name states its unit is preferred. Names with a word such as `measured` or `exp`, and names of joints,
    such as `shoulder`, are used only if no column has a plain name. Other letters, such as `alpha1`, are used only if
    no other name of a rod's angle is found.
    """
    common, angle, ending = (
        (_COUNT_NAME, _COUNT_NAME, "(counts?|ticks?)?")
        if unit == "counts"
        else (_ANGLE_NAME, f"{_ANGLE_NAME}|{_ARM_NAME}", f"(angle|pos)?{_ANGLE_UNIT}?")
    )
    time = _TIME_NAME.format(unit=_TIME_SUFFIX[time_unit])
    patterns: dict[str, list[str]] = {}
    for axis, quantity in enumerate(AXES):
        name = angle if quantity == "theta0" else common
        patterns[quantity] = [name.format(axis=axis), _MEASURED_NAME.format(axis=axis)]
    for quantity, joint in JOINT_NAMES.items():
        patterns[quantity] += [f"({joint}){ending}", f"({joint}){_MEASURED}{ending}"]
    named = {q: _angles(names, alternatives) for q, alternatives in patterns.items()}
    clocks = _matches(names, [time, _MEASURED + time, _DURATION.format(unit=_TIME_SUFFIX[time_unit])])
    named["t"] = [name for name in clocks if _TIME_UNIT_IN_NAME.search(name.lower())] or clocks
    counts = [_COUNT_NAME.format(axis=axis) for axis in (1, 2)]
    plain = named["theta1"] + named["theta2"] + _matches(names, [_ONE_ROD.pattern, *counts])
    if not plain and unit != "counts":
        named |= {q: _angles(names, [f"{_OTHER_ANGLE}{q[-1]}{_ANGLE_UNIT}?"]) for q in JOINT_NAMES}
    return {quantity: matches[0] for quantity, matches in named.items() if len(matches) == 1}


def _matches(names: Sequence[str], patterns: Sequence[str]) -> list[str]:
    """Return the names that match a pattern; the first pattern that any name matches is used."""
    matches = ([name for name in names if re.fullmatch(pattern, bare(name))] for pattern in patterns)
    return next(filter(None, matches), [])


def _angles(names: Sequence[str], patterns: Sequence[str]) -> list[str]:
    """Return the names that match.

    Names with a scaled unit, such as mrad, are used only if no other name matches.
    """
    if matches := _matches(names, patterns):
        return matches
    stems = [without_scaled_unit(name) for name in names]
    matches = _matches(stems, patterns)
    return [name for name, stem in zip(names, stems, strict=True) if stem in matches]


def stated_columns(table: Table, options: ImportOptions, one_rod: bool) -> tuple[Table, dict[str, str], ImportOptions]:
    """Return the table, its stated columns of time and angles, and the options with resolved column names.

    A missing rod gets a constant angle.
    """
    table, columns = numbered(table, options.columns)
    stated = {quantity: name for quantity, name in columns.items() if quantity in ("t", *AXES)}
    refuse_long_form(table, stated)
    if one_rod:
        table, stated = with_still_joint2(table, stated, options.rate_hz is None)
    return table, stated, replace(options, columns=columns)


def find_columns(table: Table, stated: Mapping[str, str], options: ImportOptions) -> Columns:
    """Find the columns of time and angles by options, by names, or by position.

    Args:
        table: the table
        stated: stated column names of t, theta0, theta1 and theta2
        options: units, scales and sample rate; a unit of None stands for the unit in the column names, or for rad or s

    Raises:
        RunError: a column is missing, is used twice, has another length, or states a unit other than the given one.
    """
    clocks = {name: column for name, column in table.named if options.rate_hz is None and name not in stated.values()}
    clocks = different_times({name: column for name, column in clocks.items() if is_time(name, options.time_unit)})
    names = [*table.names, *table.other_lengths]
    names = [name for name in names if not (clocks and is_time(name)) or clocks.get(name) == max(clocks.values())]
    unit = options.unit or ("counts" if _is_counted(table, stated.get("theta1", "")) else _unit_in_names(names, stated))
    time_unit = options.time_unit or _time_unit_in_names(names, stated)
    if table.settled and "t" not in guess_columns(names, unit, time_unit):  # points of one film share their times
        names = [name for name in names if name not in [name for name in names if is_time(name, time_unit)][1:]]
    named, notes = guess_columns(names, unit, time_unit) | dict(stated), ()
    named = {quantity: name for quantity, name in named.items() if quantity in stated or name not in stated.values()}
    if joints := _of_joint_states(names, stated):
        named = {quantity: name for quantity, name in named.items() if name not in joints.values()} | joints
        notes = (f"columns {', '.join(joints.values())} are interpreted as {', '.join(joints)}",)
    elif not {"theta1", "theta2"} & set(named):
        by_place = _by_place(table, named.get("t"), options.rate_hz is not None)
        notes = (f"columns without names are interpreted as {', '.join(by_place)}",) if by_place else ()
        named |= by_place
    if options.rate_hz is not None:
        named.pop("t", None)
    _refuse(table, named, stated, options.rate_hz is None)
    _check_units(table, named, unit, time_unit)
    refuse_scaled_units(table, named, options)
    if "t" in named and "t" not in options.columns and not table.settled:
        refuse_row_numbers(table, named["t"], (*named.values(), *filter(is_time, names)))
    if "t" not in stated and (others := [name for name in clocks if name != named["t"]]):
        notes = (*notes, f"time: {named['t']}; {listed(others)} can also be the time (--columns t=NAME uses it)")
    return Columns(named, unit, time_unit, notes)


def with_still_joint2(table: Table, stated: Mapping[str, str], timed: bool) -> tuple[Table, dict[str, str]]:
    """Add a constant column for the missing joint 2 to a table of one rod.

    The result is the table and the column names of its quantities. The name of the rod's column may lack a number. If
    only one column varies, it needs no name. If the column of theta1 is given, a column named like theta2 does not
    count as a second rod, because it may be another recording.
    """
    guessed = [guess_columns(table.names, unit) for unit in ("rad", "counts")]
    if "theta2" in stated or ("theta1" not in stated and any("theta2" in guess for guess in guessed)):
        return table, dict(stated)
    clock = _clock(table, stated) if timed else {}
    stated, notes = clock | dict(stated), table.notes
    stated |= {} if {"theta0", "theta1"} & set(stated) else _on_arm(table.names)
    alone = _angles(table.names, [_ONE_ROD.pattern, f"({_ONE_ROD.pattern})unwrapped"])
    moving = {name for name, column in table.named if varies(column)}
    places = {name for name in alone if _PLACE.fullmatch(bare(name))}
    letters = {name for name in alone if len(bare(name)) == 1}  # a single letter such as `Q` may denote an input
    for unlikely in (places, set(alone) - moving, letters):
        alone = [name for name in alone if name not in unlikely] or alone
    if "theta1" not in stated and not any("theta1" in guess for guess in guessed):
        if len(alone) != 1:
            alone = _only_varying(table, stated)
            reason = "because no other column that varies can be an angle"
            if any(map(str.isdecimal, alone)):
                reason += ". If it is a distance or a voltage, export the angle, or the x and y of the point"
            notes = (*notes, *(f"interpreted as theta1: {name}, {reason}" for name in alone))
        stated |= dict(zip(("theta1",), alone, strict=False))
    grown = replace(table, columns=(*table.columns, Column(NO_ROD, np.zeros(len(table.lines)))), notes=notes)
    return grown, {**stated, "theta2": NO_ROD}


def _on_arm(names: Sequence[str]) -> dict[str, str]:
    """Find the columns of arm and rod by the names that Quanser uses; empty unless each occurs once."""
    named = {quantity: _matches(names, [pattern]) for quantity, pattern in _ON_ARM.items()}
    single = all(len(matches) == 1 for matches in named.values())
    return {quantity: matches[0] for quantity, matches in named.items()} if single else {}


def _clock(table: Table, stated: Mapping[str, str]) -> dict[str, str]:
    """Find an increasing column that is the time although no name states it.

    Only the first column is tested. If the columns have no names, the last column can also be the time.
    """
    if table.settled or "t" in stated or any(map(is_time, table.names)) or counter(table):
        return {}
    unnamed = all(_NO_NAME.fullmatch(name) for name in table.names)
    place = -1 if unnamed and not never_falls(table.values[0]) else 0
    name, timelike = table.names[place], (unnamed and not place) or runs(table.values[place])
    return {"t": name} if timelike and len(table.names) > 1 and name not in stated.values() else {}


def _only_varying(table: Table, stated: Mapping[str, str]) -> list[str]:
    """Return the name of the only column that varies, apart from the time; empty if there are several.

    Raises:
        RunError: the only column that varies is one coordinate of a point.
    """
    if table.settled:
        return []
    clock = stated.get("t", "")
    only_two = bool(clock) and len(table.names) == 2  # the angle of a rod that falls over also increases steadily
    varying = [
        name
        for name, column in table.named
        if name not in stated.values() and not is_time(name) and not _ERROR.fullmatch(bare(name))
        if (only_two or not runs(column)) and varies(column)
    ]
    varying = [name for name in varying if not names_no_angle(name)] or varying
    if len(varying) > 1 and clock and all(_NO_NAME.fullmatch(name) for name in table.names):
        varying = without_speed({name: table.column(name) for name in varying}, table.column(clock))
    if len(varying) == 1 and not clock and _COORDINATE.fullmatch(own_name(varying[0])):
        raise RunError(
            f"{table.path}: {varying[0]!r} is the name of one coordinate of a point, and an angle requires two: export"
            f" the x and the y of the point; if the column is the angle of the rod, give --columns theta1={varying[0]}"
        )
    return varying if len(varying) == 1 and not names_no_angle(varying[0]) else []


def _refuse(table: Table, named: Mapping[str, str], stated: Mapping[str, str], timed: bool) -> None:
    names = [*table.names, *table.other_lengths]
    named_so = [name for name in names if name not in ("", NO_ROD)]
    available = f"the table has: {listed(named_so[: LIMITS.named])}"
    available += f" and {len(named_so) - LIMITS.named} more" if len(named_so) > LIMITS.named else ""
    unnameable = any("," in name or name.endswith("(without a name)") or names.count(name) > 1 for name in named_so)
    number = "; NAME can be the number of the column" if unnameable else ""
    for quantity, name in stated.items():
        if names.count(name) != 1:
            count = names.count(name) or "no"
            raise RunError(
                f"{table.path}: {count} columns are named {name!r} (--columns {quantity}={name}); {available}{number}"
            )
    misread = {unit: name for unit in TO_SECONDS if (name := guess_columns(names, time_unit=unit).get("t"))}
    if timed and "t" not in named and len(misread) == 1:
        ((unit, name),) = misread.items()
        raise RunError(
            f"{table.path}: column {name!r} is in {unit} by its name: remove --time-unit, or rename the column"
        )
    missing = [q for q in (("t",) if timed else ()) + ("theta1", "theta2") if q not in named]
    if missing == ["t"] and (counted := counter(table)):
        raise RunError(
            f"{table.path}: no column of times; {counted!r} counts the rows: give their rate (--rate-hz), for a film"
            " the frames per second of the camera"
        )
    if missing:
        rate = "; for a table without time give --rate-hz" if "t" in missing else ""
        needed = "; for one rod, add --rods inner or --rods outer" if NO_ROD not in names and missing != ["t"] else ""
        unnamed = all(map(_NO_NAME.fullmatch, named_so))
        clocks = [name for name in names if "t" in missing and is_time(re.sub(r"\d+\W*$", "", name))]
        if len(clocks) > 1:
            example = f"--columns t={clocks[0]}{'' if table.settled else ',theta1=NAME'}"
            rate = f"; {listed(clocks)} can each be the time. Of recordings next to each other import one: {example}"
        points = "; for points of a video add a first line with their names, for example t,x,y" if unnamed else ""
        unrated = re.compile(r"abs|column \d+ \(without", re.I)
        rated = [name for name in named_so if not (is_time(name) or unrated.match(name))]
        if rated and all(map(names_no_angle, rated)):
            points = ". None of them is an angle: export the angle of the rod"
            points += ", for example the integral of a rate" if any(map(names_rate, rated)) else ""
        if {"sin", "cos"} <= {bare(name)[:3] for name in named_so}:
            points += "; for columns of sin and cos, export the angle, atan2(sin, cos)"
        raise RunError(
            f"{table.path}: no single column found for {' and '.join(missing)}; {available}."
            f" Name {'them' if len(missing) > 1 else 'it'}: --columns"
            f" {','.join(f'{quantity}=NAME' for quantity in missing)}{number}{needed}{rate}"
            f"{points}"
        )
    other = [name for name in named.values() if name in table.other_lengths]
    if other:
        lengths = ", ".join(f"{name} {table.other_lengths[name]:,}" for name in other)
        raise RunError(
            f"{table.path}: columns of different length: {lengths} values, but the others have {len(table.lines):,}"
        )


def _unit_in_names(names: Sequence[str], stated: Mapping[str, str]) -> str:
    angles = guess_columns(names, "rad") | dict(stated)
    matches = [UNIT_IN_NAME.search(angles[axis].lower()) for axis in AXES if axis in angles]
    units = {match[1] or "deg" for match in matches if match}
    if len(units) == 1:
        return units.pop()
    counted = guess_columns(names, "counts")
    return "counts" if not {"theta1", "theta2"} & set(angles) and "theta1" in counted else "rad"


def _is_counted(table: Table, name: str) -> bool:
    """Check whether a column without a number in its name, for example `encoder`, contains counts."""
    counted = name in table.names and _ONE_COUNT.fullmatch(bare(name))
    return bool(counted) and bool((np.mod(table.values[table.names.index(name)], 1.0) == 0.0).all())


def _time_unit_in_names(names: Sequence[str], stated: Mapping[str, str]) -> str:
    if "t" in stated:
        match = _TIME_UNIT_IN_NAME.search(stated["t"].lower())
        return match[1] if match else "s"
    clocks = {unit: guess_columns(names, time_unit=unit).get("t") for unit in TO_SECONDS}
    # a name without a unit, which is ambiguous in s, does not state another unit
    return next((unit for unit, name in clocks.items() if name and (unit == "s" or not guess_columns([name]))), "s")


def _by_place(table: Table, time: str | None, without_time: bool) -> dict[str, str]:
    """Assign unnamed columns by order: time (if present), arm (if three columns remain), both rods."""
    if table.settled or not all(_NO_NAME.fullmatch(name) for name in table.names if name != time):
        return {}
    others = [name for name in table.names if name != time]
    named: dict[str, str] = {}
    if time is None and not without_time and runs(table.values[0]):
        named["t"] = others.pop(0)
    if len(others) not in (2, 3) or (time is None and not without_time and not named):
        return {}
    return named | dict(zip(AXES[-len(others) :], others, strict=True))


def _of_joint_states(names: Sequence[str], stated: Mapping[str, str]) -> dict[str, str]:
    """Assign the columns of a ROS joint state to the axes, in their order.

    The columns are assigned to the rods, or to the arm and the rods. Nothing is assigned if the names of the joints
    contain numbers that identify the axes.
    """
    if {"theta0", "theta1"} & set(stated):
        return {}
    rods = AXES[1:2] if NO_ROD in names else AXES[1:]
    for pattern in _JOINT_STATES:
        positions = [name for name in names if pattern.fullmatch(name)]
        numbered = "[" not in "".join(positions) and "theta1" in guess_columns(positions)
        for axes in (rods, (AXES[0], *rods)):
            if len(positions) == len(axes) and not numbered:
                return dict(zip(axes, positions, strict=True))
    return {}


def _check_units(table: Table, named: Mapping[str, str], unit: str, time_unit: str) -> None:
    for quantity, name in named.items():
        pattern, stated_unit = (_TIME_UNIT_IN_NAME, time_unit) if quantity == "t" else (UNIT_IN_NAME, unit)
        match = pattern.search(name.lower())
        if match and (match[1] or "deg") != stated_unit:
            raise RunError(
                f"{table.path}: column {name!r} states {match[0]}, but the given unit is {stated_unit}: remove the"
                " option, or correct the name in the table"
            )
