"""Bytecode of installed libraries that lie there as source alone: kept in the cache, as compiled kernels are.

Some installers write no bytecode, and containers often forbid it (PYTHONDONTWRITEBYTECODE). Without it each start
compiles a thousand modules, which takes longer than to run them.
"""

import importlib.util
import os
import sys
from contextlib import suppress
from pathlib import Path

LARGEST = "numba"
"""The library whose bytecode stands for that of all: most of the time goes to it."""


def keep_bytecode() -> None:
    """Read and write bytecode in this user's cache folder, where the installation has none and may write none.

    Nothing changes where PYTHONPYCACHEPREFIX names a folder, or where no folder of this user's can be written.
    """
    if sys.pycache_prefix is not None or _has_bytecode():
        return
    from platformdirs import user_cache_path

    from dpr_lab.kernel_cache import open_cache

    with suppress(OSError):
        folder = open_cache(user_cache_path("dpr-lab") / "bytecode", str(sys.implementation.cache_tag))
        if folder is not None:
            sys.pycache_prefix, sys.dont_write_bytecode = str(folder), False
            os.environ["PYTHONPYCACHEPREFIX"] = str(folder)  # of processes that this one starts


def _has_bytecode() -> bool:
    """Whether the libraries' bytecode lies next to their source, or will after this start."""
    library = importlib.util.find_spec(LARGEST)
    if library is None or library.origin is None:
        return True
    compiled = Path(importlib.util.cache_from_source(library.origin))
    writable = os.access(compiled.parent if compiled.parent.exists() else compiled.parent.parent, os.W_OK)
    return compiled.exists() or (writable and not sys.dont_write_bytecode)
