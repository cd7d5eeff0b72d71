"""Wall time of `identify` on three recordings, and of the published search.

    python benchmarks/wall_time.py [--quick] [--json]

`identify` consists of the improved genetic algorithm, the local solver and the intervals. It uses three poses of 10 s
at 200 Hz; the figure is the median over several seeds, with all code compiled before. The published search
(docs/theory.md) has M = 200, 1000 generations, and E(Z) over 10 s from three poses. With --quick it ends after 50
generations, and its time is scaled. Both results are wall times on all cores. They increase with other load on the
machine, so the load and the times on one thread are also printed.
"""

import os
import statistics
import time
from collections.abc import Callable

import numba
from _bars import Bar, at_most, options, show
from _random_rigs import draw

from dpr_lab.identification.identify import identify
from dpr_lab.paper.campaign import SearchCase, run_search
from dpr_lab.rig import load_rig
from dpr_lab.run import Run
from dpr_lab.search import load_search
from dpr_lab.search.settings import IgaSettings

IDENTIFY_S, PAPER_S = 3.0, 25.0
FEW = 50


def identified(runs: list[Run], seeds: int) -> float:
    """Median wall time of `identify` over seeds, s."""
    rig, taken = load_rig("paper"), []
    for seed in range(seeds):
        began = time.perf_counter()
        identify(runs, rig, seed=seed)
        taken.append(time.perf_counter() - began)
    return statistics.median(taken)


def searched(generations: int) -> tuple[float, int]:
    """Wall time of the published search, s, scaled to all generations, and its number of evaluations."""
    rig, settings = load_rig("paper"), load_search("paper")
    assert isinstance(settings, IgaSettings)
    result = run_search(SearchCase("sum", "off", 0), rig, settings.model_copy(update={"generations": generations}))
    return result.wall_s * settings.generations / generations, result.evaluations


def on(threads: int, measure: Callable[[], float]) -> float:
    """Call `measure` on a given number of threads and return its result."""
    before = numba.get_num_threads()
    numba.set_num_threads(threads)
    try:
        return measure()
    finally:
        numba.set_num_threads(before)


def measure(quick: bool) -> list[Bar]:
    """Measure all results of the table."""
    threads = numba.get_num_threads()
    runs, seeds = [run.run for run in draw(0).runs], 3 if quick else 7
    identified(runs, 1)
    searched(1)
    paper_s, evaluations = searched(FEW if quick else 1000)
    return [
        at_most(f"identify on {threads} threads, s", identified(runs, seeds), IDENTIFY_S),
        Bar("identify on one thread, s", "-", on(1, lambda: identified(runs, seeds)), None),
        at_most(f"the published search on {threads} threads, s", paper_s, PAPER_S),
        Bar("the published search on one thread, scaled, s", "-", on(1, lambda: searched(FEW)[0]), None),
        Bar("evaluations of the search that was run", "-", evaluations, None),
    ]


def main() -> None:
    """Measure all results and print them."""
    chosen = options(__doc__).parse_args()
    load = os.getloadavg()[0]
    bars = measure(chosen.quick)
    show(f"wall time, load {load:.1f} before and {os.getloadavg()[0]:.1f} after", bars, chosen.json)


if __name__ == "__main__":
    main()
