"""List of the commands of a group."""

from typing import Any

from typer.core import TyperGroup


class Listing(TyperGroup):
    """Commands with the complete first sentence of their help, wrapped over several lines."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the list."""
        commands = {name: self.get_command(ctx, name) for name in self.list_commands(ctx)}
        shown = {name: command for name, command in commands.items() if command is not None and not command.hidden}
        with formatter.section("Commands"):
            formatter.write_dl([(name, command.get_short_help_str(1000)) for name, command in shown.items()])
