"""One blind trial in a folder: drawn and recorded, diagnosed, and opened once the diagnosis stands.

trial.json       the seal, given away before anything was recorded; written when all runs are there
rig.toml         the rig file that goes with the plant
runs/            one recording from each of its poses, through the real protocol
device/          the device's own: nothing of the lab reads it
diagnosis.json   what the diagnosis said
opened.json      the truth, checked against the seal, and the score
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

from pydantic import ValidationError

from dpr_lab.capture import CaptureOptions, capture
from dpr_lab.device import Device
from dpr_lab.errors import RunError
from dpr_lab.gap.diagnosis import Diagnosis
from dpr_lab.report.files import write_json
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.storage.reader import load_run
from dpr_lab.transports import open_transport
from dpr_lab.trials.score import Outcome, score
from dpr_lab.trials.sealing import Wanted, seal, unseal
from dpr_lab.trials.truth import Truth, unsealed


@dataclass(frozen=True, slots=True)
class Trial:
    """A trial's folder."""

    folder: Path
    seal: str
    """Hex SHA-256 of salt and truth."""
    asked: str
    """Kind and level that the draw was asked for, such as `any:clear`."""
    runs: tuple[Path, ...]

    @property
    def rig(self) -> Rig:
        """The rig file that goes with the plant."""
        return load_rig(self.folder / "rig.toml")

    @property
    def diagnosis(self) -> Path:
        """Where the diagnosis is written."""
        return self.folder / "diagnosis.json"

    @property
    def opened(self) -> Path:
        """Where truth and score are written."""
        return self.folder / "opened.json"


@dataclass(frozen=True, slots=True)
class Opened:
    """A trial, opened."""

    truth: Truth
    said: dict[str, Any]
    outcome: Outcome


def draw(wanted: Wanted, folder: Path, on_step: Callable[[str], None] = lambda text: None) -> Trial:
    """Have a plant drawn and sealed, and record it.

    Args:
        wanted: what to draw
        folder: of the trial, new
        on_step: told the seal, and each recording

    Raises:
        DprError: there is a trial already, no such draw, or a recording failed.
    """
    if folder.exists() and any(folder.iterdir()):
        raise RunError(f"{folder}: is not empty; give each trial a folder of its own")
    told = seal(wanted, folder / "device")
    on_step(f"sealed as {told['seal']}")
    (folder / "rig.toml").write_text(told["rig"], encoding="utf-8")
    trial = Trial(folder, told["seal"], f"{wanted.kind}:{wanted.level}", ())
    runs = _recorded(trial, on_step)
    names = [path.relative_to(folder).as_posix() for path in runs]
    write_json({"seal": trial.seal, "asked": trial.asked, "runs": names}, folder / "trial.json")
    return read_trial(folder)


def _recorded(trial: Trial, on_step: Callable[[str], None]) -> list[Path]:
    """One run file from each of the rig's poses."""
    rig, plant = trial.rig, (trial.folder / "device" / "plant.toml").resolve()
    files: list[Path] = []
    with Device(open_transport(f"sim://?clock=fast&plant={quote(str(plant))}", rig_file=rig.path)) as device:
        device.connect()
        for pose in rig.poses:
            got = capture(device, rig, pose, CaptureOptions(), trial.folder / "runs", confirm=lambda: True)
            on_step(f"{pose}: {got.run_file.name}: {got.verdict.sentence}")
            files.append(got.run_file)
    return files


def read_trial(folder: Path) -> Trial:
    """The trial of a folder.

    Raises:
        RunError: no trial is there, or its draw was not finished.
    """
    file = folder / "trial.json"
    if not file.is_file():
        raise RunError(f"{folder}: holds no finished trial; start one: dpr-lab trials draw --out NEW_FOLDER")
    kept = read_json(file)
    try:
        return Trial(folder, kept["seal"], kept["asked"], tuple(folder / name for name in kept["runs"]))
    except (KeyError, TypeError) as error:
        raise RunError(f"{file}: is not what `trials draw` wrote: {error!r}") from error


def recordings(trial: Trial) -> list[Run]:
    """The trial's runs.

    Raises:
        RunError: a run that cannot be read.
    """
    rig = trial.rig
    return [load_run(path, rig=rig) for path in trial.runs]


def keep_diagnosis(trial: Trial, said: dict[str, Any]) -> None:
    """Write down what the diagnosis said.

    Raises:
        RunError: the trial is open already: a diagnosis after that is not blind.
    """
    refuse_opened(trial)
    write_json(said, trial.diagnosis)


def refuse_opened(trial: Trial) -> None:
    """Raise RunError where the truth is known already."""
    if trial.opened.exists():
        raise RunError(f"{trial.folder}: this trial was opened already; a diagnosis after that would not be blind")


def open_trial(trial: Trial) -> Opened:
    """Have the plant opened, check it against the seal, and score the diagnosis.

    Raises:
        RunError: there is no diagnosis yet.
        DprError: the seal is broken.
    """
    if not trial.diagnosis.is_file():
        raise RunError(f"{trial.folder}: is not diagnosed yet, so it stays sealed: dpr-lab trials run {trial.folder}")
    said = _diagnosis(trial.diagnosis)
    told = unseal(trial.folder / "device")
    truth = unsealed(told, trial.seal)
    outcome = score(said, truth, trial.rig, **truth.drawn, seconds=said["seconds"], seal=trial.seal)
    write_json(told | {"seal": trial.seal, "score": outcome.to_json()}, trial.opened)
    return Opened(truth, said, outcome)


def _diagnosis(file: Path) -> dict[str, Any]:
    try:
        return Diagnosis.model_validate(read_json(file)).to_json()
    except ValidationError as error:
        raise RunError(f"{file}: is not what `trials run` wrote; run it again: {error}") from error


def read_json(file: Path) -> dict[str, Any]:
    """A JSON object from a file.

    Raises:
        RunError: it cannot be read or is none.
    """
    try:
        kept = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise RunError(f"{file}: cannot be read as JSON: {error}") from error
    if not isinstance(kept, dict):
        raise RunError(f"{file}: holds no JSON object")
    return kept
