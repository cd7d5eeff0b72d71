"""Write a run from another file; the run file gets its final name only when it is complete."""

import os
import re
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from dpr_lab.errors import RunError
from dpr_lab.storage.metadata import RunMetadata
from dpr_lab.storage.sidecar import sidecar_of, write_sidecar
from dpr_lab.storage.writer import SETTINGS, RunWriter, exists_already

_PART = re.compile(r".+\.mcap\.\d+\.part")


@contextmanager
def whole_run(path: Path | str, metadata: RunMetadata) -> Iterator[RunWriter]:
    """Provide a writer for a run whose content is already in another file.

    The writer writes to `NAME.mcap.PROCESS.part` in the same folder, where PROCESS is the process number. The file is
    renamed at the end. Unfinished files of killed processes are removed.

    Raises:
        RunError: as for `RunWriter`.
    """
    path = Path(path)
    _refuse_existing(path)
    _remove_stale(path.parent)
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        with RunWriter(path, metadata, part=part) as writer:
            yield writer
        _publish(part, path)
    except RunError as error:
        if isinstance(refused := error.__cause__, OSError) and not isinstance(refused, FileExistsError):
            raise RunError(f"{path}: cannot be written: {refused.strerror}; choose another folder") from refused
        raise
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def _publish(part: Path, path: Path) -> None:
    """Give a complete file its final name, then write its hash file.

    If the process is killed between these two steps, the run is complete, and `dpr-lab run verify` reports the missing
    hash.
    """
    try:
        try:
            os.link(part, path)  # a link never replaces an existing file
        except FileExistsError as error:
            raise exists_already(path) from error
        except OSError:  # the file system has no hard links
            _refuse_existing(path)
            part.rename(path)
        try:
            write_sidecar(path)
        except OSError:
            path.unlink(missing_ok=True)
            sidecar_of(path).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise RunError(f"{path}: cannot be written: {error.strerror}") from error


def _refuse_existing(path: Path) -> None:
    if path.exists():
        raise exists_already(path)


def _remove_stale(folder: Path) -> None:
    with suppress(OSError):
        for file in folder.glob("*.part"):
            if _PART.fullmatch(file.name) and time.time() - file.stat().st_mtime > SETTINGS.stale_s:
                file.unlink(missing_ok=True)
