"""Identification of a model from runs, written to `model.json`."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.workflows.checks import check_file_writable
from dpr_lab.workflows.events import GenerationDone, LocalFitBegan, OnEvent, Proceed, always, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from dpr_lab.identification.moving_arm.model import AnyModel


@dataclass(frozen=True, slots=True)
class IdentifyRequest:
    """Options of an identification."""

    runs: tuple[Path, ...]
    rig: str
    """Rig file, or the name of a built-in one."""
    out: Path
    """File of the model."""
    objective: str = "segments"
    """Objective of the search: a name in `dpr_lab.identification.objectives.OBJECTIVES`."""
    search: str = "iga"
    """Search algorithm: a name in `dpr_lab.search.ALGORITHMS`."""
    settings: str | None = None
    """Search settings: a TOML file or the name of built-in settings, which also define the algorithm. None: settings of
    the objective."""
    seed: int = 0
    """Seed of all random numbers; the same seed gives the same result."""
    profile: bool = False
    """Whether profile likelihood intervals of the ratios are also computed."""
    any_clock: bool = False
    """Whether to accept runs of a device whose clock rate error is larger than that of a crystal."""
    torque: str | None = None
    """`measured` or `commanded`: torques to use for runs that contain both; None: measured."""


@dataclass(frozen=True, slots=True)
class IdentifyResult:
    """Result of an identification.

    A model that failed its own checks is also written; see `model.failures`.
    """

    model: "AnyModel"
    file: Path

    def to_json(self) -> dict[str, Any]:
        """Return the output of `identify --json`."""
        return self.model.model_dump() | {"model": str(self.file)}


def identify(request: IdentifyRequest, on_event: OnEvent = ignore, proceed: Proceed = always) -> IdentifyResult:
    """Identify the parameters of a rig from runs.

    For a free or driven arm, objective and search are ignored. Events: `RunRead`, `GenerationDone`, `LocalFitBegan`.
    `proceed` is called after each generation.

    Raises:
        ConfigError: the file cannot be written, rig or settings are not valid, or objective or search is unknown.
        RunError: a run cannot be used, or there are no runs.
        IdentificationError: no candidate inside the bounds could be simulated, or the fit determines nothing.
    """
    from dpr_lab.identification.identify import identify as identify_runs
    from dpr_lab.rig import load_rig
    from dpr_lab.search import load_search

    check_file_writable(request.out)
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
        on_generation=lambda done, at_most: on_event(
            GenerationDone(
                done.number, at_most, done.evaluations, done.best_cost, done.best_fitness, done.population_fitness
            )
        ),
        on_polish=lambda: on_event(LocalFitBegan()),
        stop=lambda: not proceed(),
    )
    model.save(request.out)
    return IdentifyResult(model, request.out)
