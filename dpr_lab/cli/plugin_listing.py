"""Help of a command, with the installed plugins that extend one of its options."""

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
"""Command -> table of `dpr_lab.plugins.installed.GROUPS`, and heading of the list."""


class PluginListing(TyperCommand):
    """A command whose help ends with these plugins, which are not imported."""

    def format_epilog(self, ctx: Any, formatter: Any) -> None:
        """Write the list, if there are any."""
        super().format_epilog(ctx, formatter)
        group, heading = EXTENDED.get(self.name or "", ("", ""))
        rows = [(plugin.name, f"{plugin.package} {plugin.version}") for plugin in announced() if plugin.group == group]
        if rows:
            with formatter.section(heading):
                formatter.write_dl(rows)
