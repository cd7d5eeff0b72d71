"""Options of `dpr-lab import table` as text on the screen."""

import argparse
import shlex
from collections.abc import Callable, Mapping
from typing import Any, Literal, NoReturn, get_args, get_origin

from dpr_lab.errors import RunError
from dpr_lab.rig_tables import Rods
from dpr_lab.storage.tables.options import ImportOptions, TypedOption, typed_options


def parse_options(text: str) -> tuple[ImportOptions, dict[str, str]]:
    """Parse options such as `--angles relative --unit deg --columns t=time`.

    The result is the options of the import, and the stated mounting: `rods` and `elbow`.

    Raises:
        RunError: an unknown option or an invalid value.
    """
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise RunError(f"a quotation mark is missing: {text}") from error
    typed = vars(_parser().parse_args(words))
    mounting = {name: typed.pop(name) for name in ("rods", "elbow") if name in typed}
    try:
        return ImportOptions(**typed), mounting
    except ValueError as error:
        raise RunError(str(error)) from error


def option_list() -> list[str]:
    """Return each option with its choices as text, for example `--angles absolute|relative`."""
    return [_shown(action) for action in _parser()._actions]


class _Parser(argparse.ArgumentParser):
    """Parser that raises a `RunError` instead of printing a message."""

    def error(self, message: str) -> NoReturn:
        raise RunError(message.replace("unrecognized arguments", "no such option"))


def _parser() -> _Parser:
    """Create a parser with an option for every field of `ImportOptions`.

    Further options state the mounted rods and joint 2.
    """
    parser = _Parser(add_help=False, allow_abbrev=False, argument_default=argparse.SUPPRESS)
    for option in typed_options():
        flag = f"--{option.name.replace('_', '-')}"
        if option.kind is bool:
            parser.add_argument(flag, dest=option.name, action="store_true")
        elif get_origin(option.kind) is Literal:
            parser.add_argument(flag, dest=option.name, choices=get_args(option.kind))
        else:
            parser.add_argument(flag, dest=option.name, type=_reader(option), metavar=_metavar(option.kind))
    parser.add_argument("--rods", choices=get_args(Rods.model_fields["mounted"].annotation))
    parser.add_argument("--elbow", choices=get_args(Rods.model_fields["elbow"].annotation))
    return parser


def _reader(option: TypedOption) -> Callable[[str], Any]:
    """Create a function that converts an option; the parser reports invalid text."""
    if not option.reads_text:
        return option.kind

    def read(text: str) -> Any:
        try:
            return option.read(text)
        except ValueError as error:
            raise argparse.ArgumentTypeError(str(error)) from error

    return read


def _metavar(kind: Any) -> str:
    if get_origin(kind) is Mapping:
        return "NUMBER|AXIS=NUMBER,..." if get_args(kind)[1] is float else "AXIS=NAME,..."
    return {float: "NUMBER", str: "TEXT"}.get(kind, "NAME,...")


def _shown(action: argparse.Action) -> str:
    if action.choices:
        return f"{action.option_strings[0]} {'|'.join(action.choices)}"
    return f"{action.option_strings[0]} {action.metavar}" if action.metavar else action.option_strings[0]
