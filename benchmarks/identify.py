"""Comparison of searches on random rigs with the same recordings, number of evaluations, and subsequent local solver.

    python benchmarks/identify.py [--quick] [--json] [--rigs N] [--processes N] [--evaluations N] [--only SEARCH]

Each rig is drawn within 15 % of the rig `paper` and recorded from three poses for 10 s at 200 Hz, with 14-bit encoders
and half a count of noise. The rods are placed by hand with an error of 10 mrad. A search works in a box around the
values of the rig `paper`. It stops at the first generation that exceeds the number of evaluations. The segment least
squares of `dpr_lab.identification` then starts from its best candidate. Two rows without a search show the local solver
alone: from the middle of the box, which is never far from the true values here, and from a random point of the box.

before   largest relative error of the three ratios without friction (a/b, d/b, e1/b) before the local solver, median
basin    share of the rigs in which the cost of the search falls below twice the cost of the true parameters
success  share of the rigs in which the final residual is at most 1.1 times the noise floor
error    error after the local solver divided by the Cramer-Rao bound: rms over five ratios, median over rigs
"""

import os
import sys
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from multiprocessing import get_context

import numpy as np
from _bars import Bar, at_least, options, show
from _random_rigs import BOXES, Array, Trial, boxed, draw

from dpr_lab.dynamics.base import base_parameters, ratios
from dpr_lab.identification.identify import polish
from dpr_lab.identification.objectives import OBJECTIVES
from dpr_lab.rig import Rig
from dpr_lab.search import ALGORITHMS, load_search
from dpr_lab.search.settings import SearchSettings
from dpr_lab.shown import percent

TARGETS = {"20 %": 0.99, "50 %": 0.98, "factor 3": 0.95}
"""Target of the success rate of the improved genetic algorithm in each box."""

NEAR_FLOOR = 1.1
WITHOUT_SEARCH = ("middle of the box", "random point")


@dataclass(frozen=True, slots=True)
class Outcome:
    """Result of one search on one rig."""

    box: str
    search: str
    evaluations: int
    search_s: float
    polish_s: float
    before: float
    basin: bool
    success: bool
    error: float


@dataclass(frozen=True, slots=True)
class Row:
    """Results of one search in one box, over all rigs."""

    box: str
    search: str
    success: float
    basin: float
    evaluations: float
    search_s: float
    polish_s: float
    before: float
    error: float


def settings_of(search: str) -> SearchSettings:
    """Return the settings of `dpr-lab identify --search`, without a limit on generations."""
    suited = load_search("segments")
    settings = suited if suited.algorithm == search else ALGORITHMS[search].settings()
    return settings.model_copy(update={"generations": sys.maxsize, "stagnation_generations": None})


def searched(search: str, trial: Trial, rig: Rig, evaluations: int, seed: int) -> tuple[Array, int]:
    """Run a search, and return the best candidate (9,) and the number of evaluations."""
    rng = np.random.default_rng(seed)
    if search == "middle of the box":
        return rig.bounds.mean(axis=0), 0
    if search == "random point":
        return rng.uniform(rig.bounds[0], rig.bounds[1]), 0
    objective = OBJECTIVES["segments"].build(trial.runs, rig)
    for generation in ALGORITHMS[search].run(objective, rig.bounds, settings_of(search), rng):
        if generation.evaluations >= evaluations:
            return generation.best, generation.evaluations
    raise AssertionError("a search without an end ended")


def outcome(search: str, box: str, trial: Trial, evaluations: int, seed: int) -> Outcome:
    """Run one search and then the local solver on one rig."""
    rig = boxed(box)
    began = time.perf_counter()
    best, used = searched(search, trial, rig, evaluations, seed)
    search_s = time.perf_counter() - began
    costs = OBJECTIVES["segments"].build(trial.runs, rig)(np.array([best, trial.Z])).sum(axis=1)
    result = ratios(base_parameters(best, rig.L1, rig.g))
    began = time.perf_counter()
    fit = polish(best, trial.runs, rig)
    return Outcome(
        box=box,
        search=search,
        evaluations=used,
        search_s=search_s,
        polish_s=time.perf_counter() - began,
        before=float(np.abs(result / trial.ratios - 1)[:3].max()),
        basin=bool(costs[0] < 2 * costs[1]),
        success=bool(np.sqrt(fit.chi2_per_dof) < NEAR_FLOOR),
        error=float(np.sqrt(np.mean(((fit.ratios - trial.ratios) / trial.cramer_rao_std) ** 2))),
    )


def one_rig(seed: int, searches: Sequence[str], evaluations: int) -> list[Outcome]:
    """Run the searches in every box on one rig."""
    trial = draw(seed)
    return [outcome(search, box, trial, evaluations, seed) for box in BOXES for search in searches]


def all_rigs(seeds: Sequence[int], searches: Sequence[str], evaluations: int, processes: int) -> Iterator[Outcome]:
    """Run all rigs in parallel, and yield the results of each rig when it is complete.

    Each process uses one thread, so that the times are comparable.
    """
    os.environ.update(NUMBA_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1")
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        work = partial(one_rig, searches=searches, evaluations=evaluations)
        for done, outcomes in enumerate(pool.map(work, seeds), start=1):
            print(f"\r{done} of {len(seeds)} rigs", end="\n" if done == len(seeds) else "", file=sys.stderr, flush=True)
            yield from outcomes


def rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """Shares and medians over the rigs, by box and search."""
    groups: dict[tuple[str, str], list[Outcome]] = {}
    for each in outcomes:
        groups.setdefault((each.box, each.search), []).append(each)
    return [
        Row(
            box,
            search,
            success=float(np.mean([o.success for o in group])),
            basin=float(np.mean([o.basin for o in group])),
            evaluations=float(np.median([o.evaluations for o in group])),
            search_s=float(np.median([o.search_s for o in group])),
            polish_s=float(np.median([o.polish_s for o in group])),
            before=float(np.median([o.before for o in group])),
            error=float(np.median([o.error for o in group])),
        )
        for (box, search), group in groups.items()
    ]


def bars(table: Sequence[Row]) -> list[Bar]:
    """Success rates of the improved genetic algorithm, with targets."""
    reached = {row.box: row.success for row in table if row.search == "iga"}
    return [at_least(f"success of the IGA, box {box}", reached[box], target) for box, target in TARGETS.items()]


def beaten(table: Sequence[Row]) -> list[str]:
    """Sentences on the results in which another search is better than the improved genetic algorithm."""
    igas = {row.box: row for row in table if row.search == "iga"}
    result = []
    for other in (row for row in table if row.search in ALGORITHMS):
        iga = igas[other.box]
        better = [
            f"{name} ({theirs:.2g} to {ours:.2g})"
            for name, theirs, ours, wins in (
                ("success", other.success, iga.success, other.success > iga.success),
                ("basin", other.basin, iga.basin, other.basin > iga.basin),
                ("error before", other.before, iga.before, other.before < iga.before),
            )
            if wins
        ]
        if better:
            result.append(f"{other.box}: {other.search} beats the IGA in {', '.join(better)}")
    return result


def show_rows(table: Sequence[Row]) -> None:
    """Print the searches as text."""
    print(f"{'box':<9} {'search':<23} {'success':>7} {'basin':>6} {'evals':>6} {'search s':>8} {'polish s':>8}", end="")
    print(f" {'before':>8} {'error':>6}")
    for row in table:
        print(
            f"{row.box:<9} {row.search:<23} {row.success:>7.0%} {row.basin:>6.0%} {row.evaluations:>6.0f}"
            f" {row.search_s:>8.2f} {row.polish_s:>8.2f} {row.before:>8.1e} {row.error:>6.2f}"
        )


def main() -> None:
    """Run the searches and print the results."""
    parser = options(__doc__)
    parser.add_argument("--rigs", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, metavar="SEED", help="seed of the first rig")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--evaluations", type=int, default=4000, help="maximum number of evaluations of each search")
    parser.add_argument(
        "--only", metavar="SEARCH", action="append", default=[], help="compare with the IGA; repeatable"
    )
    chosen = parser.parse_args()
    seeds = range(chosen.first, chosen.first + (4 if chosen.quick else chosen.rigs))
    searches = list(dict.fromkeys(["iga", *(chosen.only or [*ALGORITHMS, *WITHOUT_SEARCH])]))
    outcomes = list(all_rigs(seeds, searches, chosen.evaluations, chosen.processes))
    table = rows(outcomes)
    result = beaten(table)
    if not chosen.json:
        show_rows(table)
        print(*result, sep="\n")
    shown = 0.05 ** (1 / len(seeds))
    bound = f"success of at least {percent(shown, 1)} at 95 % confidence"
    title = f"{len(seeds)} random rigs; without a failure they show a {bound}"
    show(title, bars(table), chosen.json, rows=[asdict(row) for row in table], beaten=result)


if __name__ == "__main__":
    main()
