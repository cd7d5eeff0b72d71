"""Blind trial in a folder: draw, record, diagnose, reveal and score a plant."""

from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.errors import RunError
from dpr_lab.workflows.capture import capture
from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.diagnose import DiagnoseRequest, DiagnoseResult, diagnose
from dpr_lab.workflows.events import CaptureDone, OnEvent, TrialSealed, ignore

if TYPE_CHECKING:
    from dpr_lab.trials.protocol import Trial
    from dpr_lab.trials.sealing import PlantRequest


def draw(plant: "PlantRequest", folder: Path, on_event: OnEvent = ignore) -> "Trial":
    """Draw and seal a plant, and record one release per pose through the protocol.

    The folder must not already contain a trial.

    Events: `TrialSealed`, then `CaptureDone` for each recording.

    Raises:
        DprError: the folder contains a trial already, the kind is unknown, or a recording failed.
    """
    from dpr_lab.acquisition.capture import CaptureOptions
    from dpr_lab.trials.protocol import DEVICE, RIG_FILE, keep_runs
    from dpr_lab.trials.sealing import seal

    check_folder_writable(folder)
    if folder.exists() and any(folder.iterdir()):
        raise RunError(f"{folder}: is not empty; use a separate folder for each trial")
    sealed = seal(plant, folder / DEVICE)
    on_event(TrialSealed(sealed["seal"]))
    (folder / RIG_FILE).write_text(sealed["rig"], encoding="utf-8")
    recorded = capture(
        str(folder / RIG_FILE),
        folder / "runs",
        CaptureOptions(),
        confirm=lambda: True,
        url="sim://?clock=fast&plant=sealed",
        on_event=lambda event: on_event(event) if isinstance(event, CaptureDone) else None,
    )
    return keep_runs(folder, sealed["seal"], plant, recorded.files)


def diagnose_trial(folder: Path, model: Path | None = None, on_event: OnEvent = ignore) -> DiagnoseResult:
    """Diagnose a sealed trial and write the diagnosis.

    `model` is an identified model that provides initial values; None: values of the rig file. See `diagnose` for the
    events.

    Raises:
        RunError: the folder contains no trial, or the trial is already open.
        DprError: see `diagnose`.
    """
    from dpr_lab.trials.protocol import RIG_FILE, keep_diagnosis, read_trial, refuse_opened

    trial = read_trial(folder)
    refuse_opened(trial)
    request = DiagnoseRequest(trial.runs, str(folder / RIG_FILE), model=model, out=folder / "diagnosis")
    diagnosed = diagnose(request, on_event)
    keep_diagnosis(trial, diagnosed.diagnosis.to_json())
    return DiagnoseResult(diagnosed.diagnosis, {**diagnosed.files, "diagnosis": str(trial.diagnosis)})
