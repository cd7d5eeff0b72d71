"""Python bytecode in the user's cache folder, for packages installed without bytecode.

Some installers write no bytecode, and containers often forbid it (PYTHONDONTWRITEBYTECODE). Each start would then
compile a thousand modules, which takes longer than running them.
"""

import importlib.util
import os
import sys
from contextlib import suppress
from pathlib import Path

PACKAGES = ("numba", "dpr_lab")
"""Packages whose bytecode is checked: this package, and the largest library as a sample of all libraries."""


def keep_bytecode() -> None:
    """Use cached bytecode if the installation contains no bytecode and is read-only.

    The function has no effect if PYTHONPYCACHEPREFIX names a folder, or if the user has no writable cache folder.
    """
    if sys.pycache_prefix is not None or all(map(_has_bytecode, PACKAGES)):
        return
    from platformdirs import user_cache_path

    from dpr_lab.kernel_cache import open_cache

    with suppress(OSError):
        folder = open_cache(user_cache_path("dpr-lab") / "bytecode", str(sys.implementation.cache_tag))
        if folder is not None:
            sys.pycache_prefix, sys.dont_write_bytecode = str(folder), False
            os.environ["PYTHONPYCACHEPREFIX"] = str(folder)  # for the processes that this one starts


def _has_bytecode(package: str) -> bool:
    """Return whether the bytecode of a package exists next to its source, or can be written there."""
    module = importlib.util.find_spec(package)
    if module is None or module.origin is None:
        return True
    compiled = Path(importlib.util.cache_from_source(module.origin))
    writable = os.access(compiled.parent if compiled.parent.exists() else compiled.parent.parent, os.W_OK)
    return compiled.exists() or (writable and not sys.dont_write_bytecode)
