"""List of the commands in the help of a group."""

from pathlib import Path
from typing import Any

import typer
from typer.core import TyperGroup

from dpr_lab.cli.checks import NO_RIG


def command_group(text: str) -> typer.Typer:
    """Create a group of commands; `text` is its help."""
    return typer.Typer(help=text, cls=Listing, no_args_is_help=True, rich_markup_mode=None)


class Listing(TyperGroup):
    """Command group whose help shows the complete first sentence of each command."""

    def invoke(self, ctx: Any) -> Any:
        """Run a command.

        If --rig is missing, the error message explains how to write a rig file.

        Raises:
            BadParameter: an argument of the command is missing or not valid.
        """
        try:
            return super().invoke(ctx)
        except typer.BadParameter as error:
            if error.param is not None and error.param.name == "rig" and not error.message:
                error.message = NO_RIG
            raise

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Find a command by its name.

        A file in place of a command is refused, with a list of commands that accept files.

        Raises:
            BadParameter: the first argument is a file.
        """
        if args[0] not in self.commands and Path(args[0]).is_file():
            names = self.list_commands(ctx)
            commands = ", ".join(names) if len(names) < 10 else f"{ctx.command_path} --help lists them"
            raise typer.BadParameter(f"{args[0]} is a file: write a command before it ({commands})", ctx)
        return super().resolve_command(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of the commands, without importing them."""
        return list(self.commands)

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the list of the commands."""
        commands = {name: self.get_command(ctx, name) for name in self.list_commands(ctx)}
        shown = {name: command for name, command in commands.items() if command is not None and not command.hidden}
        with formatter.section("Commands"):
            formatter.write_dl([(name, command.get_short_help_str(1000)) for name, command in shown.items()])
