"""Identify the installed plugins by a text, for caches that depend on plugin code."""

import hashlib
import importlib.util
from functools import cache
from pathlib import Path

from dpr_lab.plugins.installed import announced, without_current_folder


def fingerprint(*groups: str) -> str:
    """Return one line per plugin in some groups: name, version, source hash.

    The text is empty without plugins.
    """
    used = sorted({(p.package, p.version, p.module.partition(".")[0]) for p in announced() if p.group in groups})
    return "".join(f"{package} {version} {module} {_source_hash(module)}\n" for package, version, module in used)


@cache
def _source_hash(module: str) -> str:
    """Hash the Python files of a module by SHA-256, without importing it."""
    digest = hashlib.sha256()
    with without_current_folder():
        try:
            spec = importlib.util.find_spec(module)
        except (ImportError, ValueError):
            spec = None
    files: list[Path] = []
    if spec is not None and spec.submodule_search_locations:
        files = sorted(file for folder in spec.submodule_search_locations for file in Path(folder).rglob("*.py"))
    elif spec is not None and spec.origin and Path(spec.origin).is_file():
        files = [Path(spec.origin)]
    for file in files:
        digest.update(f"{file.name}\0".encode() + file.read_bytes() + b"\0")
    return digest.hexdigest()
