"""Blind trial in a folder: draw, record, diagnose, reveal and score a plant."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.errors import RunError
from dpr_lab.workflows.capture import CaptureRequest, capture
from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.diagnose import DiagnoseRequest, DiagnoseResult, diagnose
from dpr_lab.workflows.events import CaptureDone, Event, OnEvent, TrialSealed, ignore

if TYPE_CHECKING:
    from dpr_lab.trials.protocol import Trial
    from dpr_lab.trials.sealing import PlantRequest


@dataclass(frozen=True, slots=True)
class TrialRequest:
    """Options of a blind trial."""

    plant: "PlantRequest"
    folder: Path
    """Folder for the trial; it must not already contain a trial."""


@dataclass(frozen=True, slots=True)
class DiagnoseTrialRequest:
    """Options of the diagnosis of a trial."""

    folder: Path
    model: Path | None = None
    """Identified model that provides initial values; None: values of the rig file."""


def draw(request: TrialRequest, on_event: OnEvent = ignore) -> "Trial":
    """Draw and seal a plant, and record one release per pose through the protocol.

    Events: `TrialSealed`, then `CaptureDone` for each recording.

    Raises:
        DprError: the folder contains a trial already, the kind is unknown, or a recording failed.
    """
    from dpr_lab.acquisition.capture import CaptureOptions
    from dpr_lab.trials.protocol import DEVICE, RIG_FILE, keep_runs
    from dpr_lab.trials.sealing import seal

    folder = request.folder
    check_folder_writable(folder)
    if folder.exists() and any(folder.iterdir()):
        raise RunError(f"{folder}: is not empty; use a separate folder for each trial")
    sealed = seal(request.plant, folder / DEVICE)
    on_event(TrialSealed(sealed["seal"]))
    (folder / RIG_FILE).write_text(sealed["rig"], encoding="utf-8")
    recorded = capture(
        CaptureRequest(
            rig=str(folder / RIG_FILE),
            out=folder / "runs",
            options=CaptureOptions(),
            url="sim://?clock=fast&plant=sealed",
        ),
        confirm=lambda: True,
        on_event=lambda event: _pass_on(event, on_event),
    )
    return keep_runs(folder, sealed["seal"], request.plant, recorded.files)


def diagnose_trial(request: DiagnoseTrialRequest, on_event: OnEvent = ignore) -> DiagnoseResult:
    """Diagnose a sealed trial and write the diagnosis.

    See `diagnose` for the events.

    Raises:
        RunError: the folder contains no trial, or the trial is already open.
        DprError: see `diagnose`.
    """
    from dpr_lab.trials.protocol import RIG_FILE, keep_diagnosis, read_trial, refuse_opened

    trial = read_trial(request.folder)
    refuse_opened(trial)
    diagnosed = diagnose(
        DiagnoseRequest(
            runs=trial.runs,
            rig=str(request.folder / RIG_FILE),
            model=request.model,
            out=request.folder / "diagnosis",
        ),
        on_event,
    )
    keep_diagnosis(trial, diagnosed.diagnosis.to_json())
    return DiagnoseResult(diagnosed.diagnosis, {**diagnosed.files, "diagnosis": str(trial.diagnosis)})


def _pass_on(event: Event, on_event: OnEvent) -> None:
    if isinstance(event, CaptureDone):
        on_event(event)
