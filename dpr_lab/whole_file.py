"""Files that are written whole or not at all, with an error that an operator can act on."""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from dpr_lab.errors import DprError


def write_whole(path: Path, write: Callable[[Path], object], error: type[DprError] = DprError) -> None:
    """Make the folder of `path` and let `write` fill a file beside it, which then takes its place.

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
