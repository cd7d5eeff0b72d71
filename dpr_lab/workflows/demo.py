"""Complete workflow on a simulated rig, then a blind trial of the diagnosis."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.workflows.capture import capture
from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.compare import CompareRequest, compare
from dpr_lab.workflows.events import JobBegan, OnEvent, ignore
from dpr_lab.workflows.identify import IdentifyRequest, identify
from dpr_lab.workflows.trial import diagnose_trial, draw

if TYPE_CHECKING:
    from collections.abc import Callable

    from dpr_lab.gap.result.diagnosis import Diagnosis
    from dpr_lab.identification.model import Model
    from dpr_lab.trials.protocol import Opened, Trial

PLANT = "paper"
RIG = "paper"

JOBS = (
    "capture: three releases of a simulated rig, over its serial protocol",
    "identify: improved genetic algorithm, then segment least squares",
    "compare: measured and simulated curves, and the true parameters of the plant",
    "blind trial: another plant with a hidden effect is sealed and recorded",
    "identify this plant without its hidden effect",
    "diagnose: location and cause of the gap",
    "reveal the plant and score the diagnosis",
)


@dataclass(frozen=True, slots=True)
class KnownPlant:
    """Results for a plant without effects."""

    runs: tuple[Path, ...]
    model: "Model"
    model_file: Path
    report: str
    ratios: dict[str, float]
    """True ratios of the plant."""

    @property
    def comparison(self) -> dict[str, tuple[float, float, float, float]]:
        """Estimate, standard deviation, true value and error (in standard deviations) of each ratio."""
        return {
            name: (interval.value, interval.std, self.ratios[name], (interval.value - self.ratios[name]) / interval.std)
            for name, interval in self.model.ratios.items()
        }


@dataclass(frozen=True, slots=True)
class HiddenEffect:
    """Blind trial of a plant with a hidden effect."""

    trial: "Trial"
    model: "Model"
    """Model without the hidden effect."""
    diagnosis: "Diagnosis"
    report: str
    opened: "Opened"


@dataclass(frozen=True, slots=True)
class DemoResult:
    """Results of both parts of the demo."""

    known: KnownPlant
    hidden: HiddenEffect


def demo(out: Path, seed: int | None = None, on_event: OnEvent = ignore) -> DemoResult:
    """Record, identify and compare a simulated double pendulum, then diagnose one with a hidden effect.

    Args:
        out: folder for runs, model and report. It contains a separate folder for the trial of each demo.
        seed: seed of the trial's plant, for repeatable demos; None: a random plant. The seed of all other random
            numbers is then 1.
        on_event: receives `JobBegan`, and the events of each job

    Raises:
        ConfigError: a file with the name of the folder exists, or nothing can be written.
        DprError: a job failed.
    """
    check_folder_writable(out)

    def begin(number: int) -> None:
        on_event(JobBegan(number, len(JOBS), JOBS[number - 1]))

    known = _known_plant(out, 1 if seed is None else seed, begin, on_event)
    return DemoResult(known, _hidden_effect(out, seed, begin, on_event))


def _known_plant(out: Path, seed: int, begin: "Callable[[int], None]", on_event: OnEvent) -> KnownPlant:
    """Capture, identify and compare a plant without effects, then request its true values."""
    from dpr_lab.acquisition.capture import CaptureOptions
    from dpr_lab.identification.model import Model
    from dpr_lab.trials.sealing import ask

    url = f"sim://?plant={PLANT}&seed={seed}&clock=fast"
    begin(1)
    recorded = capture(RIG, out / "runs", CaptureOptions(), lambda: True, url=url, on_event=on_event)
    begin(2)
    identified = identify(IdentifyRequest(recorded.files, RIG, out / "model.json", seed=seed), on_event)
    assert isinstance(identified.model, Model)
    begin(3)
    compared = compare(CompareRequest(recorded.files, identified.file, out), on_event)
    truth = ask("--plant", PLANT, "--seed", str(seed), "--reveal")["ratios"]
    return KnownPlant(recorded.files, identified.model, identified.file, compared.saved["report"], truth)


def _hidden_effect(out: Path, seed: int | None, begin: "Callable[[int], None]", on_event: OnEvent) -> HiddenEffect:
    """Run a blind trial: seal, record, identify, diagnose, reveal and score a plant."""
    from dpr_lab.identification.model import Model
    from dpr_lab.trials.protocol import RIG_FILE, open_trial
    from dpr_lab.trials.sealing import Kind, PlantRequest

    folder = _unused(out)
    begin(4)
    trial = draw(PlantRequest(Kind.SINGLE, seed=seed), folder, on_event)
    begin(5)
    request = IdentifyRequest(trial.runs, str(folder / RIG_FILE), folder / "model.json", seed=seed or 1)
    identified = identify(request, on_event)
    assert isinstance(identified.model, Model)
    begin(6)
    diagnosed = diagnose_trial(folder, identified.file, on_event)
    begin(7)
    return HiddenEffect(trial, identified.model, diagnosed.diagnosis, diagnosed.files["report"], open_trial(trial))


def _unused(out: Path) -> Path:
    """Choose a folder for the trial that does not contain an earlier trial."""
    number = 1
    while (folder := out / f"trial-{number}").exists():
        number += 1
    return folder
