"""Import a table from any data logger as a run."""

from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.workflows.checks import with_rods
from dpr_lab.workflows.events import OnEvent, ignore

if TYPE_CHECKING:
    from dpr_lab.storage.inspect import RunInfo
    from dpr_lab.storage.tables.interpreted import TableQuestion
    from dpr_lab.storage.tables.options import ImportOptions
    from dpr_lab.storage.tables.preview import Preview


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
    from dpr_lab.rig import load_rig
    from dpr_lab.storage.csv_import import table_name, write_run
    from dpr_lab.storage.tables.understand import understand

    target = request.out
    named = target.suffix == ".mcap" and not target.is_dir()
    file = target if named else _unused(target, table_name(request.table))
    rig = with_rods(load_rig(request.rig), request.rods, request.elbow)
    swing = understand(request.table, rig, request.options, on_event)
    write_run(request.table, rig, swing, file, on_event)
    return ImportResult(file, len(swing.t), float(swing.t[-1]), swing.notes, swing.questions)


def preview_table(request: ImportRequest, on_event: OnEvent = ignore) -> "Preview":
    """Interpret a table without writing a run.

    Events: `ImportProgress`.

    Raises:
        ConfigError: the rig is not valid.
        RunError: the table contains no angles that can be interpreted.
    """
    from dpr_lab.rig import load_rig
    from dpr_lab.storage.tables.preview import preview

    rig = with_rods(load_rig(request.rig), request.rods, request.elbow)
    return preview(request.table, rig, request.options, on_event)


def _unused(folder: Path, stem: str) -> Path:
    """Return a path in the folder that does not exist yet."""
    names = (f"{stem}.mcap" if number == 1 else f"{stem}-{number}.mcap" for number in count(1))
    return next(folder / name for name in names if not (folder / name).exists())
