"""Update of a diagnosis by the result of a recommended check."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.errors import RunError
from dpr_lab.gap.result import RECORD
from dpr_lab.whole_file import whole_folder
from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.diagnose import ACCEPTANCE
from dpr_lab.workflows.events import OnEvent, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from dpr_lab.gap.result.checks import AdvisedCheck
    from dpr_lab.gap.result.diagnosis import Diagnosis
    from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class CheckRequest:
    """A recommended check and its result: recordings, or a measured value."""

    diagnosis: Path
    """Output of `diagnose --json`."""
    check: str
    """Identifier of the check."""
    runs: tuple[Path, ...] = ()
    value: float | str | None = None
    """Measured value: a number in the unit of the check's quantity, or text with a unit, for example `6.1 mN m`."""
    std: float | str | None = None
    """Standard uncertainty of the value, as a number or text. Text without a unit is in the unit of the value."""
    rig: str | None = None
    """Rig file, or name of a built-in rig; None: the rig stored with the first run."""
    out: Path | None = None
    """Folder of `diagnosis.json` and its page; None: no files are written."""
    torque: str | None = None
    """`measured` or `commanded`: torques to use for runs that contain both; None: measured."""
    confirmed: bool = False
    """Whether a value that no candidate predicts is accepted."""


def take_check(request: CheckRequest, on_event: OnEvent = ignore) -> "Diagnosis":
    """Update a diagnosis with the result of a check.

    The new diagnosis names the old one as its parent. Event: `RunRead`.

    Raises:
        ConfigError: the rig is not valid, or a file with the name of the folder exists.
        RunError: there is no diagnosis or no such check, the check requires another kind of result, the diagnosis
            already used the recording, the value has no unit, or no candidate predicts the value and it is not
            `confirmed`.
        DprError: a result cannot be written.
    """
    from dpr_lab.checks.update import find_check, refuse_other_result, update
    from dpr_lab.configs import sha256_of
    from dpr_lab.gap.advice.check_kind import CheckAnswer
    from dpr_lab.gap.result.diagnosis import diagnosis_file, load_diagnosis
    from dpr_lab.rig import load_rig
    from dpr_lab.storage.reader import stored_rig

    if request.out:
        check_folder_writable(request.out)
    diagnosis = load_diagnosis(request.diagnosis)
    check = find_check(diagnosis, request.check)
    refuse_other_result(check, {name for name in ("runs", "value", "std") if getattr(request, name) not in ((), None)})
    rig, runs = None, ()
    if request.runs:
        rig = load_rig(request.rig) if request.rig else stored_rig(request.runs[0])
        runs = tuple(read_runs(request.runs, rig, on_event, torque=request.torque))
        _refuse_used(runs, diagnosis, check)
    answer = CheckAnswer(runs, rig, request.value, request.std, request.confirmed)
    updated = update(diagnosis, check, answer)
    updated = updated.model_copy(update={"parent": sha256_of(diagnosis_file(request.diagnosis))})
    if request.out:
        _save(updated, request.out)
    return updated


def _refuse_used(runs: "Sequence[Run]", diagnosis: "Diagnosis", check: "AdvisedCheck") -> None:
    """Refuse recordings of a check that were used before.

    A recording may count only once as evidence about a named effect.
    """
    recordings = diagnosis.evidence.recordings if diagnosis.evidence else []
    used = {r.sha256: f"already {'held out in' if r.held_out else 'fitted by'} this diagnosis" for r in recordings}
    checks_done = [done for done in diagnosis.checks_done if done.check.about == check.about]
    used |= {
        sha256: f"already the result of check {done.check.id}" for done in checks_done for sha256 in done.recordings
    }
    for run in runs:
        if run.sha256 and (role := used.get(run.sha256)):
            raise RunError(f"{run.file or run.name}: was {role}: record the release of the check")


def _save(diagnosis: "Diagnosis", out: Path) -> None:
    from dpr_lab.report.gap.figures import save_gap_figures
    from dpr_lab.report.gap.html import write_gap_report
    from dpr_lab.report.saving import write_json

    title = "Difference between simulation and rig, after a check"
    with whole_folder(out, RECORD, ACCEPTANCE) as folder:
        write_gap_report(diagnosis, title, folder, save_gap_figures(diagnosis, folder))
        write_json(diagnosis.to_json(), folder / RECORD)
