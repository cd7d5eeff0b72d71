"""A blind trial in a folder: a plant is drawn, recorded, diagnosed and revealed.

trial.json      the seal of the plant, and the names of the runs; written when all runs are complete
rig.toml        the rig file of the plant
runs/           one recording from each pose of the rig file, through the real protocol
device/         files of the device, which dpr-lab never reads
diagnosis.json  the diagnosis
opened.json     the truth, checked against the seal, and the score
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from dpr_lab.errors import RunError
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.plain import write_json
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.shown import in_command
from dpr_lab.storage.reader import load_run
from dpr_lab.trials.score import TrialOutcome, score
from dpr_lab.trials.sealing import PlantRequest, ask
from dpr_lab.trials.truth import Truth, unsealed
from dpr_lab.whole_file import regular

RIG_FILE, DEVICE = "rig.toml", "device"


@dataclass(frozen=True, slots=True)
class Trial:
    """A trial that is stored in a folder."""

    folder: Path
    seal: str
    """Seal of the plant: SHA-256 of salt and truth, in hexadecimal digits."""
    asked: str
    """Kind and level that were requested, such as `any:clear`."""
    runs: tuple[Path, ...]

    @property
    def rig(self) -> Rig:
        """Rig of the trial, read from the rig file of the plant."""
        return load_rig(self.folder / RIG_FILE)

    @property
    def diagnosis(self) -> Path:
        """Path of the file with the diagnosis."""
        return self.folder / "diagnosis.json"

    @property
    def opened(self) -> Path:
        """Path of the file with the truth and the score."""
        return self.folder / "opened.json"


@dataclass(frozen=True, slots=True)
class Opened:
    """A revealed trial."""

    truth: Truth
    diagnosis: dict[str, Any]
    outcome: TrialOutcome


def keep_runs(folder: Path, seal: str, request: PlantRequest, files: Sequence[Path]) -> Trial:
    """Write `trial.json` after a plant has been drawn, sealed and recorded.

    A folder counts as a trial as soon as this file exists.
    """
    names = [path.relative_to(folder).as_posix() for path in files]
    write_json({"seal": seal, "asked": f"{request.kind}:{request.level}", "runs": names}, folder / "trial.json")
    return read_trial(folder)


def read_trial(folder: Path) -> Trial:
    """Read the trial in a folder.

    Raises:
        RunError: the folder contains no trial, or the draw of its plant was not finished.
    """
    file = folder / "trial.json"
    if not file.is_file():
        raise RunError(f"{folder}: contains no trial; draw one: dpr-lab trials draw --out NEW_FOLDER")
    content = read_json(file)
    try:
        return Trial(folder, content["seal"], content["asked"], tuple(folder / name for name in content["runs"]))
    except (KeyError, TypeError) as error:
        raise RunError(f"{file}: was not written by `trials draw`: {error!r}") from error


def recordings(trial: Trial) -> list[Run]:
    """Read the runs of the trial.

    Raises:
        RunError: a run cannot be read.
    """
    rig = trial.rig
    return [load_run(path, rig=rig) for path in trial.runs]


def keep_diagnosis(trial: Trial, diagnosis: dict[str, Any]) -> None:
    """Write the diagnosis of a trial.

    Raises:
        RunError: the truth is already revealed, so that the diagnosis would not be blind.
    """
    refuse_opened(trial)
    write_json(diagnosis, trial.diagnosis)


def refuse_opened(trial: Trial) -> None:
    """Test whether the truth of the trial is still hidden.

    Raises:
        RunError: the truth is already revealed.
    """
    if trial.opened.exists():
        raise RunError(f"{trial.folder}: this trial was already opened, so a diagnosis would not be blind")


def open_trial(trial: Trial) -> Opened:
    """Reveal the plant, verify the seal, and score the diagnosis.

    Raises:
        RunError: the trial has no valid diagnosis.
        DprError: the truth does not match the seal, or the device failed.
    """
    if not trial.diagnosis.is_file():
        raise RunError(
            f"{trial.folder}: is not diagnosed yet, so it stays sealed: dpr-lab trials run {in_command(trial.folder)}"
        )
    diagnosis = _diagnosis(trial.diagnosis)
    opened = ask("--unseal", str(trial.folder / DEVICE))
    truth = unsealed(opened, trial.seal)
    outcome = score(diagnosis, truth, trial.rig, **truth.drawn, seconds=diagnosis["seconds"], seal=trial.seal)
    write_json(opened | {"seal": trial.seal, "score": outcome.to_json()}, trial.opened)
    return Opened(truth, diagnosis, outcome)


def _diagnosis(file: Path) -> dict[str, Any]:
    try:
        return Diagnosis.model_validate(read_json(file)).to_json()
    except ValidationError as error:
        raise RunError(f"{file}: was not written by `trials run`; run the trial again: {error}") from error


def read_json(file: Path) -> dict[str, Any]:
    """Read a JSON object from a file.

    Raises:
        RunError: the file cannot be read, or is not a JSON object.
    """
    try:
        content = json.loads(regular(file, RunError).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise RunError(f"{file}: cannot be read as JSON: {error}") from error
    if not isinstance(content, dict):
        raise RunError(f"{file}: contains no JSON object")
    return content
