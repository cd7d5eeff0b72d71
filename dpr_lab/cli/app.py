"""Table of all `dpr-lab` commands.

The module of a command is imported only when the command runs or its help is shown.
"""

import os
from collections import UserDict
from pkgutil import resolve_name
from typing import Any

import typer
from typer.main import get_group

from dpr_lab.cli.listing import Listing
from dpr_lab.cli.plugin_listing import PluginListing
from dpr_lab.plugins.installed import OFF
from dpr_lab.version import __version__

HELP = """Identify a double pendulum and explain why its simulation differs from the rig.

\b
Example:
  dpr-lab demo --out out/demo
  dpr-lab capture --rig paper --pose X1 --pose X2 --pose X3 --out runs
  dpr-lab identify runs/*.mcap --rig paper --out model.json
  dpr-lab compare runs/*.mcap --model model.json --out report

\b
Exit codes:
  0 ok                           6 degraded capture (file kept)
  1 failed check or test         7 device lost (partial file kept)
  2 usage                        8 identification failed its own checks
  3 configuration, input, output 9 limits not decidable with these runs
  4 device not found or busy    70 unexpected error (bug)
  5 protocol mismatch          130 interrupted (file finalised)
"""

COMMANDS = {
    "demo": "demo:demo",
    "tui": "tui:tui",
    "capture": "capture:capture",
    "identify": "identify:identify",
    "identifiability": "identifiability:identifiability",
    "compare": "compare:compare",
    "diagnose": "diagnose:diagnose",
    "check": "check:check",
    "certify": "certify:certify",
    "verify": "certify:verify",
    "drift": "drift:drift",
    "accept": "accept:accept",
    "plan": "plan:plan",
    "export": "export:export",
    "paper": "paper:paper",
    "schema": "schema:schema",
    "serve": "serve:serve",
    "doctor": "doctor:doctor",
    "conform": "conform:conform",
    "effects": "effects:app",
    "import": "import_table:app",
    "rig": "rigs:app",
    "run": "runs:app",
    "trials": "trials:app",
}
"""Location of each command in `dpr_lab.cli`, as `module:name`. The name is a function, or the `Typer` of a command
group."""

_REFUSALS = {
    "Input should be a valid number": "must be a number with a decimal point and without a unit, such as 0.25",
    "Input should be a valid integer": "must be a whole number",
}


def refusal(message: str) -> str:
    """Convert a pydantic error to a plain phrase, for example `must be a whole number`."""
    for start, words in _REFUSALS.items():
        if message.startswith(start):
            return words
    return message.removeprefix("Value error, ").replace("Input should be", "must be", 1)


class LazyCommands(UserDict[str, Any]):
    """Mapping of names to commands; each command is imported on its first access."""

    def __getitem__(self, name: str) -> Any:
        """Import and return a command.

        Raises:
            KeyError: unknown command.
        """
        command = resolve_name(f"dpr_lab.cli.{self.data[name]}")
        program = typer.Typer(rich_markup_mode=None)
        if isinstance(command, typer.Typer):
            program.add_typer(command, name=name)
        else:
            program.command(name, cls=PluginListing)(command)
        return get_group(program).commands[name]


class Program(Listing):
    """Group of all commands in the table."""

    def __init__(self, **attributes: Any) -> None:
        super().__init__(**attributes)
        self.commands = LazyCommands(COMMANDS)

    def invoke(self, ctx: Any) -> Any:
        """Run a command; a plain sentence replaces pydantic's error message for an invalid option."""
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            error.message = refusal(error.message)
            raise


app = typer.Typer(help=HELP, cls=Program, no_args_is_help=True, rich_markup_mode=None, pretty_exceptions_enable=False)


def _version(show: bool) -> None:
    if show:
        print(f"dpr-lab {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: bool = typer.Option(False, "--version", callback=_version, is_eager=True, help="Show the version."),
    no_plugins: bool = typer.Option(
        False,
        "--no-plugins",
        help="Do not load plugins of other packages. Write this option before the command, or set"
        " DPR_LAB_NO_PLUGINS=1.",
    ),
) -> None:
    if no_plugins:
        os.environ[OFF] = "1"  # also for the processes that the command starts
