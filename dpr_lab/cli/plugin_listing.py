"""Help of commands that plugins extend, with a list of the installed plugins."""

from typing import Any

from typer.core import TyperCommand

from dpr_lab.plugins.installed import announced

EXTENDED = {
    "export": ("exports", "Formats of plugins"),
    "identify": ("searches", "Search algorithms of plugins"),
    "diagnose": ("effects", "Effects of plugins"),
    "table": ("readers", "Readers of plugins"),
    **dict.fromkeys(("capture", "conform", "doctor"), ("transports", "Links of plugins")),
}
"""Command -> group of plugins in `dpr_lab.plugins.installed.GROUPS`, and heading of their list."""


class PluginListing(TyperCommand):
    """Command whose help ends with a list of its plugins; the plugins are not imported."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the list of plugins; write nothing if no plugin is installed."""
        super().format_epilog(ctx, formatter)
        group, heading = EXTENDED.get(self.name or "", ("", ""))
        rows = [(plugin.name, f"{plugin.package} {plugin.version}") for plugin in announced() if plugin.group == group]
        if rows:
            with formatter.section(heading):
                formatter.write_dl(rows)
