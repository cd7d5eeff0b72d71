"""Files that are read only where they are regular, and written whole or not at all."""

import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from dpr_lab.errors import DprError

SPECIAL = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
"""What a reader would wait for, by the kind of its file."""


def regular(path: Path, error: type[DprError] = DprError) -> Path:
    """Give back a path that can be opened without waiting: a regular file, a folder, or nothing yet.

    Args:
        path: of an input
        error: what is raised

    Raises:
        DprError: a pipe, a socket or a device, whose content may never come or end.
    """
    try:
        kind = SPECIAL.get(stat.S_IFMT(path.stat().st_mode))
    except OSError:  # nothing there, or not to be looked at: whoever opens it says so
        return path
    if kind is not None:
        raise error(f"{path}: is {kind}, not a file: save what it delivers in a file first")
    return path


def write_whole(path: Path, write: Callable[[Path], object], error: type[DprError] = DprError) -> None:
    """Make the folder of `path` and let `write` fill a temporary file in it, which then replaces `path`.

    Args:
        path: the file
        write: fills the file that it is given, of the same suffix
        error: what is raised

    Raises:
        DprError: the folder or the file cannot be written.
    """
    fresh = path.with_name(f"new.{path.name}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(fresh)
        fresh.replace(path)
    except OSError as refused:
        raise error(f"{path}: cannot be written: {refused.strerror or refused}; choose another folder") from refused
    finally:
        with suppress(OSError):
            fresh.unlink(missing_ok=True)


def write_text(path: Path, text: str, error: type[DprError] = DprError) -> None:
    """The same for text, in UTF-8 with plain line ends.

    Raises:
        DprError: the folder or the file cannot be written.
    """
    write_whole(path, lambda file: file.write_text(text, encoding="utf-8", newline="\n"), error)
