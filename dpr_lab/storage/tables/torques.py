"""Find the columns of joint torques."""

import re
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dpr_lab.arrays import Array
from dpr_lab.errors import RunError
from dpr_lab.storage.tables.cells import listed
from dpr_lab.storage.tables.columns import JOINT_NAMES
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.storage.tables.table import Table, bare
from dpr_lab.storage.tables.time_stamps import varies

KINDS = ("measured", "commanded")
JOINTS = ("tau1", "tau2")
"""Names of the torques in the options `columns` and `scale`."""
PASSIVE = "none"
"""Substitute name of the torque column of a joint without a drive."""
KIND_WORDS = {"meas": "measured"} | dict.fromkeys(("command", "cmd", "desired", "des"), "commanded")
KIND_WORDS |= dict(zip(KINDS, KINDS, strict=True))
"""Kind of a torque by its word in a column name, such as `cmd`."""
TORQUE_WORDS = "tau|torque|trq|effort"
TORQUE_UNITS = {"nm": 1.0, "mnm": 1e-3, "nmm": 1e-3, "ncm": 1e-2}
_SET_POINT = re.compile(r"(?<![a-z])(goal|target|desired|reference|set[\W_]?points?)(?![a-z])", re.I)
_DUTY = re.compile("pwm|duty")
_NAME = re.compile(
    "(?:{word}){kind}([12])?{kind}({unit})?".format(
        word=TORQUE_WORDS, kind=f"({'|'.join(KIND_WORDS)})?", unit="|".join(TORQUE_UNITS)
    )
)

_OF_JOINT = [
    (re.compile(f"({joint})(?P<kind>.*?)(?P<torque>{TORQUE_WORDS})"), rf"\g<torque>\g<kind>{number}")
    for number, joint in enumerate(JOINT_NAMES.values(), 1)
]
"""Pattern of a torque with the name of its joint, and the same name with the number of the joint."""

Pairs = Mapping[str, tuple[str, str]]
"""Names of the columns of joints 1 and 2 for each kind, `measured` first. The kind is an empty text if no column
states it."""


def find_torques(
    names: Sequence[str], source: str | None, stated: Mapping[str, str], path: object, *, alone: bool = False
) -> Pairs:
    """Find the torque columns of both joints; the mapping is empty for a free swing.

    If columns of one kind exist, columns without a stated kind are of the other kind. A joint without a torque column
    is passive, and the name of its column is `PASSIVE`.

    Args:
        names: names of the columns
        source: `measured` or `commanded`, if only this kind is requested; `none` for no torques; None for all
        stated: stated names of the columns of `tau1` and `tau2`
        path: path of the table
        alone: whether there is only joint 1, whose torque then needs no number

    Raises:
        RunError: two columns contain one torque, the requested kind does not exist, a joint has only a torque of
            another kind, or a stated column does not exist.
    """
    if source == "none":
        return {}
    if named := {joint: stated[joint] for joint in JOINTS if joint in stated}:
        return _stated(names, source, named, path)
    matches = {name: match for name in names if (match := _named(name))}
    numbered = {name: match for name, match in matches.items() if match[2]}
    matches = matches if alone and not numbered else numbered
    kinds = {name: KIND_WORDS.get(match[1] or match[3] or "", "") for name, match in matches.items()}
    others = [kind for kind in KINDS if kind not in kinds.values()]
    other_kind = (source if len(others) == 2 else others[0] if others else None) or ""
    by_kind: dict[str, dict[str, str]] = {kind: {} for kind in ("", *KINDS)}
    driven = {name: match[2] or "1" for name, match in matches.items()}
    for name, joint in driven.items():
        of_kind = by_kind[kinds[name] or other_kind]
        if joint in of_kind:
            raise RunError(
                f"{path}: the names of {of_kind[joint]} and {name} denote the same torque: rename or remove one of"
                " the two columns"
            )
        of_kind[joint] = name
    kinds_used = (source,) if source in KINDS else KINDS if by_kind["measured"] or by_kind["commanded"] else ("",)
    chosen = {kind: by_kind[kind] for kind in kinds_used if by_kind[kind]}
    if source in KINDS and not chosen:
        raise RunError(
            f"{path}: has no column of {source} torques (--torque {source}); its columns: {', '.join(names)}"
        )
    by_joint = {joint: name for name, joint in driven.items()}
    for kind, pair in chosen.items():
        for joint in by_joint.keys() - pair.keys():
            option = ",".join(f"tau{other}={column}" for other, column in pair.items())
            raise RunError(
                f"{path}: joint {joint} has a torque ({by_joint[joint]}), but no {kind} torque like"
                f" {', '.join(pair.values())}: choose one kind for both joints with --torque, or, if joint {joint} has"
                f" no drive, name the other column (--columns {option})"
            )
    return {kind: (pair.get("1", PASSIVE), pair.get("2", PASSIVE)) for kind, pair in chosen.items()}


def _stated(names: Sequence[str], source: str | None, stated: Mapping[str, str], path: object) -> Pairs:
    """Return the torque columns that the options name; all must be of one kind."""
    for joint, name in stated.items():
        if name not in names:
            raise RunError(f"{path}: no column is named {name!r} ({joint}); the table has: {listed(names)}")
    matches = [match for name in stated.values() if (match := _named(name))]
    kinds = {KIND_WORDS[kind] for match in matches if (kind := match[1] or match[3])}
    kind = source or (kinds.pop() if len(kinds) == 1 else "")
    return {kind: (stated.get("tau1", PASSIVE), stated.get("tau2", PASSIVE))}


def _named(name: str) -> re.Match[str] | None:
    """Match kind, joint and unit of a torque in the name of its column.

    The name `elbow_meas_tau` is another form of `tau_meas_2`.
    """
    short = bare(name)
    for pattern, numbered in _OF_JOINT:
        short = pattern.sub(numbered, short)
    return _NAME.fullmatch(short)


def unnumbered(names: Sequence[str], driving: Pairs, options: ImportOptions) -> list[str]:
    """Return a note about unused torque columns that do not name their joint.

    The list is empty if there are none. On a moving arm, such a torque belongs to the drive of the arm.
    """
    torques = [name for name in names if (match := _named(name)) and not match[2]]
    if driving or options.arm != "clamped" or options.torque == "none" or not torques:
        return []
    return [f"{', '.join(torques)}: not used; name the joint of a torque, for example --columns tau1={torques[0]}"]


def torque_column(table: Table, name: str) -> Array:
    """Return the torques of a column, N m; zeros for a passive joint.

    The values are converted from the unit in the name of the column.

    Raises:
        RunError: the column has another length.
    """
    if name == PASSIVE:
        return np.zeros(len(table.lines))
    if name in table.other_lengths:
        raise RunError(
            f"{table.path}: torques of another length: {table.other_lengths[name]:,} values of {name!r} for"
            f" {len(table.lines):,} rows"
        )
    return table.column(name) * TORQUE_UNITS.get(unit_in(name), 1.0)


def unit_in(name: str) -> str:
    """Return the unit in the name of a torque column; empty if the name states none."""
    match = _named(name)
    return (match and match[4]) or ""


def held_torque(t: Array, torque: Array, rows: NDArray[np.intp]) -> Array:
    """Return the torque (k,) of the kept rows, N m.

    Over an interval with removed rows, the torque is averaged. The mean preserves the impulse.

    Args:
        t: (rows,) times of all rows, s
        torque: (rows,) torque of each row, held until the next row, N m
        rows: (k,) indices of the kept rows, ascending
    """
    known = np.flatnonzero(np.isfinite(t) & np.isfinite(torque))
    impulse = np.concatenate([[0.0], np.cumsum(torque[known[:-1]] * np.diff(t[known]))])[np.searchsorted(known, rows)]
    held, left_out = np.diff(t[rows]), np.diff(rows) > 1
    mean = torque[rows].copy()
    mean[:-1][left_out] = (np.diff(impulse) / np.where(held > 0, held, 1.0))[left_out]
    return mean


def sign_of_drive(table: Table, arm: str) -> str:
    """Describe a column of set points or motor commands that varies; empty if there is none.

    The duty cycle of the motor of a moving arm does not show that the rods are driven.
    """
    varying = [name for name, column in table.named if varies(column)]
    if name := next(filter(_SET_POINT.search, varying), ""):
        return f"column {name} is the set point of a controller, which drives the rods"
    name = next((name for name in varying if arm == "clamped" and _DUTY.search(bare(name))), "")
    return name and f"column {name} is the duty cycle of a motor, which drives the rods"
