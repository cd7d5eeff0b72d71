"""Runs in, `model.json` out."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dpr_lab.workflows.checks import refuse_folder
from dpr_lab.workflows.events import GenerationDone, LocalFitBegan, OnEvent, Proceed, always, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from dpr_lab.identification.model import Model
    from dpr_lab.identification.moving_arm.model import MovingArmModel
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run
    from dpr_lab.search.problem import Generation


@dataclass(frozen=True, slots=True)
class IdentifyRequest:
    """Options of an identification."""

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
    """Result of an identification. A model that failed its own checks is written too; see `model.failures`."""

    model: "Model"
    file: Path


@dataclass(frozen=True, slots=True)
class MovingArmResult:
    """Identified model of a rig with a free or driven arm, and its file."""

    model: "MovingArmModel"
    file: Path


def identify(request: IdentifyRequest, on_event: OnEvent = ignore, proceed: Proceed = always) -> IdentifyResult:
    """Identify the kinetic parameters of a rig from its runs, whose arm was clamped or prescribed.

    Events: `RunRead`, `GenerationDone`, `LocalFitBegan`; asks `proceed` after each generation.

    Raises:
        ConfigError: nothing can be written to the file, rig or settings are not valid, or no such objective or search.
        RunError: a run that cannot be used, or none.
        IdentificationError: not one candidate inside the bounds could be simulated.
    """
    rig, runs = _read(request, on_event, moving=False)
    return _identified(runs, rig, request, on_event, proceed)


def identify_any_arm(
    request: IdentifyRequest, on_event: OnEvent = ignore, proceed: Proceed = always
) -> IdentifyResult | MovingArmResult:
    """As `identify`, of runs whose arm may also have been free or driven; objective and search do not apply to those.

    Raises:
        ConfigError, RunError, IdentificationError: as of `identify`.
    """
    from dpr_lab.identification.moving_arm.identify import identify_moving_arm, moves

    rig, runs = _read(request, on_event, moving=True)
    if not moves(runs):
        return _identified(runs, rig, request, on_event, proceed)
    on_event(LocalFitBegan())
    model = identify_moving_arm(runs, rig)
    model.save(request.out)
    return MovingArmResult(model, request.out)


def _read(request: IdentifyRequest, on_event: OnEvent, *, moving: bool) -> "tuple[Rig, list[Run]]":
    from dpr_lab.rig import load_rig

    refuse_folder(request.out)
    rig = load_rig(request.rig)
    return rig, read_runs(request.runs, rig, on_event, request.any_clock, request.torque, moving)


def _identified(
    runs: "list[Run]", rig: "Rig", request: IdentifyRequest, on_event: OnEvent, proceed: Proceed
) -> IdentifyResult:
    from dpr_lab.identification.identify import identify as identify_runs
    from dpr_lab.search import load_search

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
