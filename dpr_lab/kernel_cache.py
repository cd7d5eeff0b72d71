"""Folder of compiled kernels; does not import Numba.

The cache of Numba checks only the file of the compiled function. A kernel that calls a function of another file keeps
its old machine code when that other file changes. Here the cache is in a folder named by a hash of all kernel sources,
those of plugins included, so any change starts with an empty folder.
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
PRUNE_AFTER_S = 7 * 86400.0  # another process may still write to a cache folder of another version


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
    """Remove cache folders under `root`, except the newest `KEPT` and those of the last week."""
    aged = sorted(((folder.stat().st_mtime, folder) for folder in root.iterdir() if folder.is_dir()), reverse=True)
    for modified, folder in aged[KEPT:]:
        if now - modified > PRUNE_AFTER_S:
            shutil.rmtree(folder, ignore_errors=True)


class ForeignFolder(OSError):
    """A folder owned by another user, which could contain malicious code."""


def open_cache(root: Path, name: str) -> Path | None:
    """Make the folder `name` under `root`, accessible by this user only, and mark it as used.

    Numba loads kernels with `pickle`, which executes the content of a file. Files that another user could have written
    are therefore not loaded: a folder of this user that was writable by others is emptied and its access restricted.

    Returns:
        None if nothing can be written.

    Raises:
        ForeignFolder: one of both folders belongs to another user.
    """
    folder = root / name
    try:
        root.mkdir(parents=True, exist_ok=True)
        if _close(root) and folder.exists():
            shutil.rmtree(folder)
        folder.mkdir(mode=0o700, exist_ok=True)
        if _close(folder):
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


def _close(folder: Path) -> bool:
    """Restrict a folder to this user; true if others could write to it.

    Raises:
        ForeignFolder: it belongs to another user.
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
    """The first folder `name` under `roots` that belongs to this user, and a message about folders of other users.

    Returns:
        None if nothing can be written; an empty message if no folder belongs to another user.
    """
    foreign = ""
    for root in roots:
        try:
            return open_cache(root, name), foreign
        except ForeignFolder as error:
            foreign = f"{error}, so its compiled kernels are not loaded, because they could contain malicious code"
    return None, foreign


def cache_name(package: Path) -> str:
    """Name of the folder: hash of the kernel sources, and of plugins that add kernels."""
    added = fingerprint("effects")
    name = source_hash(package)
    return f"{name}-{hashlib.sha256(added.encode()).hexdigest()[:16]}" if added else name


_NAMED = os.environ.get("NUMBA_CACHE_DIR")
_ROOTS = [Path(folder) / "kernels" for folder in (_NAMED, user_cache_path("dpr-lab")) if folder]
CACHE, FOREIGN = choose_cache(_ROOTS, cache_name(Path(__file__).parent))
"""Folder of the machine code of this version, and a message if a folder of another user was skipped. None if the
home folder is read-only: kernels are then compiled in every process.
"""

COMPILING = (f"{FOREIGN}. " if FOREIGN else "") + (
    "compiling numerical kernels that this computer has not compiled yet: up to a minute"
    if CACHE is not None
    else "compiling the kernels: about a minute, every time, because no folder of the cache can be written"
)
"""The message shown while kernels are compiled."""

_SIMULATOR = "plant"


def simulator_compiled() -> bool:
    """Whether the kernels of a simulated device are compiled."""
    return CACHE is not None and (CACHE / _SIMULATOR).exists()


def mark_simulator_compiled() -> None:
    """Remember that all kernels for the motion of a plant are compiled."""
    if CACHE is not None:
        with suppress(OSError):
            (CACHE / _SIMULATOR).touch()


def compiling_simulator() -> None:
    """Notify all listeners before the start of a simulated device that compiles its kernels first."""
    if not simulator_compiled():
        compiling()
