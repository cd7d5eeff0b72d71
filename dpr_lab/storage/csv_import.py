"""Import the table of a logger, in any format of `dpr_lab.storage.readers`, as a run.

`dpr_lab.storage.tables.understand` interprets the table. This module creates the run or its file.
"""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from dpr_lab.configs import sha256_of
from dpr_lab.errors import RunError
from dpr_lab.progress import ImportProgress, OnImport, unwatched
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.storage.metadata import RunMetadata, RunSummary
from dpr_lab.storage.reader import load_run, run_of
from dpr_lab.storage.row_text import Samples
from dpr_lab.storage.samples import Gathered
from dpr_lab.storage.scan import Scan
from dpr_lab.storage.tables.options import AXES, ImportOptions
from dpr_lab.storage.tables.understand import understand
from dpr_lab.storage.tables.understood import Understood
from dpr_lab.storage.whole_run import whole_run


def import_csv(
    file: Path | str,
    rig: Rig,
    options: ImportOptions | None = None,
    out: Path | str | None = None,
    on_progress: OnImport | None = None,
) -> Run:
    """Read a table as a run; write a run file if `out` is given.

    The release is the row in which the rods begin to move, or the first row. It has the time t = 0. Rows at rest before
    the release have negative times.

    Args:
        file: the table, in a format of `dpr_lab.storage.readers`; columns of a text file are separated by commas,
            semicolons, tabs or blanks, and comments start with `#`, `%` or `//`
        rig: the rig on which the table was recorded
        options: interpretation of the numbers
        out: run file to write
        on_progress: function that is called while the table is read and the run is written

    Raises:
        RunError: the file is not a table of numbers, a column cannot be found, the time decreases (the message names
            the line), too many rows have no value (more than half, or 10 % if there are many consecutive ones), no row
            remains, a joint without a rod moves, the motion contradicts the unit of the angles, or the table cannot be
            a swing of the rig (`dpr_lab.storage.tables.questions`).
    """
    swing = understand(file, rig, options, on_progress or unwatched)
    if out is None:
        run = _in_memory(swing, _metadata(swing))
        return replace(run, sha256=run.readings_sha256)
    write_run(swing, out, on_progress or unwatched)
    return load_run(out)


def write_run(swing: Understood, out: Path | str, on_progress: OnImport = unwatched, block: int = 1 << 17) -> None:
    """Write an interpreted table to a run file.

    Raises:
        RunError: the file cannot be written, the motion contradicts the unit of the angles, or the motion of the arm
            cannot be prescribed.
    """
    metadata = _metadata(swing)
    _in_memory(swing, metadata)  # checked before the file is created
    with whole_run(out, metadata) as writer:
        samples, rows = _samples(swing), len(swing.theta)
        for start in range(0, rows, block):
            part = samples.rows(slice(start, start + block))
            writer.table(part.t, part.theta, part.counts, part.torques)
            on_progress(ImportProgress("write", min(start + block, rows), rows))
        writer.finish(RunSummary(release_tick=swing.release, notes=swing.remarks))


def _refuse_unit(swing: Understood) -> None:
    """Refuse a table whose motion contradicts the unit of its angles, unless the options scale the angles."""
    contradictions = [question.sentence for question in swing.questions if question.other_unit]
    if contradictions and swing.options.scale.keys().isdisjoint(AXES):
        unit = swing.options.unit
        raise RunError(f"{swing.path}: {contradictions[0]}. If the angles are in {unit} nevertheless, add --scale 1")


def _metadata(swing: Understood) -> RunMetadata:
    path, rig, options, as_dicts = swing.path, swing.rig, swing.options, ("columns", "scale", "offset")
    return RunMetadata(
        rig=rig,
        pose=options.pose,
        rate_hz=swing.rate_hz,
        source="import",
        time_source="table",
        url=path.name,
        note=options.note,
        extra={
            "file_sha256": sha256_of(path) if path.is_file() else "",
            "recorded_at": swing.recorded_at,
            "t_offset_s": repr(swing.t_offset_s),
            "columns": json.dumps(dict(swing.columns)),
            "torque_kind": next(iter(swing.torques), ""),
            "input_delay_s": repr(options.input_delay_s),
            "arm": options.arm or rig.arm.mode,
            "inner": options.inner or rig.joints.inner,
            "film_noise": "" if swing.film_noise is None else json.dumps(asdict(swing.film_noise)),
            "at_edges": "true" if swing.at_edges else "",
            "options": json.dumps(asdict(options) | {name: dict(getattr(options, name)) for name in as_dicts}),
        },
    )


def _samples(swing: Understood) -> Samples:
    n = len(swing.theta)
    torques = np.reshape([*swing.torques.values()], (len(swing.torques), n, 2))
    return Samples(np.arange(n), swing.since_first_s, swing.theta, swing.counts, torques)


def table_name(path: Path) -> str:
    """Return the run name of an imported file: the file name without suffix.

    `.csv.gz` counts as one suffix.
    """
    return Path(path.stem).stem if path.suffix.lower() == ".gz" else path.stem


def _in_memory(swing: Understood, metadata: RunMetadata) -> Run:
    """Create the run that a run file with an interpreted table would contain."""
    _refuse_unit(swing)
    stored = Scan(
        path=swing.path,
        size_bytes=0,
        sha256="",
        metadata=metadata,
        rig_sha256=metadata.rig.sha256,
        read=Gathered(_parts=[_samples(swing)]),
        summary=RunSummary(release_tick=swing.release, notes=swing.remarks),
    )
    return replace(run_of(stored), name=table_name(swing.path), file=None)
