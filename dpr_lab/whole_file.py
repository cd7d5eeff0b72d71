"""Read only regular files, and write files and groups of files atomically."""

import shutil
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dpr_lab.errors import DprError, OutputError

SPECIAL = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFSOCK: "a socket",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
}
"""Names of the kinds of files on which a reader would block."""


def regular(path: Path, error: type[DprError] = DprError) -> Path:
    """Check that a path can be opened without blocking and return the path.

    Regular files, folders and missing paths are accepted.

    Args:
        path: path of an input
        error: class of the exception

    Raises:
        DprError: the path is a pipe, a socket or a device, from which reading may never end.
    """
    try:
        kind = SPECIAL.get(stat.S_IFMT(path.stat().st_mode))
    except OSError:  # the file is missing or not accessible; opening it reports the error
        return path
    if kind is not None:
        raise error(f"{path}: is {kind}, not a regular file: save its data in a file first")
    return path


def read_text(path: Path, error: type[DprError] = DprError, encoding: str = "utf-8") -> str:
    """Read a regular file as text.

    Raises:
        DprError: the path is not a regular file, or the file cannot be read.
        UnicodeDecodeError: the content is not text in this encoding.
    """
    try:
        return regular(path, error).read_text(encoding=encoding)
    except OSError as refused:
        raise error(f"{path}: cannot be read: {refused.strerror}") from refused


def not_json(error: Exception, what: str, file: str, writer: str) -> str:
    """Describe a file that is not JSON.

    Args:
        error: exception of the decoder or of the JSON parser
        what: expected content, with its article
        file: file to give instead
        writer: command that writes this file
    """
    reason = "is not a text file" if isinstance(error, UnicodeDecodeError) else f"is not valid JSON ({error})"
    return f"is not {what}, because it {reason}: give {file}, which {writer} has written"


def in_folder(path: Path, name: str) -> Path:
    """Return the path of a result.

    `path` is its file, or the folder that contains the file `name`.
    """
    return path / name if path.is_dir() else path


def write_whole(path: Path, write: Callable[[Path], object], error: type[DprError] = OutputError) -> None:
    """Write a file atomically by renaming a temporary file that `write` fills.

    The folder is created if it does not exist.

    Args:
        path: the file
        write: function that fills the file whose path it receives; the temporary file has the same suffix
        error: class of the exception

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


def write_text(path: Path, text: str, error: type[DprError] = OutputError) -> None:
    """Write a text file atomically, encoded in UTF-8, with LF line ends.

    Raises:
        DprError: the folder or the file cannot be written.
    """
    write_whole(path, lambda file: file.write_text(text, encoding="utf-8", newline="\n"), error)


@contextmanager
def whole_folder(out: Path, record: str, depends: str = "") -> Iterator[Path]:
    """Provide a temporary folder (context manager) whose files are moved to `out` at the end.

    The file `record` describes the other files. It is moved last, and an earlier `record` in `out` is removed first.
    Therefore it never describes the files of another result. If an exception ends the block, `out` keeps its former
    files, and the temporary folder `out/new.NAME` keeps only `record`, if it was written. If the files cannot be moved,
    those that were not moved remain in the temporary folder, and `out` contains no record.

    If the new files lack `depends`, an earlier file of this name in `out` belongs to the earlier record. It is renamed
    `outdated.NAME`, and an earlier file of that name is overwritten.

    Raises:
        DprError: a folder or a file cannot be written.
    """
    fresh = out / f"new.{Path(record).stem}"
    with _writing_to(out):
        shutil.rmtree(fresh, ignore_errors=True)
        fresh.mkdir(parents=True)
    try:
        yield fresh
    except BaseException:
        _remove_all_but(fresh, record)
        raise
    with _writing_to(out, f"the files that were not moved are in {fresh}"):
        (out / record).unlink(missing_ok=True)
        if (out / depends).is_file() and not (fresh / depends).exists():
            (out / depends).replace(out / f"outdated.{depends}")
        _move_all(fresh, out, record)
    shutil.rmtree(fresh, ignore_errors=True)


@contextmanager
def _writing_to(folder: Path, remedy: str = "choose another folder") -> Iterator[None]:
    try:
        yield
    except OSError as refused:
        raise OutputError(f"{folder}: cannot be written: {refused.strerror or refused}; {remedy}") from refused


def _move_all(fresh: Path, out: Path, record: str) -> None:
    files = [file.relative_to(fresh) for file in fresh.rglob("*") if file.is_file()]
    for file in sorted(files, key=lambda file: str(file) == record):
        (out / file).parent.mkdir(parents=True, exist_ok=True)
        (fresh / file).replace(out / file)


def _remove_all_but(fresh: Path, record: str) -> None:
    """Empty a temporary folder except for `record`; remove the folder if nothing remains."""
    with suppress(OSError):
        for entry in [entry for entry in fresh.iterdir() if entry.name != record]:
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
        fresh.rmdir()
