"""What the steps have done in another process: the calls that the command line makes, told about step by step.

Nothing here is imported before it is needed: the process that draws the screen names these functions, only the other
one runs them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.tui.work import Control

if TYPE_CHECKING:
    from dpr_lab.compare import FreeRun
    from dpr_lab.gap.diagnosis import Diagnosis
    from dpr_lab.model import Model
    from dpr_lab.search.problem import Generation
    from dpr_lab.storage.inspect import RunInfo


@dataclass(frozen=True, slots=True)
class Note:
    """A sentence for the operator."""

    text: str


@dataclass(frozen=True, slots=True)
class Searched:
    """A generation of the search."""

    number: int
    at_most: int
    evaluations: int
    best_cost: float
    best_fitness: float
    population_fitness: float


def identify(
    control: Control, *, runs: Sequence[Path], rig: str, objective: str, search: str, seed: int, out: Path
) -> "Model":
    """Identify, and save the model as `dpr-lab identify` does."""
    from dpr_lab.identify import identify as identify_runs
    from dpr_lab.rig import load_rig
    from dpr_lab.run import refuse_repeated
    from dpr_lab.storage.reader import load_run

    described = load_rig(rig)
    loaded = [load_run(path, rig=described) for path in runs]
    refuse_repeated(loaded)
    for run in loaded:
        for note in run.notes:
            control.report(Note(f"{run.name}: {note}"))

    def on_generation(generation: "Generation", at_most: int) -> None:
        control.report(
            Searched(
                generation.number,
                at_most,
                generation.evaluations,
                generation.best_cost,
                generation.best_fitness,
                generation.population_fitness,
            )
        )

    model = identify_runs(
        loaded,
        described,
        objective=objective,
        search=search,
        seed=seed,
        on_generation=on_generation,
        stop=lambda: not control.proceed(),
        on_polish=lambda: control.report(Note("search done; the local fit goes to the bottom of the basin")),
    )
    model.save(out)
    return model


@dataclass(frozen=True, slots=True)
class Start:
    """Where a free run is to start: in which run, and when after the release."""

    run: int
    at_s: float


@dataclass(frozen=True, slots=True)
class Answer:
    """A free run from where it was asked for."""

    start: Start
    free_run: "FreeRun"


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A run that could not be compared."""

    why: str


def compare(control: Control, *, runs: Sequence[Path], model: Path, out: Path) -> None:
    """Compare and save as `dpr-lab compare` does; then answer each `Start` with a free run until it is cancelled.

    A run that cannot be compared is told and left out.
    """
    from dpr_lab.compare import compare_followed, follow, free_run_from
    from dpr_lab.errors import RunError
    from dpr_lab.model import load_model
    from dpr_lab.report.saving import save_comparison, write_json
    from dpr_lab.storage.reader import load_run, stored_rig

    identified = load_model(model)
    followed, comparisons, left_out = [], [], []
    for path in runs:
        try:
            followed.append(follow(load_run(path), stored_rig(path), identified))
        except RunError as error:
            left_out.append(path.stem)
            control.report(LeftOut(str(error)))
            continue
        comparisons.append(compare_followed(followed[-1]))
        control.report(comparisons[-1])
    without = f"left out: {', '.join(left_out)}"
    if not comparisons:
        raise RunError(f"no run can be compared ({without}): choose others (b)")
    write_json(save_comparison(identified, comparisons, out), out / "comparison.json")
    control.report(Note(f"saved in {out}" + (f"; {without}" if left_out else "")))
    for start in control.questions():
        control.report(Answer(start, free_run_from(followed[start.run], start.at_s)))


@dataclass(frozen=True, slots=True)
class Stage:
    """Where a diagnosis is: one of its stages, and what is being done in it."""

    number: int
    of: int
    text: str


def diagnose(
    control: Control,
    *,
    runs: Sequence[Path],
    held_out: Sequence[Path],
    rig: str,
    model: Path | None,
    max_effects: int,
    seed: int,
    out: Path,
) -> "Diagnosis":
    """Diagnose, and save as `dpr-lab diagnose --out` does, with its JSON as `diagnosis.json`."""
    from dpr_lab.gap.diagnose import STEPS
    from dpr_lab.gap.diagnose import diagnose as diagnose_runs
    from dpr_lab.model import load_model
    from dpr_lab.report.saving import save_diagnosis, write_json
    from dpr_lab.rig import load_rig
    from dpr_lab.run import refuse_repeated
    from dpr_lab.storage.reader import load_run

    stages = (*STEPS, "report")
    number = 0

    def on_step(text: str) -> None:
        nonlocal number
        number = stages.index(text) + 1 if text in stages else number
        control.report(Stage(number, len(stages), text))

    described = load_rig(rig)
    loaded = [load_run(path, rig=described) for path in runs]
    unseen = [load_run(path, rig=described) for path in held_out]
    refuse_repeated([*loaded, *unseen])
    found = diagnose_runs(
        loaded,
        described,
        held_out=unseen,
        max_effects=max_effects,
        start=load_model(model).starting_point(described) if model else None,
        seed=seed,
        on_step=on_step,
    )
    on_step("report")
    files = save_diagnosis(found, loaded, described, out)
    write_json(found.to_json() | {"files": files}, out / "diagnosis.json")
    return found


@dataclass(frozen=True, slots=True)
class Surveyed:
    """A file of a folder of runs: what it says about itself, or why it says nothing."""

    path: Path
    info: "RunInfo | None"
    trouble: str = ""


def survey(control: Control, *, paths: Sequence[Path]) -> None:
    """Look into run files, one after the other."""
    from dpr_lab.errors import RunError
    from dpr_lab.storage.inspect import info

    for path in paths:
        try:
            control.report(Surveyed(path, info(path)))
        except RunError as error:
            control.report(Surveyed(path, None, str(error)))


def verify(control: Control, *, path: Path) -> str:
    """Check a run file as `dpr-lab run verify` does, and say what was found."""
    from dpr_lab.storage.inspect import verify as verify_run

    checked = verify_run(path)
    return f"{path.name}: whole and unchanged" if checked.ok else f"{path.name}: {'; '.join(checked.faults)}"


def export(control: Control, *, path: Path, out: Path) -> str:
    """Write a run in another format as `dpr-lab run export` does, and say where it is."""
    from dpr_lab.storage.export import export as export_run
    from dpr_lab.storage.reader import load_run

    out.parent.mkdir(parents=True, exist_ok=True)
    return f"exported: {export_run(load_run(path), out)}"
