"""Compiled kernels: `njit` with a disk cache that cannot return an outdated answer.

Numba's own cache looks only at the file of the function it compiles. A kernel that calls a function of another file
keeps its old machine code when that other file changes. Here the cache lies in a folder named by a hash of every
kernel source, so any change starts an empty one.
"""

import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, TypeVar, overload

import numba
import numba.core.config as numba_config
from platformdirs import user_cache_path

# Threads that wait by spinning make a parallel kernel slower than a serial one wherever something else runs too. OpenMP
# reads this when the first parallel kernel starts.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

KERNEL_SOURCES = ("kernels.py", "effects", "dynamics", "estimation/likelihood.py", "gap/along.py", "gap/response.py")
"""Every file or folder of this package that holds a compiled function."""

KEPT = 4
PRUNE_AFTER_S = 7 * 86400.0  # another process may still be writing to a folder that is not ours

Function = TypeVar("Function", bound=Callable[..., Any])


def source_hash(package: Path, sources: Iterable[str] = KERNEL_SOURCES) -> str:
    """Hash of the names and bytes of all kernel sources under `package`."""
    digest = hashlib.sha256()
    for source in sources:
        path = package / source
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(f"{file.relative_to(package).as_posix()}\0".encode())
            digest.update(file.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def prune(root: Path, now: float) -> None:
    """Remove the cache folders under `root` that are neither among the newest `KEPT` nor of the last week."""
    aged = sorted(((folder.stat().st_mtime, folder) for folder in root.iterdir() if folder.is_dir()), reverse=True)
    for modified, folder in aged[KEPT:]:
        if now - modified > PRUNE_AFTER_S:
            shutil.rmtree(folder, ignore_errors=True)


def open_cache(root: Path, name: str) -> Path | None:
    """The folder `name` under `root`, made and marked as used; None where nothing can be written."""
    folder = root / name
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
        os.utime(folder)
    except OSError:
        return None
    with suppress(OSError):  # two processes may prune at once
        prune(root, time.time())
    return folder


_ROOT = Path(os.environ.get("NUMBA_CACHE_DIR") or user_cache_path("dpr-lab")) / "kernels"
CACHE = open_cache(_ROOT, source_hash(Path(__file__).parent))
"""Folder of the machine code of this version; None on a read-only home: kernels are then compiled in every process."""


@overload
def njit(function: Function) -> Function: ...
@overload
def njit(*, parallel: bool = False, inline: str = "never") -> Callable[[Function], Function]: ...
def njit(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """`numba.njit` for every kernel: cached, IEEE strict, without the GIL, division by zero giving inf or nan.

    Strict means no reassociation and no contraction, so that a result has the same bits for any batch size and any
    number of threads.
    """
    if function is None:
        return partial(njit, **options)
    compiled = partial(numba.njit, error_model="numpy", nogil=True, **options)
    if CACHE is None:
        return compiled()(function)
    # Numba reads the folder while it decorates; other libraries' kernels keep the folder they had.
    config: Any = numba_config
    before, config.CACHE_DIR = config.CACHE_DIR, str(CACHE)
    try:
        return compiled(cache=True)(function)
    finally:
        config.CACHE_DIR = before
