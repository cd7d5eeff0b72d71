"""Update of a diagnosis by the result of a recommended check."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.errors import RunError
from dpr_lab.gap.result import RECORD
from dpr_lab.whole_file import whole_folder
from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.diagnose import ACCEPTANCE
from dpr_lab.workflows.events import OnEvent, Warned, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from dpr_lab.gap.result.checks import AdvisedCheck
    from dpr_lab.gap.result.diagnosis import Diagnosis
    from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class ReleaseTolerance:
    """Largest differences between a recording and the recommended release without a warning."""

    angle_rad: float = 0.2
    """Largest difference of an angle, rad: a release by hand differs by less."""
    duration: float = 0.5
    """Smallest duration relative to that of the recommended release."""


TOLERANCE = ReleaseTolerance()


def take_check(
    diagnosis_path: Path,
    check_id: str,
    files: Sequence[Path] = (),
    value: float | str | None = None,
    std: float | str | None = None,
    *,
    rig_name: str | None = None,
    out: Path | None = None,
    torque: str | None = None,
    confirmed: bool = False,
    on_event: OnEvent = ignore,
) -> "Diagnosis":
    """Update a diagnosis with the result of a check: recordings, or a measured value.

    The new diagnosis names the old one as its parent.

    Args:
        diagnosis_path: output of `diagnose --json`, or the folder of a diagnosis
        check_id: identifier of the check
        files: run files
        value: measured value, a number in the unit of the check's quantity, or text with a unit, for example
            `6.1 mN m`.
        std: standard uncertainty of the value, as a number or text. Text without a unit is in the unit of the value.
        rig_name: rig file, or name of a built-in rig; None: the rig stored with the first run
        out: folder of `diagnosis.json` and its page; None: no files are written
        torque: `measured` or `commanded`: torques to use for runs that contain both; None: measured
        confirmed: whether a value that no candidate predicts is accepted
        on_event: receives `RunRead`, and `Warned` for a recording that differs from the recommended release

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

    if out:
        check_folder_writable(out)
    diagnosis = load_diagnosis(diagnosis_path)
    check = find_check(diagnosis, check_id)
    stated = {"runs": files or None, "value": value, "std": std}
    refuse_other_result(check, {name for name, result in stated.items() if result is not None})
    rig, runs = None, ()
    if files:
        rig = load_rig(rig_name) if rig_name else stored_rig(files[0])
        runs = tuple(read_runs(files, rig, on_event, torque=torque))
        _refuse_used(runs, diagnosis, check)
        for sentence in other_releases(runs, check):
            on_event(Warned(sentence))
    updated = update(diagnosis, check, CheckAnswer(runs, rig, value, std, confirmed))
    updated = updated.model_copy(update={"parent": sha256_of(diagnosis_file(diagnosis_path))})
    if out:
        _save(updated, out)
    return updated


def _refuse_used(runs: "Sequence[Run]", diagnosis: "Diagnosis", check: "AdvisedCheck") -> None:
    """Refuse recordings that were fitted or held out, or are the result of another check of the same effect.

    A recording may count only once as evidence about a named effect.

    Raises:
        RunError: a recording was used before.
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


def other_releases(runs: "Sequence[Run]", check: "AdvisedCheck") -> Iterator[str]:
    """Yield a warning for each recording that is much shorter than recommended, or released from other angles.

    Such a recording is used, but it may contain little information about the causes of the check.
    """
    release = check.release
    if release is None:
        return
    for run in runs:
        rods = 1 if run.setup.alone else 2
        start, recommended = run.swing.theta[0, 1 : rods + 1], (release.theta1_rad, release.theta2_rad)[:rods]
        apart = max(abs(math.remainder(a - b, 2.0 * math.pi)) for a, b in zip(start, recommended, strict=True))
        if apart > TOLERANCE.angle_rad or run.duration < TOLERANCE.duration * release.duration_s:
            recorded, required = (
                f"{' and '.join(f'{math.degrees(angle):.0f}' for angle in angles)} deg for {duration:.3g} s"
                for angles, duration in ((start, run.duration), (recommended, release.duration_s))
            )
            yield (
                f"warning: {run.file or run.name}: was released from {recorded}, but check {check.id} asks for"
                f" {required} (0 = upright): it may not distinguish the causes"
            )


def _save(diagnosis: "Diagnosis", out: Path) -> None:
    from dpr_lab.report.gap.figures import save_gap_figures
    from dpr_lab.report.gap.html import write_gap_report
    from dpr_lab.report.saving import write_json

    title = "Difference between simulation and rig, after a check"
    with whole_folder(out, RECORD, ACCEPTANCE) as folder:
        write_gap_report(diagnosis, title, folder, save_gap_figures(diagnosis, folder))
        write_json(diagnosis.to_json(), folder / RECORD)
