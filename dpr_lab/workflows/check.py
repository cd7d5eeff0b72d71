"""The result of an advised check in, a new diagnosis out."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.errors import RunError
from dpr_lab.workflows.checks import refuse_file
from dpr_lab.workflows.diagnose import RECORD
from dpr_lab.workflows.events import OnEvent, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from dpr_lab.gap.result.diagnosis import Diagnosis


@dataclass(frozen=True, slots=True)
class CheckRequest:
    """Which check was done, and what it gave."""

    diagnosis: Path
    """What `diagnose --json` printed."""
    check: str
    """Id of the check."""
    runs: tuple[Path, ...] = ()
    value: float | None = None
    std: float | None = None
    rig: str | None = None
    """Rig file, or the name of a built-in one; None: as stored with the first run."""
    out: Path | None = None
    """Folder of `diagnosis.json` and its page; None: none are written."""
    torque: str | None = None
    """`measured` or `commanded`: which known torques drove the joints of runs that hold both; None: the measured."""


def take_check(request: CheckRequest, on_event: OnEvent = ignore) -> "Diagnosis":
    """Take the result of a check back: a new diagnosis that names its parent.

    Tells `RunRead`.

    Raises:
        ConfigError: the rig is not valid, or a file stands where the folder is to be.
        RunError: no diagnosis, no such check, or a result of another kind than it asks for.
        DprError: a result cannot be written.
    """
    from dpr_lab.configs import sha256_of
    from dpr_lab.gap.result.diagnosis import load_diagnosis
    from dpr_lab.gap.result.take_back import find_check, take_runs, take_value
    from dpr_lab.rig import load_rig
    from dpr_lab.storage.reader import stored_rig

    if request.out:
        refuse_file(request.out)
    diagnosis = load_diagnosis(request.diagnosis)
    check = find_check(diagnosis, request.check)
    if request.value is not None and request.std is not None:
        found = take_value(diagnosis, check, request.value, request.std)
    elif request.runs:
        rig = load_rig(request.rig) if request.rig else stored_rig(request.runs[0])
        found = take_runs(diagnosis, check, read_runs(request.runs, rig, on_event, torque=request.torque), rig)
    else:
        raise RunError(f"check {check.id} is a {check.kind} ({check.text}): give its result")
    found = found.model_copy(update={"parent": sha256_of(request.diagnosis)})
    if request.out:
        _save(found, request.out)
    return found


def _save(found: "Diagnosis", out: Path) -> None:
    from dpr_lab.report.gap.figures import save_gap_figures
    from dpr_lab.report.gap.html import write_gap_report
    from dpr_lab.report.saving import write_json

    write_gap_report(found, "Why simulation and rig differ, after a check", out, save_gap_figures(found, out))
    write_json(found.to_json(), out / RECORD)
