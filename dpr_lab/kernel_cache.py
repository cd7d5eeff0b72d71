"""Choose the cache folder of the compiled kernels; this module does not import Numba.

Numba invalidates cached machine code only if the file of the compiled function changes. If a kernel calls a function in
another file and that file changes, the cached code is outdated but still used. Here, the name of the cache folder is a
hash of all kernel sources, including those of plugins. Any change of a source therefore leads to a new, empty folder.
"""

import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from platformdirs import user_cache_path

from dpr_lab.plugins.fingerprint import fingerprint
from dpr_lab.progress import compiling

KERNEL_SOURCES = ("kernels.py", "effects", "dynamics", "estimation", "fitting")
"""Files and folders of this package that contain compiled functions."""

KEPT = 4
"""Number of cache folders that are never removed."""

PRUNE_AFTER_S = 7 * 86400.0
"""Time since its last use after which an older cache folder is removed, s. Another process may still use a folder of
another version."""


def source_hash(package: Path, sources: Iterable[str] = KERNEL_SOURCES) -> str:
    """Hash the names and contents of all kernel sources in the folder `package`."""
    digest = hashlib.sha256()
    for source in sources:
        path = package / source
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            digest.update(f"{file.relative_to(package).as_posix()}\0".encode())
            digest.update(file.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def prune(root: Path, now: float) -> None:
    """Remove old cache folders in `root`.

    The newest `KEPT` folders and those used in the last week are kept.
    """
    aged = sorted(((folder.stat().st_mtime, folder) for folder in root.iterdir() if folder.is_dir()), reverse=True)
    for modified, folder in aged[KEPT:]:
        if now - modified > PRUNE_AFTER_S:
            shutil.rmtree(folder, ignore_errors=True)


class ForeignFolder(OSError):
    """Raised if a folder belongs to another user and may contain malicious code."""


def open_cache(root: Path, name: str) -> Path | None:
    """Create the folder `name` in `root` for this user only, and mark it as used.

    Numba loads kernels with `pickle`, which executes the content of a file. Files that another user could have written
    are therefore not loaded. A folder of this user that others could write to is emptied, and its access is restricted.

    Returns:
        The folder; None if it cannot be written.

    Raises:
        ForeignFolder: one of the two folders belongs to another user.
    """
    folder = root / name
    try:
        root.mkdir(parents=True, exist_ok=True)
        if _restrict(root) and folder.exists():
            shutil.rmtree(folder)
        folder.mkdir(mode=0o700, exist_ok=True)
        if _restrict(folder):
            shutil.rmtree(folder)
            folder.mkdir(mode=0o700)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(1 << 20))  # on a full disk a folder can still be created, but not a file
        os.utime(folder)
    except ForeignFolder:
        raise
    except OSError:
        return None
    with suppress(OSError):  # two processes may remove folders at the same time
        prune(root, time.time())
    return folder


def _restrict(folder: Path) -> bool:
    """Restrict a folder to this user and return whether others could write to it.

    Raises:
        ForeignFolder: the folder belongs to another user.
    """
    if not hasattr(os, "getuid"):  # on Windows, folders in a profile belong to its user
        return False
    status = folder.stat()
    if status.st_uid != os.getuid():
        raise ForeignFolder(f"{folder}: belongs to another user")
    open_to_others = bool(status.st_mode & 0o022)
    if open_to_others:
        folder.chmod(0o700)
    return open_to_others


def choose_cache(roots: Iterable[Path], name: str) -> tuple[Path | None, str]:
    """Open the cache folder `name` in the first possible folder of `roots`.

    Returns:
        The cache folder, or None if none can be written; and a message about skipped folders of other users, which is
        empty if there are none.
    """
    foreign = ""
    for root in roots:
        try:
            return open_cache(root, name), foreign
        except ForeignFolder as error:
            foreign = f"{error}, so its compiled kernels are not loaded, because they could contain malicious code"
    return None, foreign


def cache_name(package: Path) -> str:
    """Return the name of the cache folder: a hash of all kernel sources, with plugins."""
    added = fingerprint("effects")
    name = source_hash(package)
    return f"{name}-{hashlib.sha256(added.encode()).hexdigest()[:16]}" if added else name


_NAMED = os.environ.get("NUMBA_CACHE_DIR")
_ROOTS = [Path(folder) / "kernels" for folder in (_NAMED, user_cache_path("dpr-lab")) if folder]
CACHE, FOREIGN = choose_cache(_ROOTS, cache_name(Path(__file__).parent))
"""Folder of the machine code of this version, and a message if a folder of another user was skipped. The folder is None
if the home folder is read-only. Kernels are then compiled in every process."""

COMPILING = (f"{FOREIGN}. " if FOREIGN else "") + (
    "compiling kernels of this task, once on this computer: at most three minutes"
    if CACHE is not None
    else "compiling the kernels: one to three minutes at every start, because no cache folder can be written"
)
"""Message that is shown while kernels are compiled."""

_SIMULATOR = "plant"
"""Name of the file which states that the kernels of the simulated device are compiled."""


def simulator_compiled() -> bool:
    """Return whether the kernels of the simulated device are compiled."""
    return CACHE is not None and (CACHE / _SIMULATOR).exists()


def mark_simulator_compiled() -> None:
    """Record that all kernels of the simulated device are compiled."""
    if CACHE is not None:
        with suppress(OSError):
            (CACHE / _SIMULATOR).touch()


def compiling_simulator() -> None:
    """Notify all listeners if a simulated device is about to compile its kernels."""
    if not simulator_compiled():
        compiling()
