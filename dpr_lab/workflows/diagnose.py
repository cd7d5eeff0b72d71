"""Diagnosis of the difference between simulation and rig."""

import os
import time
from collections.abc import Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import ConfigError, DprError, RunError, refuse_unknown
from dpr_lab.gap.result import RECORD
from dpr_lab.shown import percent
from dpr_lab.whole_file import whole_folder
from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.events import OnEvent, StageBegan, TrustTrialDone, Warned, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from dpr_lab.acceptance.judge import Acceptance
    from dpr_lab.effects.effect import Effect
    from dpr_lab.gap.result.diagnosis import Diagnosis
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run

ACCEPTANCE = "accept.json"
"""Name of the file with the output of `accept --json`, next to its diagnosis."""


@dataclass(frozen=True, slots=True)
class DiagnoseRequest:
    """Options of a diagnosis."""

    runs: tuple[Path, ...]
    """Run files (.mcap) to fit."""
    rig: str
    """Rig file, or the name of a built-in one."""
    held_out: tuple[Path, ...] = ()
    """Held-out runs: not fitted, used to validate the named effects."""
    model: Path | None = None
    """Identified model that provides initial values; None: values of the rig file."""
    library: tuple[str, ...] | None = None
    """Names of the candidate effects; None: all."""
    without: tuple[str, ...] = ()
    """Names of excluded effects."""
    max_effects: int = 4
    """Maximum number of named effects."""
    seed: int = 0
    """Seed of the random numbers; the same seed gives the same result."""
    out: Path | None = None
    """Folder of report, figures, corrected model, exports and `RECORD`; None: no files are written."""
    any_clock: bool = False
    """Whether to accept runs of a device whose clock rate error is larger than that of a crystal."""
    trust: int = 0
    """Number of additional blind trials on simulated plants that resemble this rig. Each takes as long as the
    diagnosis."""
    processes: int = 0
    """Number of blind trials that run in parallel; 0: one per processor."""
    torque: str | None = None
    """`measured` or `commanded`: torques to use for runs that contain both; None: measured."""


@dataclass(frozen=True, slots=True)
class DiagnoseResult:
    """Diagnosis, and its files by name."""

    diagnosis: "Diagnosis"
    files: "Mapping[str, str]"

    def to_json(self) -> dict[str, Any]:
        """Return the output of `diagnose --json`."""
        return self.diagnosis.to_json() | ({"files": dict(self.files)} if self.files else {})


def diagnose(request: DiagnoseRequest, on_event: OnEvent = ignore) -> DiagnoseResult:
    """Explain the gap between simulation and rig: location, causes, probabilities and reduction.

    Events: `RunRead`, `StageBegan`, `FitBegan`, `ScoreTestBegan`, `TrustTrialDone`, `Warned`.

    Raises:
        ConfigError: the rig is not valid, an effect is unknown, or no candidate effect remains.
        RunError: a run or the model cannot be used, there are no runs, or trials are requested for a moving arm.
        IdentificationError: zero, unit, sign or order of the readings is specified wrongly.
        DprError: a result cannot be written.
        KeyboardInterrupt: re-raised with the name of the file that contains the diagnosis, if blind trials, report or
            models were missing.
    """
    from dpr_lab.gap.diagnose import STAGES
    from dpr_lab.gap.diagnose import diagnose as diagnose_runs
    from dpr_lab.identification.misread.refuse import refuse_misread
    from dpr_lab.identification.model import load_model
    from dpr_lab.report.plain import write_json
    from dpr_lab.rig import load_rig

    rig = load_rig(request.rig)
    read = read_runs((*request.runs, *request.held_out), rig, on_event, request.any_clock, request.torque)
    runs, held_out = read[: len(request.runs)], read[len(request.runs) :]
    if request.out:
        check_folder_writable(request.out)
    refuse_misread(runs, rig)
    if request.trust:
        _refuse_trials(runs)
    stages = len(STAGES) + bool(request.out)
    library = chosen_library(request.library, request.without)
    diagnosis = diagnose_runs(
        runs,
        rig,
        held_out=held_out,
        library=library,
        max_effects=request.max_effects,
        start=load_model(request.model).starting_point(rig) if request.model else None,
        seed=request.seed,
        # the job may have one stage more than the diagnosis
        on_progress=lambda event: on_event(replace(event, of=stages) if isinstance(event, StageBegan) else event),
    )
    finish = partial(_with_trust, runs=runs, rig=rig, request=request, library=library, on_event=on_event)
    if request.out is None:
        return DiagnoseResult(finish(diagnosis), {})
    with diagnosis_folder(diagnosis, request.out) as folder:
        diagnosis = finish(diagnosis)
        write_json(diagnosis.to_json(), folder / RECORD)
        on_event(StageBegan(stages, stages, "report"))
        return save_results(diagnosis, runs, rig, folder, request.out, on_event)


def _with_trust(
    diagnosis: "Diagnosis",
    runs: "Sequence[Run]",
    rig: "Rig",
    request: DiagnoseRequest,
    library: "Mapping[str, Effect]",
    on_event: OnEvent,
) -> "Diagnosis":
    """Add the reliability that blind trials measure, if the request contains trials."""
    from dpr_lab.trials.own_rig import trust

    if not request.trust:
        return diagnosis
    began = time.perf_counter()
    reliability = trust(
        diagnosis,
        runs,
        rig,
        request.trust,
        library=library,
        max_effects=request.max_effects,
        seed=request.seed,
        processes=request.processes or os.cpu_count() or 1,
        on_trial=lambda done: on_event(TrustTrialDone(done, request.trust, time.perf_counter() - began)),
    )
    return diagnosis.model_copy(update={"trust": reliability})


def save_report(
    diagnosis: "Diagnosis",
    runs: "Run | Sequence[Run]",
    rig: "Rig",
    out: Path | str,
    acceptance: "Acceptance | None" = None,
    on_event: OnEvent = ignore,
) -> dict[str, str]:
    """Write a diagnosis, its HTML report and its models, as `dpr-lab diagnose --out` does.

    Args:
        diagnosis: the diagnosis
        runs: its runs
        rig: the rig
        out: folder of the files
        acceptance: results of limits, which the report shows first; None: no limits were tested
        on_event: called with each warning

    Returns:
        the files by name; `report` is the HTML page

    Raises:
        ConfigError: the diagnosis was made with another description of the rig.
        RunError: the diagnosis belongs to other runs.
        DprError: a file cannot be written.
    """
    from dpr_lab.gap.result.subject import refuse_other_subject
    from dpr_lab.report.plain import write_json
    from dpr_lab.run import as_runs

    out, runs = Path(out), as_runs(runs)
    refuse_other_subject(diagnosis, runs, rig)
    with diagnosis_folder(diagnosis, out) as folder:
        if acceptance is not None:
            write_json(asdict(acceptance), folder / ACCEPTANCE)
        files = dict(save_results(diagnosis, runs, rig, folder, out, on_event, acceptance).files)
    return files if acceptance is None else {"accept": str(out / ACCEPTANCE), **files}


def save_results(
    diagnosis: "Diagnosis",
    runs: "Sequence[Run]",
    rig: "Rig",
    folder: Path,
    out: Path,
    on_event: OnEvent,
    acceptance: "Acceptance | None" = None,
) -> DiagnoseResult:
    """Write a diagnosis, its report and its models to a temporary folder.

    The result contains their paths in the final folder.

    Raises:
        DprError: a file cannot be written.
    """
    from dpr_lab.report.saving import save_diagnosis, write_json

    files = save_diagnosis(diagnosis, runs, rig, folder, lambda sentence: on_event(Warned(sentence)), acceptance)
    moved = {name: str(out / Path(file).relative_to(folder)) for name, file in files.items()}
    result = DiagnoseResult(diagnosis, moved)
    write_json(result.to_json(), folder / RECORD)
    return result


def _refuse_trials(runs: "Sequence[Run]") -> None:
    """Refuse blind trials on plants with a moving arm before the diagnosis is fitted."""
    for run in runs:
        if run.arm_mode in ("free", "driven"):
            raise RunError(
                f"{run.file or run.name}: its arm was {run.arm_mode}, and --trust supports only an arm that is clamped"
                f" or prescribed. Omit --trust, or run `dpr-lab trials campaign --arm {run.arm_mode}`"
            )


@contextmanager
def diagnosis_folder(diagnosis: "Diagnosis", out: Path) -> "Iterator[Path]":
    """Yield a temporary folder for the results of a diagnosis.

    At the end, its files are moved to `out`. If a step after the diagnosis fails, the error also states the verdict and
    the file of the diagnosis.

    Raises:
        DprError: a file cannot be written, or re-raised with verdict and file.
        KeyboardInterrupt: re-raised with the file of the diagnosis.
    """
    from dpr_lab.report.plain import write_json

    saved = ""
    try:
        with whole_folder(out, RECORD, ACCEPTANCE) as folder:
            write_json(diagnosis.to_json(), folder / RECORD)
            saved = f". The diagnosis is in {folder / RECORD}; no other file in {out} was written"
            yield folder
            saved = ""
    except DprError as error:
        raise type(error)(f"{error}{saved}. Verdict of the diagnosis: {diagnosis.sentence}") from error
    except KeyboardInterrupt:
        if not saved:
            raise
        raise KeyboardInterrupt(
            f"interrupted: report and models are missing{saved}. Run the same command again to write all files"
        ) from None


def chosen_library(names: Sequence[str] | None, without: Sequence[str]) -> "Mapping[str, Effect]":
    """Select the candidate effects by their names.

    Raises:
        ConfigError: a name is unknown, or no effect remains.
    """
    from dpr_lab.effects import EFFECTS

    chosen = list(EFFECTS) if names is None else names
    refuse_unknown((*chosen, *without), EFFECTS, "effect")
    library = {name: EFFECTS[name] for name in EFFECTS if name in chosen and name not in without}
    if not library:
        raise ConfigError(
            "--library and --without exclude all effects: add effects to --library, or remove some from --without"
        )
    return library


REASONS = ("gap", "unexplained", "unsure", "sensor")
"""Reasons accepted by `diagnose --fail-on`."""


def failures(diagnosis: "Diagnosis", reasons: Sequence[str], *, sure: float = 0.9) -> list[str]:
    """Return a sentence for each of the requested reasons that applies to a diagnosis.

    The names of the reasons are in `REASONS`. A sentence is always included if the verdict is "inconclusive", or if the
    description of the recordings is probably wrong.

    Args:
        diagnosis: the diagnosis
        reasons: requested reasons
        sure: probability below which a named effect counts as unsure
    """
    sentences = {
        "gap": diagnosis.sentence if diagnosis.has_gap else "",
        "unexplained": diagnosis.sentence if diagnosis.open_gap else "",
        "unsure": ", ".join(
            f"{e.name} is at {percent(e.probability)}" for e in diagnosis.effects if e.probability < sure
        ),
        "sensor": f"{len(diagnosis.sensor_findings)} sensor faults" if diagnosis.sensor_findings else "",
    }
    missing = "determine the cause of the gap" if diagnosis.undecided else "show a gap"
    always = [f"inconclusive: the recordings cannot {missing}"] if diagnosis.verdict == "inconclusive" else []
    always += [f"description: {hint}" for hint in diagnosis.hints]
    return [*always, *(f"{reason}: {sentences[reason]}" for reason in reasons if sentences[reason])]
