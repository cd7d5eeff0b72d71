"""Runs in, a diagnosis out: why simulation and rig differ."""

import os
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import ConfigError, unknown_name
from dpr_lab.workflows.checks import refuse_file
from dpr_lab.workflows.events import FitBegan, OnEvent, ScoreTestBegan, StageBegan, TrustTrialDone, Warned, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from collections.abc import Mapping

    from dpr_lab.effects.effect import Effect
    from dpr_lab.gap.result.diagnosis import Diagnosis


RECORD = "diagnosis.json"
"""In the folder of a diagnosis: what `diagnose --json` prints."""


@dataclass(frozen=True, slots=True)
class DiagnoseRequest:
    """Options of a diagnosis."""

    runs: tuple[Path, ...]
    rig: str
    """Rig file, or the name of a built-in one."""
    held_out: tuple[Path, ...] = ()
    """Runs that take no part in the fit: what is named must carry over to them."""
    model: Path | None = None
    """An identified model to start from; the rig file's values by default."""
    library: tuple[str, ...] | None = None
    """Names of the effects to choose from; None: all."""
    without: tuple[str, ...] = ()
    """Names of effects to leave out."""
    max_effects: int = 4
    """At most so many effects at once."""
    seed: int = 0
    """Same seed, same answer."""
    out: Path | None = None
    """Folder of report, figures, corrected model, exports and `RECORD`; None: none are written."""
    any_clock: bool = False
    """Whether to take runs of a device whose clock is further off than a crystal's."""
    trust: int = 0
    """How many blind trials on plants like this rig to add; each takes as long as the diagnosis."""
    processes: int = 0
    """How many of those trials side by side; 0: as many as there are processors."""
    torque: str | None = None
    """`measured` or `commanded`: which known torques drove the joints of runs that hold both; None: the measured."""


@dataclass(frozen=True, slots=True)
class DiagnoseResult:
    """The diagnosis, and the files that it was written to, by name."""

    diagnosis: "Diagnosis"
    files: "Mapping[str, str]"

    def to_json(self) -> dict[str, Any]:
        """Output of `diagnose --json`."""
        return self.diagnosis.to_json() | ({"files": dict(self.files)} if self.files else {})


def diagnose(request: DiagnoseRequest, on_event: OnEvent = ignore) -> DiagnoseResult:
    """Explain the gap between simulation and rig: location, causes, probabilities and reduction.

    Events: `RunRead`, `StageBegan`, `FitBegan`, `ScoreTestBegan`, `TrustTrialDone`, `Warned`.

    Raises:
        ConfigError: the rig is not valid, no such effect, or none left to choose from.
        RunError: a run or the model cannot be used, or there are no runs.
        IdentificationError: the recordings are read with another zero, unit, sign or order than they were written with.
        DprError: a result cannot be written.
    """
    from dpr_lab.gap.diagnose import STAGES
    from dpr_lab.gap.diagnose import diagnose as diagnose_runs
    from dpr_lab.identification.misread.refuse import refuse_misread
    from dpr_lab.identification.model import load_model
    from dpr_lab.rig import load_rig

    rig = load_rig(request.rig)
    read = read_runs((*request.runs, *request.held_out), rig, on_event, request.any_clock, request.torque)
    runs, held_out = read[: len(request.runs)], read[len(request.runs) :]
    if request.out:
        refuse_file(request.out)
    refuse_misread(runs, rig)
    stages = len(STAGES) + bool(request.out)
    library = chosen_library(request.library, request.without)
    found = diagnose_runs(
        runs,
        rig,
        held_out=held_out,
        library=library,
        max_effects=request.max_effects,
        start=load_model(request.model).starting_point(rig) if request.model else None,
        seed=request.seed,
        on_progress=lambda event: on_event(_of_all(event, stages)),
    )
    result = _kept(DiagnoseResult(found, {}), request.out)  # safe before what can still fail
    if request.trust:
        from dpr_lab.trials.own_rig import trust

        began = time.perf_counter()
        tried = trust(
            found,
            runs,
            rig,
            request.trust,
            library=library,
            max_effects=request.max_effects,
            seed=request.seed,
            processes=request.processes or os.cpu_count() or 1,
            on_trial=lambda done: on_event(TrustTrialDone(done, request.trust, time.perf_counter() - began)),
        )
        found = found.model_copy(update={"trust": tried})
        result = _kept(DiagnoseResult(found, {}), request.out)
    if request.out:
        from dpr_lab.report.saving import save_diagnosis

        on_event(StageBegan(stages, stages, "report"))
        files = save_diagnosis(found, runs, rig, request.out, lambda sentence: on_event(Warned(sentence)))
        result = _kept(DiagnoseResult(found, files), request.out)
    return result


def _kept(result: DiagnoseResult, out: Path | None) -> DiagnoseResult:
    from dpr_lab.report.files import write_json

    if out:
        write_json(result.to_json(), out / RECORD)
    return result


def _of_all(event: StageBegan | FitBegan | ScoreTestBegan, stages: int) -> StageBegan | FitBegan | ScoreTestBegan:
    """The same event; a stage counted among those of this job, which may have one more."""
    return replace(event, of=stages) if isinstance(event, StageBegan) else event


def chosen_library(names: Sequence[str] | None, without: Sequence[str]) -> "Mapping[str, Effect]":
    """The effects to choose from.

    Raises:
        ConfigError: a name that is no effect, or none left.
    """
    from dpr_lab.effects import EFFECTS

    wanted = list(EFFECTS) if names is None else names
    unknown = [name for name in (*wanted, *without) if name not in EFFECTS]
    if unknown:
        raise ConfigError(unknown_name(f"no effect named {unknown[0]}", unknown[0], EFFECTS))
    library = {name: EFFECTS[name] for name in EFFECTS if name in wanted and name not in without}
    if not library:
        raise ConfigError("--library and --without leave no effect to choose from: name more, or leave out fewer")
    return library


REASONS = ("gap", "unexplained", "unsure", "sensor")
"""What `diagnose --fail-on` knows."""


def failures(found: "Diagnosis", reasons: Sequence[str], *, sure: float = 0.9) -> list[str]:
    """One sentence for each of some `REASONS` that apply to a diagnosis.

    Recordings that cannot show a gap, and a description of them that is probably wrong, fail without being asked for.

    Args:
        found: the diagnosis
        reasons: those that count
        sure: probability from which a named effect is not unsure
    """
    sentences = {
        "gap": found.sentence if found.verdict not in ("no_gap", "inconclusive") else "",
        "unexplained": found.sentence if found.verdict in ("unexplained", "partly_explained") else "",
        "unsure": ", ".join(f"{e.name} is at {e.probability:.0%}" for e in found.effects if e.probability < sure),
        "sensor": f"{len(found.sensor_findings)} faults of sensors" if found.sensor_findings else "",
    }
    always = [f"inconclusive: {found.sentence}"] if found.verdict == "inconclusive" else []
    always += [f"description: {hint}" for hint in found.hints]
    return [*always, *(f"{reason}: {sentences[reason]}" for reason in reasons if sentences[reason])]
