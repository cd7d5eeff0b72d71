"""The options of `dpr-lab import table`, typed on the screen as they are typed in the command."""

import argparse
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from types import UnionType
from typing import Any, Literal, NoReturn, Union, get_args, get_origin, get_type_hints

from dpr_lab.errors import RunError
from dpr_lab.rig_tables import Rods
from dpr_lab.storage.csv_import import ImportOptions
from dpr_lab.storage.tables.columns import AXES

UNSAID: dict[str, Any] = {"unit": None, "time_unit": None}
"""Options that the command takes from the columns' names where they are left out."""

UNIONS = (Union, UnionType)
"""`X | None` is the first for a Literal and the second for a class."""


@dataclass(frozen=True, slots=True)
class TypedOptions:
    """What was typed."""

    options: ImportOptions
    rods: str | None
    """Which hang on the rig; as the rig file says when None."""
    elbow: str | None
    """Whether joint 2 can turn; likewise."""


def parse_options(text: str) -> TypedOptions:
    """The options of a line such as `--angles relative --unit deg --columns t=time`.

    Raises:
        RunError: an option or a value that there is not.
    """
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise RunError(f"a quotation mark is missing: {text}") from error
    typed = vars(_parser().parse_args(words))
    rods, elbow = typed.pop("rods", None), typed.pop("elbow", None)
    try:
        return TypedOptions(ImportOptions(**UNSAID | typed), rods, elbow)
    except ValueError as error:
        raise RunError(str(error)) from error


def option_list() -> list[str]:
    """Every option with its choices, one text each: `--angles absolute|relative`."""
    return [_shown(action) for action in _parser()._actions]


class _Parser(argparse.ArgumentParser):
    """Tells what is wrong with an error of ours, and prints nothing."""

    def error(self, message: str) -> NoReturn:
        raise RunError(message.replace("unrecognized arguments", "no such option"))


def _parser() -> _Parser:
    """An option for every field of `ImportOptions`, and for what hangs on the rig."""
    parser = _Parser(add_help=False, allow_abbrev=False, argument_default=argparse.SUPPRESS)
    hints = get_type_hints(ImportOptions)
    for each in fields(ImportOptions):
        _add(parser, each.name, hints[each.name])
    _add(parser, "rods", Rods.model_fields["mounted"].annotation)
    _add(parser, "elbow", Rods.model_fields["elbow"].annotation)
    return parser


def _add(parser: _Parser, name: str, hint: Any) -> None:
    flag, kind = f"--{name.replace('_', '-')}", _without_none(hint)
    if kind is bool:
        parser.add_argument(flag, dest=name, action="store_true")
    elif get_origin(kind) is Literal:
        parser.add_argument(flag, dest=name, choices=get_args(kind))
    else:
        parser.add_argument(flag, dest=name, type=_reader(kind), metavar=_metavar(kind))


def _without_none(hint: Any) -> Any:
    kinds = [kind for kind in get_args(hint) if kind is not type(None)] if get_origin(hint) in UNIONS else [hint]
    return kinds[0]


def _reader(kind: Any) -> Callable[[str], Any]:
    if get_origin(kind) is Mapping:
        return _numbers if get_args(kind)[1] is float else _pairs
    return _names if get_origin(kind) is tuple else kind


def _metavar(kind: Any) -> str:
    if get_origin(kind) is Mapping:
        return "NUMBER|AXIS=NUMBER,..." if get_args(kind)[1] is float else "AXIS=NAME,..."
    return {float: "NUMBER", str: "TEXT"}.get(kind, "NAME,...")


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(",") if name.strip())


def _pairs(text: str) -> dict[str, str]:
    pairs = [part.split("=", 1) for part in text.split(",")]
    if any(len(pair) != 2 for pair in pairs):
        raise argparse.ArgumentTypeError(f"write pairs such as theta1=NAME, not {text!r}")
    return {axis.strip(): value.strip() for axis, value in pairs}


def _numbers(text: str) -> dict[str, float]:
    pairs = _pairs(text) if "=" in text else dict.fromkeys(AXES[1:], text)
    try:
        return {axis: float(number) for axis, number in pairs.items()}
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"write a number, or theta1=NUMBER, not {text!r}") from error


def _shown(action: argparse.Action) -> str:
    if action.choices:
        return f"{action.option_strings[0]} {'|'.join(action.choices)}"
    return f"{action.option_strings[0]} {action.metavar}" if action.metavar else action.option_strings[0]
