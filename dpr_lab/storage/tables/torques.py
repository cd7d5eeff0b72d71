"""Find the columns of joint torques, and other interpretations of these columns."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.arrays import Array
from dpr_lab.errors import RunError
from dpr_lab.identification.misread.balance import EnergyFit, energy_fit
from dpr_lab.identification.misread.torque_balance import torque_balance
from dpr_lab.rig import Rig
from dpr_lab.shown import percent
from dpr_lab.storage.tables.columns import JOINT_NAMES
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.storage.tables.readings import READ
from dpr_lab.storage.tables.table import Table, bare
from dpr_lab.storage.tables.time_stamps import varies

KINDS = ("measured", "commanded")
JOINTS = ("tau1", "tau2")
"""Names of the torques in the options `columns` and `scale`."""
PASSIVE = "none"
"""Substitute name of the torque column of a joint without a drive."""
_KINDS = {"meas": "measured"} | dict.fromkeys(("command", "cmd", "desired", "des"), "commanded")
_KINDS |= dict(zip(KINDS, KINDS, strict=True))
_SET_POINT = re.compile(r"(?<![a-z])(goal|target|desired|reference|set[\W_]?points?)(?![a-z])", re.I)
_UNITS = {"nm": 1.0, "mnm": 1e-3, "nmm": 1e-3, "ncm": 1e-2}
_NAME = re.compile(
    "(?:tau|torque|trq|effort){kind}([12])?{kind}({unit})?".format(kind=f"({'|'.join(_KINDS)})?", unit="|".join(_UNITS))
)
_FACTORS = (1e-3, 1e-2, 1e3)
"""Factors of other common units of torque relative to N m: mN m, N cm, kN m."""

_OF_JOINT = [
    (re.compile(f"({joint})(?P<kind>.*?)(?P<torque>tau|torque|trq|effort)"), rf"\g<torque>\g<kind>{number}")
    for number, joint in enumerate(JOINT_NAMES.values(), 1)
]
"""Pattern of a torque with the name of its joint, and the same name with the number of the joint."""

Pairs = Mapping[str, tuple[str, str]]
"""Names of the columns of joints 1 and 2 for each kind, `measured` first. The kind is empty if no column states it."""


def find_torques(
    names: Sequence[str], source: str | None, given: Mapping[str, str], path: object, *, alone: bool = False
) -> Pairs:
    """Find the torque columns of both joints; a free swing has an empty mapping.

    If columns of one kind exist, columns without a stated kind are of the other kind. A joint without a torque column
    is passive, and the name of its column is `PASSIVE`.

    Args:
        names: names of the columns
        source: `measured` or `commanded`, if only this kind is requested; `none` for no torques; None for all
        given: stated names of the columns of `tau1` and `tau2`
        path: path of the table
        alone: whether there is only joint 1, whose torque then needs no number

    Raises:
        RunError: two columns contain one torque, the requested kind does not exist, a joint has only a torque of
        another kind, or a stated column does not exist.
    """
    if source == "none":
        return {}
    if stated := {joint: given[joint] for joint in JOINTS if joint in given}:
        return _stated(names, source, stated, path)
    matches = {name: match for name in names if (match := _named(name))}
    numbered = {name: match for name, match in matches.items() if match[2]}
    matches = matches if alone and not numbered else numbered
    kinds = {name: _KINDS.get(match[1] or match[3] or "", "") for name, match in matches.items()}
    others = [kind for kind in KINDS if kind not in kinds.values()]
    unsaid = (source if len(others) == 2 else others[0] if others else None) or ""
    by_kind: dict[str, dict[str, str]] = {kind: {} for kind in ("", *KINDS)}
    driven = {name: match[2] or "1" for name, match in matches.items()}
    for name, joint in driven.items():
        of_kind = by_kind[kinds[name] or unsaid]
        if joint in of_kind:
            raise RunError(
                f"{path}: {of_kind[joint]} and {name} contain the same torque: remove one of the two columns"
            )
        of_kind[joint] = name
    wanted = (source,) if source in KINDS else KINDS if by_kind["measured"] or by_kind["commanded"] else ("",)
    chosen = {kind: by_kind[kind] for kind in wanted if by_kind[kind]}
    if source in KINDS and not chosen:
        raise RunError(f"{path}: has no column of {source} torques; its columns: {', '.join(names)}")
    by_joint = {joint: name for name, joint in driven.items()}
    for kind, pair in chosen.items():
        for joint in by_joint.keys() - pair.keys():
            stated = ",".join(f"tau{other}={column}" for other, column in pair.items())
            raise RunError(
                f"{path}: joint {joint} has a torque ({by_joint[joint]}), but no {kind} torque like"
                f" {', '.join(pair.values())}: choose one kind for both joints with --torque, or, if joint {joint} has"
                f" no drive, name the other column (--columns {stated})"
            )
    return {kind: (pair.get("1", PASSIVE), pair.get("2", PASSIVE)) for kind, pair in chosen.items()}


def _stated(names: Sequence[str], source: str | None, stated: Mapping[str, str], path: object) -> Pairs:
    """Return the torque columns that the options name; all must be of one kind."""
    for joint, name in stated.items():
        if name not in names:
            raise RunError(f"{path}: no column is named {name!r} ({joint}); the table has: {', '.join(names)}")
    matches = [match for name in stated.values() if (match := _named(name))]
    kinds = {_KINDS[kind] for match in matches if (kind := match[1] or match[3])}
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

    The unit is that in the name of the column.

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
    match = _named(name)
    return table.column(name) * (_UNITS[match[4]] if match and match[4] else 1.0)


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


@dataclass(frozen=True, slots=True)
class OtherTorques:
    """Another interpretation of the torques of a table."""

    cause: str
    """Description of the difference from the given interpretation."""
    torques: Array
    """(n, 2) N m."""
    words: tuple[str, ...]
    """Command-line options that select this interpretation."""


def other_torques(
    torques: Array | None, pair: tuple[str, str], scale: Mapping[str, float], ignored: tuple[str, Array] | None
) -> Iterator[OtherTorques]:
    """Yield other interpretations of the torques: signs, units, exchanged or ignored torques.

    Args:
        torques: (n, 2) as interpreted, N m; None for a free swing
        pair: names of the columns of the torques
        scale: factors of the option `--scale`
        ignored: kind and (n, 2) torques that the options ignore, N m; None if no torques are ignored
    """
    if ignored is not None:
        cause = "the torques of the table act, which --torque none ignores"
        yield OtherTorques(cause, ignored[1], ("--torque", ignored[0]))
    if torques is None:
        return
    signs = {"torque 2 has the opposite sign": (1, -1), "torque 1 has the opposite sign": (-1, 1)}
    signs["both torques have the opposite sign"] = (-1, -1)
    units = {f"the torques must be multiplied by {factor:g} to be in N m": (factor, factor) for factor in _FACTORS}
    for cause, factors in (signs | units).items():
        scaled = {**scale, **{j: scale.get(j, 1.0) * factor for j, factor in zip(JOINTS, factors, strict=True)}}
        words = ",".join(f"{name}={factor:g}" for name, factor in scaled.items() if factor != 1.0)
        yield OtherTorques(cause, torques * factors, ("--scale", words or "1"))
    if PASSIVE not in pair:
        words = ("--columns", f"tau1={pair[1]},tau2={pair[0]}")
        yield OtherTorques("the columns of the two torques are exchanged", torques[:, ::-1], words)


def better_torques(
    fit: EnergyFit, t: Array, rods: Array, others: Sequence[OtherTorques], rig: Rig
) -> OtherTorques | None:
    """Find the interpretation of the torques with a clearly smaller energy residual than `fit`.

    The result is None if there is none.

    Args:
        fit: energy balance of the given interpretation
        t: (n,) times, s
        rods: (n, 2) absolute angles, rad
        others: other interpretations
        rig: the recorded rig
    """
    fits = [(energy_fit(t, rods, other.torques, rig), other) for other in others]
    residuals = [(refitted.residual, other) for refitted, other in fits if refitted is not None]
    residual, best = min(residuals, key=lambda pair: pair[0], default=(np.inf, None))
    return best if residual < min(READ.sure, fit.residual / READ.better) else None


def coarse_torques(torques: Array, limit: float, words: str) -> str:
    """Warn if torques or an input change too much from row to row.

    Otherwise return an empty text.

    Args:
        torques: (n, 2) from the release on, N m
        limit: maximum median change between rows, relative to the range
        words: subject and verb of the sentence
    """
    changes, ranges = np.median(np.abs(np.diff(torques, axis=0)), axis=0), np.ptp(torques, axis=0)
    share = float(np.max(changes / np.maximum(ranges, np.finfo(float).tiny)))
    if share <= limit:
        return ""
    return (
        f"{words} by {percent(share)} of the range from row to row. The rows do not show when such a change occurs,"
        " and a"
        " diagnosis may name a delay of the input: export the table at the rate of the controller"
    )


def set_point(table: Table) -> str:
    """Name a varying column of controller set points, or return an empty text."""
    columns = zip(table.names, table.values, strict=True)
    name = next((name for name, column in columns if _SET_POINT.search(name) and varies(column)), "")
    return name and f"column {name} is the set point of a controller, which drives the rods"


def idle_torques(
    t: Array, rods: Array, torques: Array | None, pair: tuple[str, str], rig: Rig, limits: tuple[float, float]
) -> str:
    """Warn about torques above gravity that do not seem to act.

    Otherwise return an empty text.

    Args:
        t: (n,) times, s
        rods: (n, 2) absolute angles, rad
        torques: (n, 2) torques in the given interpretation, N m
        pair: names of the columns of the torques
        rig: the recorded rig
        limits: smallest residual of the torque balance, relative to gravity, for which the torques may not act at all;
            largest ratio of the residual without torques to this residual, for which they probably do not act
    """
    acting, idle = (torque_balance(t, rods, acting, rig) for acting in (torques, None))
    if torques is None or acting is None or idle is None:
        return ""
    residual = acting.residual()
    if not residual > limits[0] or idle.residual() > limits[1] * residual:
        return ""
    joint = int(np.argmax(np.abs(torques).max(axis=0)))
    most, name = float(np.abs(torques[:, joint]).max()), JOINTS[joint]
    return (
        f"the torque {pair[joint]!r} reaches {most:.3g} N m, {most / acting.gravity[joint]:.2g} times the largest"
        f" torque of gravity on the rod, but the motion agrees better with no torque: check its unit (--scale"
        f" {name}=...) and its column (--columns {name}=...), or ignore it (--torque none)"
    )
