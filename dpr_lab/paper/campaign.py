"""Repetitions of the published search, with several seeds and with true values on and off the grid."""

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.child_process import worker_pool
from dpr_lab.dynamics.base import base_parameters, ratios
from dpr_lab.paper.printed import BEST_H, TRUE
from dpr_lab.paper.swings import READINGS, errors, objective, swings
from dpr_lab.rig import Rig
from dpr_lab.search import ALGORITHMS
from dpr_lab.search.settings import IgaSettings

Grid = Literal["on", "off"]

TRUTHS: dict[Grid, Array] = {
    "on": TRUE,
    "off": TRUE * np.random.default_rng(2012).uniform(0.85, 1.15, len(TRUE)),
}
"""True parameters of a search by grid. `on`: the published values, which are in the middle of the coding grid. `off`:
each of these values, multiplied by a random factor of 0.85 to 1.15."""

HISTORY = ("best_cost", "best_fitness", "population_fitness")


@dataclass(frozen=True, slots=True)
class SearchCase:
    """Case of a search: interpretation of H, true values and seed."""

    reading: str
    """Interpretation of H: a name in `READINGS`."""
    grid: Grid
    seed: int


@dataclass(frozen=True, slots=True)
class SearchResult:
    """Result of one search."""

    case: SearchCase
    best: Array
    """(9,) best parameters, SI units."""
    H: float
    """H of the best parameters, in the interpretation of the search."""
    E: dict[str, Array]
    """(3,) E from the poses X1, X2, X3, by the name of its interpretation in `TERMS`."""
    generations: int
    evaluations: int
    gate_opened: int | None
    """First generation whose population has converged, so that step (4) of the algorithm is used; None if there is
    none."""
    wall_s: float
    cpu_s: float
    history: dict[str, list[float]]
    """Values of the quantities `HISTORY`, one value per generation."""

    @property
    def percent(self) -> Array:
        """(9,) signed relative errors of the parameters, %."""
        return 100 * (self.best / TRUTHS[self.case.grid] - 1)

    def ratio_percent(self, rig: Rig) -> Array:
        """Compute the (5,) signed relative errors of the ratios a/b, d/b, e1/b, c1/b, c2/b, %."""
        return ratio_percent(self.best, TRUTHS[self.case.grid], rig)

    @property
    def as_good_as_printed(self) -> bool:
        """Whether H is at most the best published H."""
        return self.H <= BEST_H

    def record(self, rig: Rig) -> dict[str, Any]:
        """Return the result as a JSON-compatible dictionary."""
        case = {field.name: getattr(self.case, field.name) for field in fields(SearchCase)}
        values = {
            field.name: getattr(self, field.name) for field in fields(SearchResult) if field.name not in ("case", "E")
        }
        return (
            case
            | values
            | {
                "best": self.best.tolist(),
                "E": {name: E.tolist() for name, E in self.E.items()},
                "percent": self.percent.tolist(),
                "ratio_percent": self.ratio_percent(rig).tolist(),
                "as_good_as_printed": self.as_good_as_printed,
            }
        )


def ratio_percent(Z: Array, truth: Array, rig: Rig) -> Array:
    """Compute the (5,) signed relative errors of the ratios of (9,) parameters, %."""
    L1, g = rig.L1, rig.g
    return 100 * (ratios(base_parameters(Z, L1, g)) / ratios(base_parameters(truth, L1, g)) - 1)


def search_cases(seeds: int, readings: Sequence[str]) -> list[SearchCase]:
    """List all searches of a campaign, the most expensive first."""
    grids: tuple[Grid, ...] = ("on", "off")
    return [SearchCase(reading, grid, seed) for reading in readings for grid in grids for seed in range(seeds)]


def run_search(case: SearchCase, rig: Rig, settings: IgaSettings) -> SearchResult:
    """Run one search; apart from the times, the result does not depend on the number of cores."""
    reading, truth = READINGS[case.reading], swings(TRUTHS[case.grid], rig)
    wall, cpu = time.perf_counter(), time.process_time()
    rng = np.random.default_rng(case.seed)
    history = list(ALGORITHMS["iga"].run(objective(reading, truth, rig), rig.bounds, settings, rng))
    last = history[-1]
    opened = (g.number for g in history if g.population_fitness > settings.alpha and g.best_fitness > settings.sigma)
    return SearchResult(
        case=case,
        best=last.best,
        H=last.best_cost,
        E=errors(last.best, truth, rig),
        generations=last.number,
        evaluations=last.evaluations,
        gate_opened=next(opened, None),
        wall_s=time.perf_counter() - wall,
        cpu_s=time.process_time() - cpu,
        history={name: [float(getattr(g, name)) for g in history] for name in HISTORY},
    )


def run_searches(cases: Sequence[SearchCase], rig: Rig, settings: IgaSettings, workers: int) -> Iterator[SearchResult]:
    """Run searches in parallel, each on one core, and yield each result when its search has ended.

    Separate processes are more efficient than the threads of one search, whose batches are often too small for all
    cores.

    Args:
        cases: the searches
        rig: bounds, lengths, poses
        settings: the published settings, possibly with fewer generations
        workers: number of processes; if it is 1, the searches run in this process
    """
    if workers == 1:
        yield from (run_search(case, rig, settings) for case in cases)
        return
    with worker_pool(workers) as pool:
        for done in as_completed([pool.submit(run_search, case, rig, settings) for case in cases]):
            yield done.result()
