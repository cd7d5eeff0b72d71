"""Bytecode of installed libraries without bytecode files: stored in the cache, like compiled kernels.

Some installers write no bytecode, and containers often forbid it (PYTHONDONTWRITEBYTECODE). Without bytecode, each
start compiles a thousand modules, which takes longer than running them.
"""

import importlib.util
import os
import sys
from contextlib import suppress
from pathlib import Path

LARGEST = "numba"
"""The library whose bytecode represents that of all: it takes most of the time."""


def keep_bytecode() -> None:
    """Read and write bytecode in this user's cache folder if the installation has none and permits none.

    Nothing changes if PYTHONPYCACHEPREFIX names a folder, or if no folder of this user can be written.
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
    """Whether the bytecode of the libraries exists next to their source, or will exist after this start."""
    library = importlib.util.find_spec(LARGEST)
    if library is None or library.origin is None:
        return True
    compiled = Path(importlib.util.cache_from_source(library.origin))
    writable = os.access(compiled.parent if compiled.parent.exists() else compiled.parent.parent, os.W_OK)
    return compiled.exists() or (writable and not sys.dont_write_bytecode)
