"""Find installed plugins without importing them."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import EntryPoint, distributions
from pathlib import Path

GROUPS = ("effects", "readers", "transports", "searches", "exports")
"""Groups of plugins: tables to which a plugin can add rows."""

OFF = "DPR_LAB_NO_PLUGINS"
"""Environment variable that disables all plugins unless it is empty."""


@dataclass(frozen=True, slots=True)
class Plugin:
    """Entry point of an installed package that adds rows to a table."""

    group: str
    name: str
    module: str
    package: str
    """Name of the package on the package index."""
    version: str
    entry: EntryPoint

    def __str__(self) -> str:
        return f"{self.name} of {self.package} {self.version}"


def announced() -> tuple[Plugin, ...]:
    """List all installed plugins, sorted by package and name.

    The list is empty while plugins are disabled.
    """
    return () if os.environ.get(OFF) else _installed()


def packages() -> tuple[str, ...]:
    """Return the name and version, `NAME VERSION`, of each package with plugins."""
    return tuple(sorted({f"{plugin.package} {plugin.version}" for plugin in announced()}))


@cache
def _installed() -> tuple[Plugin, ...]:
    plugins: dict[tuple[str, str, str], Plugin] = {}
    names: set[str] = set()
    for distribution in distributions(path=_import_folders()):
        name = str(distribution.metadata["Name"]) if _mentions_us(distribution.read_text("entry_points.txt")) else ""
        if not name or name in names:  # if several packages have one name, Python imports the first on its path
            continue
        names.add(name)
        for entry in distribution.entry_points:
            group = entry.group.removeprefix("dpr_lab.")
            if entry.group != group and group in GROUPS:
                key = (group, name, entry.name)
                plugins[key] = Plugin(group, entry.name, entry.module, name, distribution.version, entry)
    return tuple(plugins[key] for key in sorted(plugins))


def _mentions_us(entry_points: str | None) -> bool:
    return entry_points is not None and "[dpr_lab." in entry_points


def _import_folders() -> list[str]:
    """Return the folders of installed packages: all folders of `sys.path` except the current one."""
    try:
        current = Path.cwd()
    except OSError:  # the folder was removed
        return [folder for folder in sys.path if folder]
    return [folder for folder in sys.path if folder and Path(folder).absolute() != current]


@contextmanager
def without_current_folder() -> Iterator[None]:
    """Remove the current folder from `sys.path` (context manager).

    `python -m` and `python -c` insert it there.
    """
    before = list(sys.path)
    first = sys.path[:1] if sys.flags.safe_path else [f for f in sys.path[:1] if f in _import_folders()]
    sys.path[:] = first + [folder for folder in before[1:] if folder]
    try:
        yield
    finally:
        sys.path[:] = before
