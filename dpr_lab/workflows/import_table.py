"""Import a table from any data logger as a run."""

from dataclasses import dataclass
from itertools import count, takewhile
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.errors import RunError
from dpr_lab.shown import listed
from dpr_lab.workflows.checks import with_options
from dpr_lab.workflows.events import OnEvent, ignore

if TYPE_CHECKING:
    from dpr_lab.storage.inspect import RunInfo
    from dpr_lab.storage.tables.interpreted import TableQuestion
    from dpr_lab.storage.tables.options import ImportOptions
    from dpr_lab.storage.tables.understood import Understood


@dataclass(frozen=True, slots=True)
class ImportRequest:
    """Options of an import."""

    table: Path
    """File of a format in `dpr_lab.storage.readers`, or the folder of a ROS 2 bag."""
    rig: str
    """Rig file, or the name of a built-in one."""
    out: Path
    """Folder of the run, or the run file `NAME.mcap`."""
    options: "ImportOptions"
    rods: str | None = None
    """Mounted rods; None: as in the rig file."""
    elbow: str | None = None
    """Whether joint 2 is free or clamped; None: as in the rig file."""


@dataclass(frozen=True, slots=True)
class ImportResult:
    """The written run."""

    file: Path
    samples: int
    """Number of samples, including the rest before the release."""
    duration_s: float
    """Time from the release to the last sample, s."""
    notes: tuple[str, ...]
    """Notes on the conversion of the table."""
    questions: "tuple[TableQuestion, ...]"
    """Doubts about the interpretation of the table."""

    @property
    def info(self) -> "RunInfo":
        """Metadata of the run file; reads the complete file."""
        from dpr_lab.storage.inspect import info

        return info(self.file)


def import_table(request: ImportRequest, on_event: OnEvent = ignore) -> ImportResult:
    """Import a table of angles as a run; existing runs are never overwritten.

    Event: `ImportProgress`.

    Raises:
        ConfigError: the rig is not valid.
        RunError: the table contains no angles that can be interpreted.
    """
    from dpr_lab.storage.csv_import import write_run

    target = request.out
    named = target.suffix == ".mcap" and not target.is_dir()
    file, notes = (target, ()) if named else _unused(target, request.table)
    swing = preview_table(request, on_event)
    write_run(swing, file, on_event)
    return ImportResult(file, len(swing.t), float(swing.t[-1]), (*swing.notes, *notes), swing.questions)


def preview_table(request: ImportRequest, on_event: OnEvent = ignore) -> "Understood":
    """Interpret a table without writing a run.

    Events: `ImportProgress`.

    Raises:
        ConfigError: the rig is not valid.
        RunError: the table contains no angles that can be interpreted.
    """
    from dpr_lab.rig import load_rig
    from dpr_lab.storage.tables.understand import understand

    rig = with_options(load_rig(request.rig), rods=request.rods, elbow=request.elbow)
    return understand(request.table, rig, request.options, on_event)


def _unused(folder: Path, table: Path) -> tuple[Path, tuple[str, ...]]:
    """Return an unused path for the run, and a note if runs with this name exist."""
    from dpr_lab.configs import sha256_of
    from dpr_lab.storage.csv_import import table_name

    stem = table_name(table)
    names = (f"{stem}.mcap" if number == 1 else f"{stem}-{number}.mcap" for number in count(1))
    existing = list(takewhile(Path.exists, (folder / name for name in names)))
    if not existing:
        return folder / f"{stem}.mcap", ()
    file = folder / f"{stem}-{len(existing) + 1}.mcap"
    content = sha256_of(table) if table.is_file() else None
    same = [path.name for path in existing if content and _imported_from(path) == content]
    note = f"{existing[0]} exists and is kept, so the new run is {file.name}"
    if same:
        note += f"; {listed([*same, file.name])} are from the same table: delete a run with wrong options"
    return file, (note,)


def _imported_from(file: Path) -> str:
    """Return the SHA-256 of the table of an imported run; empty if it is unknown."""
    from dpr_lab.storage.inspect import info

    try:
        return info(file).extra.get("file_sha256", "")
    except RunError:
        return ""
