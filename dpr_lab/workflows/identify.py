"""Runs in, `model.json` out."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.workflows.checks import refuse_folder
from dpr_lab.workflows.events import GenerationDone, LocalFitBegan, OnEvent, Proceed, always, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from dpr_lab.identification.model import Model
    from dpr_lab.search.problem import Generation


@dataclass(frozen=True, slots=True)
class IdentifyRequest:
    """What to identify, and how."""

    runs: tuple[Path, ...]
    rig: str
    """Rig file, or the name of a built-in one."""
    out: Path
    """Where the model is written."""
    objective: str = "segments"
    """A name of `dpr_lab.identification.objectives.OBJECTIVES`."""
    search: str = "iga"
    """A name of `dpr_lab.search.ALGORITHMS`."""
    settings: str | None = None
    """Search settings, a TOML file or the name of a built-in one; they name their own search. None: the objective's."""
    seed: int = 0
    """Of everything random; same seed, same answer."""
    profile: bool = False
    """Whether to find each ratio's interval by profile likelihood too."""
    any_clock: bool = False
    """Whether to take runs of a device whose clock is further off than a crystal's."""
    torque: str | None = None
    """`measured` or `commanded`: which known torques drove the joints of runs that hold both; None: the measured."""


@dataclass(frozen=True, slots=True)
class IdentifyResult:
    """What was identified. A model that failed its own checks says so in `model.failures`, and is written too."""

    model: "Model"
    file: Path


def identify(request: IdentifyRequest, on_event: OnEvent = ignore, proceed: Proceed = always) -> IdentifyResult:
    """Identify the kinetic parameters of a rig from its runs.

    Tells `RunRead`, `GenerationDone`, `LocalFitBegan`; asks `proceed` after each generation.

    Raises:
        ConfigError: nothing can be written to the file, rig or settings are not valid, or no such objective or search.
        RunError: a run that cannot be used, or none.
        IdentificationError: not one candidate inside the bounds could be simulated.
    """
    from dpr_lab.identification.identify import identify as identify_runs
    from dpr_lab.rig import load_rig
    from dpr_lab.search import load_search

    refuse_folder(request.out)
    rig = load_rig(request.rig)
    runs = read_runs(request.runs, rig, on_event, request.any_clock, request.torque)
    settings = load_search(request.settings) if request.settings else None
    model = identify_runs(
        runs,
        rig,
        objective=request.objective,
        search=settings.algorithm if settings else request.search,
        settings=settings,
        seed=request.seed,
        profile=request.profile,
        on_generation=lambda generation, at_most: on_event(_done(generation, at_most)),
        on_polish=lambda: on_event(LocalFitBegan()),
        stop=lambda: not proceed(),
    )
    model.save(request.out)
    return IdentifyResult(model, request.out)


def _done(generation: "Generation", at_most: int) -> GenerationDone:
    return GenerationDone(
        generation.number,
        at_most,
        generation.evaluations,
        generation.best_cost,
        generation.best_fitness,
        generation.population_fitness,
    )
