"""Results into files, whole or not at all, with an error that an operator can act on."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from dpr_lab.errors import DprError
from dpr_lab.report.plain import as_json


def write_to(path: Path, write: Callable[[Path], object]) -> None:
    """Make the folder of `path` and let `write` fill the file.

    Raises:
        DprError: the folder or the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path)
    except OSError as error:
        why = error.strerror or error
        raise DprError(f"{path}: cannot be written: {why}; choose another folder") from error


def write_json(result: Mapping[str, Any], path: Path) -> None:
    """Write a JSON object whole or not at all; numbers that are not finite become null.

    Raises:
        DprError: the folder or the file cannot be written.
    """

    def write(file: Path) -> None:
        fresh = file.with_name(f"{file.name}.new")
        fresh.write_text(as_json(result) + "\n", encoding="utf-8")
        fresh.replace(file)

    write_to(path, write)
