"""Columns of known inputs: joint torques, input of a driven arm, or cart position."""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.arrays import Array
from dpr_lab.errors import RunError
from dpr_lab.rig import Rig, refuse_impossible_arm, refuse_impossible_inner
from dpr_lab.rig_tables import MotorTable
from dpr_lab.storage.tables.cells import listed
from dpr_lab.storage.tables.options import ImportOptions
from dpr_lab.storage.tables.table import Table, bare
from dpr_lab.storage.tables.time_stamps import varies
from dpr_lab.storage.tables.torques import (
    JOINTS,
    KIND_WORDS,
    PASSIVE,
    TORQUE_UNITS,
    TORQUE_WORDS,
    Pairs,
    find_torques,
    held_torque,
)

_NAMES = {
    "torque": TORQUE_WORDS,
    "current": "current|cur|i|im",
    "voltage": "voltage|volt|v|vm|vin",
    "acceleration": "acceleration|acc|alpha|u",
}
_UNITS = {
    "torque": TORQUE_UNITS,
    "current": {"a": 1.0, "amp": 1.0, "amps": 1.0, "ma": 1e-3},
    "voltage": {"v": 1.0, "volt": 1.0, "volts": 1.0, "mv": 1e-3},
    "acceleration": {"rads2": 1.0},
}
_KIND = f"(?:{'|'.join(KIND_WORDS)}|motor|arm)?"
_UNNAMED = f"{_KIND}(?:input|u|control|action){_KIND}"
"""Pattern of names that do not state the kind of an input, such as `input`, which `run export` writes. The rig file
states the kind of the input."""
_CART = re.compile("(?:x|pos|position)?(?:cart|carriage|trolley|slider|carro)(?:x|pos|position)?([cm]?m)?")
_PLACE = re.compile("(?:x|pos|position)([cm]?m)?")
"""Pattern of ambiguous names for the position of a cart: they may also denote angles or points. They are used only if
no column has an unambiguous name."""
_HEIGHT = re.compile("y([cm]?m|px|pixels?)?")
"""Pattern of the height of a point. A cart has no height, so a column x in a table with a height belongs to a
tracked point."""
_METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}
_ANGLES = {"rad": 1.0, "deg": 180 / math.pi}


@dataclass(frozen=True, slots=True)
class InputSettings:
    """Length of the arm that represents a cart, and minimum input of a driven arm."""

    rail_m: float = 10.0
    """Length of the arm that represents a cart, m. At 1 m/s the arm turns at 0.1 rad/s; g / L1 is more than a thousand
    times the square of this speed."""
    least_input: float = 1e-9
    """Minimum peak input of a driven arm, SI."""


SETTINGS = InputSettings()


@dataclass(frozen=True, slots=True)
class KnownInputs:
    """Columns of the known torques of both joints, or of a driven arm's input."""

    pairs: Pairs
    """Names of two columns for each kind of input: the torques of both joints or, for a driven arm, the input of the
    arm and `PASSIVE`. Empty for a free swing."""
    factors: tuple[float, float]
    """Factor of each column from the unit in its name to the SI unit."""
    motor: MotorTable | None = None
    """Motor of a driven arm; None if the columns are joint torques."""
    rods: int = 2
    """Number of mounted rods."""

    def torques(self, columns: Mapping[str, Array], t: Array, rows: NDArray[np.intp]) -> dict[str, Array]:
        """Return the inputs (k, 2) of the kept rows by kind, SI.

        Args:
            columns: values of all rows by column name
            t: times of all rows, s
            rows: (k,) indices of the kept rows
        """
        return {
            kind: np.stack([held_torque(t, columns[name], rows) for name in pair], axis=1) * self.factors
            for kind, pair in self.pairs.items()
        }

    def refuse_silent(self, columns: Mapping[str, Array], rows: NDArray[np.intp], path: object) -> None:
        """Check that the input of a driven arm is not negligible.

        Raises:
            RunError: the input is zero in all rows, or too small for a drive.
        """
        if self.motor is None:
            return
        name = self.pairs[""][0]
        largest = float(np.nanmax(np.abs(columns[name][rows] * self.factors[0]), initial=0.0))
        if largest == 0.0:
            raise RunError(f"{path}: the input {name!r} is zero throughout: the arm was not driven; use --arm free")
        if largest < SETTINGS.least_input:
            raise RunError(
                f"{path}: the input {name!r} never exceeds {largest:.2g}, which is too little for a drive: state the"
                " column of the input (--columns input=NAME) or its factor to SI units (--scale input=FACTOR), or"
                " use --arm free"
            )

    def notes(self) -> list[str]:
        """Compose notes for the operator about the interpretation of the columns."""
        if not self.pairs:
            return []
        if self.motor is not None:
            name = self.pairs[""][0]
            driven = f"the arm is driven by the {self.motor.input} in column {name}, each value held until the next row"
            return [driven, *_gain_note(self.motor)]
        passive = {
            f"joint {j}"
            for pair in self.pairs.values()
            for j, name in enumerate(pair[: self.rods], 1)
            if name == PASSIVE
        }
        return [
            f"driven by {' and '.join(self.pairs) or 'known'} torques, each held until the next row",
            *(f"{joint} has no torque column: treated as passive, with a torque of zero" for joint in passive),
        ]


def known_inputs(
    recorded: Sequence[str], others: Sequence[str] | Mapping[str, int], rig: Rig, options: ImportOptions, path: object
) -> KnownInputs:
    """Find the known inputs in the columns of a table.

    Args:
        recorded: names of the columns with numbers
        others: names of columns of another length
        rig: rig of the recording
        options: import options; `options.arm` is the mode of the arm
        path: path of the table

    Raises:
        RunError: a column does not exist, is ambiguous, or does not fit the mode of the arm.
    """
    alone = rig.rods.number == 1 and options.arm == "clamped"
    pairs = find_torques([*recorded, *others], options.torque, options.columns, path, alone=alone)
    if pairs and options.arm in ("free", "driven"):
        raise RunError(f"{path}: torques of joints 1 and 2 are not supported with a moving arm: use --torque none")
    if options.arm != "driven":
        factors = (options.scale.get(JOINTS[0], 1.0), options.scale.get(JOINTS[1], 1.0))
        return KnownInputs(pairs, factors, rods=rig.rods.number)
    assert rig.motor is not None
    name, factor = find_input(recorded, rig.motor, options.columns.get("input"), path)
    return KnownInputs({"": (name, PASSIVE)}, (factor * options.scale.get("input", 1.0), 1.0), rig.motor)


def stated_arm(
    rig: Rig, options: ImportOptions, path: object, angles: Mapping[str, str], names: Sequence[str]
) -> ImportOptions:
    """Complete the modes of arm and inner rod in import options.

    A mode that is not stated is that of the rig file.

    Args:
        rig: the recorded rig
        options: import options
        path: path of the table
        angles: name of the column of each angle
        names: names of all columns

    Raises:
        RunError: a mode is not possible for this rig, or the column of the arm's angle is missing.
    """
    mode, inner = options.arm or rig.arm.mode, options.inner or rig.joints.inner
    try:
        refuse_impossible_arm(rig, mode)
        refuse_impossible_inner(rig, inner, mode)
    except ValueError as error:
        raise RunError(f"{path}: {error}") from error
    if mode != "clamped" and "theta0" not in angles:
        raise RunError(
            f"{path}: a {mode} arm needs its angle: name its column, for example --columns theta0=NAME. The table has:"
            f" {listed(names)}"
        )
    if "input" in {*options.columns, *options.scale} and mode != "driven":
        raise RunError(f"{path}: an input column requires a driven arm, but this arm is {mode}: add --arm driven")
    return replace(options, arm=mode, inner=inner)


def find_input(names: Sequence[str], motor: MotorTable, stated: str | None, path: object) -> tuple[str, float]:
    """Find the column of a driven arm's input, and its factor to SI units.

    Args:
        names: names of the columns
        motor: kind of the input
        stated: name of the column, if stated
        path: path of the table

    Raises:
        RunError: no column or more than one column matches.
    """
    units = _UNITS[motor.input]
    matches = _columns_of(motor.input, names)
    if stated is not None and stated not in names:
        raise RunError(f"{path}: no column is named {stated!r} (input); the table has: {listed(names)}")
    chosen = list(matches or _matching(_UNNAMED, names)) if stated is None else [stated]
    if len(chosen) != 1:
        which = f"could be any of {', '.join(chosen)}" if chosen else "was not found"
        raise RunError(
            f"{path}: the {motor.input} that drives the arm {which}: name its column, for example --columns"
            f" input=NAME{'' if chosen else _other_input(names, motor)}. The table has: {listed(names)}"
        )
    match = matches.get(chosen[0])
    return chosen[0], units[match[1]] if match is not None and match[1] else 1.0


def _columns_of(kind: str, names: Sequence[str]) -> dict[str, re.Match[str]]:
    """Return the columns whose names denote a kind of input, with their matches."""
    return _matching(f"{_KIND}(?:{_NAMES[kind]})0?{_KIND}({'|'.join(_UNITS[kind])})?", names)


def _matching(pattern: str, names: Sequence[str]) -> dict[str, re.Match[str]]:
    matches = {name: re.fullmatch(pattern, bare(name)) for name in names}
    return {name: match for name, match in matches.items() if match is not None}


def _other_input(names: Sequence[str], motor: MotorTable) -> str:
    """Return advice if a table contains an input of another kind than the rig file; otherwise an empty text."""
    for kind, constant in (("torque", ""), ("current", ", with kt if it is known"), ("voltage", ", with kt and R")):
        columns = _columns_of(kind, names) if kind != motor.input else {}
        for name in columns:
            return f'; if the input is the {kind} in column {name}, set input = "{kind}" in [motor]{constant}'
    return ""


def _gain_note(motor: MotorTable) -> list[str]:
    """Return a note if the rig file lacks a constant that converts the input to a torque; otherwise an empty list."""
    needed = {"current": ("kt",), "voltage": ("kt", "R")}.get(motor.input, ())
    missing = [name for name in needed if getattr(motor, name) is None]
    if not missing:
        return []
    return [
        f"[motor] of the rig file has no {', '.join(missing)}: the torque per {motor.input} is therefore fitted. The"
        " recordings cannot show an error of this factor, and absolute sizes need measured masses"
    ]


def unused_input(names: Sequence[str], mode: str | None) -> list[str]:
    """Return a note for each column of a drive input that is unused because the arm is free."""
    if mode != "free":
        return []
    words = "|".join(_NAMES[kind].split("|")[0] for kind in ("torque", "current", "voltage"))
    unused = _matching(f"{_KIND}(?:{words})0?{_KIND}", names)
    return [f"column {name} is not used, because the arm is free; if it is driven, use --arm driven" for name in unused]


def cart_note(
    table: Table, used: Mapping[str, str], rig: Rig, options: ImportOptions
) -> tuple[list[str], Array | None]:
    """Return a note on the import of a cart, and the position of the cart (n,), m.

    The note is omitted, and the position is None, unless an unused column contains the position of a cart.

    A cart at the position x is represented by an arm of the length R that turns by theta_0 = -x / R. The pivot of the
    rod then has the acceleration of the cart, because the terms with the squared speed of the arm vanish for a long
    arm.

    Args:
        table: the table
        used: name of the column of each quantity
        rig: the recorded rig
        options: import options, which contain the unit of the angles and the mode of the arm
    """
    if rig.rods.number != 1 or options.arm != "clamped" or options.unit not in _ANGLES or table.settled:
        return [], None
    tracked = any(_HEIGHT.fullmatch(bare(name)) and varies(column) for name, column in table.named)
    free = {
        name: match
        for name, column in table.named
        if name not in used.values() and varies(column) and not (tracked and bare(name).startswith("x"))
        for pattern in (_CART, _PLACE)
        if (match := pattern.fullmatch(bare(name)))
    }
    carts = {name: match for name, match in free.items() if match.re is _CART} or free
    if len(carts) != 1:
        return [], None
    ((name, match),) = carts.items()
    metres = _METRES[match[1] or "m"]
    note = (
        f"column {name} is not used. If it is the position of a cart that carries the rod, describe the rail as a long"
        f' arm: L0 = {SETTINGS.rail_m:g} in [rig], mode = "prescribed" in [arm]. Then import with --columns'
        f" theta0={name},theta1={used['theta1']} --scale theta0={-metres / SETTINGS.rail_m * _ANGLES[options.unit]:.4g}"
        + ("" if match[1] else " (for metres)")
    )
    return [note], metres * table.column(name)
