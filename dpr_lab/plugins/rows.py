"""Load the rows that plugins add to the tables of dpr-lab."""

import sys
import traceback
from collections.abc import Callable, Collection
from pathlib import Path
from typing import TypeVar

from dpr_lab.plugins.installed import Plugin, announced, without_current_folder

Row = TypeVar("Row")

_skipped: dict[Plugin, str] = {}
_origins: dict[tuple[str, str], Plugin] = {}


def skipped() -> tuple[str, ...]:
    """List messages for the skipped plugins, each with the reason why the plugin was skipped."""
    return tuple(f"plugin {plugin} is skipped: {reason}" for plugin, reason in _skipped.items())


def reason_skipped(plugin: Plugin) -> str:
    """Return the reason why a plugin was skipped.

    The text is empty if the plugin was not skipped, or if its table has not been used yet.
    """
    return _skipped.get(plugin, "")


def origin(group: str, row: str) -> Plugin | None:
    """Return the plugin that added a row to a table, otherwise None."""
    return _origins.get((group, row))


def failure(error: BaseException) -> str:
    """Describe an exception of a plugin or its libraries; the text is empty for any other exception."""
    by_module = {plugin.module.partition(".")[0]: plugin for plugin in announced()}
    for frame, line in reversed(list(traceback.walk_tb(error.__traceback__))):
        root = str(frame.f_globals.get("__name__", "")).partition(".")[0]
        if root in by_module:
            place = f"{Path(frame.f_code.co_filename).name}, line {line}"
            plugin = by_module[root]
            return (
                f"plugin {plugin.package} {plugin.version} failed ({place}): {type(error).__name__}: {error}: update or"
                " remove it, or use --no-plugins"
            )
        if root == "dpr_lab":
            return ""
    return ""


def plugin_rows(
    group: str,
    kind: type[Row],
    taken: Collection[str],
    name_of: Callable[[str, Row], str] = lambda name, row: name,
    refusal: Callable[[Row], str] = lambda row: "",
) -> dict[str, Row]:
    """Load the rows that plugins add to a table, by their names.

    Args:
        group: name of the table, one of `GROUPS`
        kind: class of the rows
        taken: names of the table's own rows, which no plugin may replace
        name_of: function that returns the name of a row, from the name of its entry point and the row
        refusal: function that returns the reason why a row cannot be used; empty if the row can be used
    """
    added: dict[str, Row] = {}
    for plugin in announced():
        if plugin.group != group:
            continue
        try:
            named = {name_of(plugin.name, row): row for row in _load(plugin, kind)}
        except Exception as error:  # a plugin may raise any exception
            _skipped[plugin] = _reason(plugin, error)
            continue
        reasons = [f"{name!r} exists already" for name in named if name in taken or name in added]
        reasons += [f"{name!r}: {reason}" for name, row in named.items() if (reason := refusal(row))]
        if reasons:
            _skipped[plugin] = "; ".join(reasons)
            continue
        added |= named
        _origins.update({(group, name): plugin for name in named})
    return added


def _load(plugin: Plugin, kind: type[Row]) -> tuple[Row, ...]:
    """Import a plugin and return its rows.

    Raises:
        TypeError: the object of the plugin is not a row of this kind, or a tuple of such rows.
    """
    with without_current_folder():
        value = plugin.entry.load()
    several: tuple[object, ...] = tuple(value) if isinstance(value, list | tuple) else (value,)
    loaded = tuple(row for row in several if isinstance(row, kind))
    if len(loaded) < len(several) or not loaded:
        raise TypeError(f"{plugin.entry.value} is not {kind.__name__} or a tuple of {kind.__name__}")
    return loaded


def _reason(plugin: Plugin, error: Exception) -> str:
    module = sys.modules.get(plugin.module)
    if module is not None and getattr(module.__spec__, "_initializing", False):
        return (
            f"it was imported before the table of {plugin.group}: import the package of the table first, and use a"
            " separate module for the rows of each table"
        )
    if isinstance(error, ImportError) and "partially initialized" in str(error):
        root = plugin.module.partition(".")[0]
        *_, (frame, line) = (
            (frame, line)
            for frame, line in traceback.walk_tb(error.__traceback__)
            if str(frame.f_globals["__name__"]).partition(".")[0] == root
        )
        return (
            f"{Path(frame.f_code.co_filename).name}, line {line} imports a module that needs the table of"
            f" {plugin.group}, which is not complete yet: import as the template package does, and use a separate"
            " module for the rows of each table"
        )
    return f"{type(error).__name__}: {error}"
