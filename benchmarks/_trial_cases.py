"""Blind trials in memory, on all cores: plants are drawn, recorded, diagnosed, revealed and scored."""

import os
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from typing import Any

from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.trials.score import TrialOutcome, cause_named, score
from dpr_lab.trials.truth import Truth, read_truth
from sim_device.plant.config import PlantConfig, load_plant
from sim_device.plant.hidden import plant_of
from sim_device.trials.draw import described, draw_plant
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import weighed
from sim_device.trials.request import parse_request
from sim_device.trials.seal import truth

THREADS = ("NUMBA_NUM_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")


@dataclass(frozen=True, slots=True)
class Case:
    """Blind trial to run."""

    group: str
    """Group of trials to which the case belongs in the table of results."""
    draw: str
    """Text of `sim_device.trials.request.parse_request`."""
    seed: int


@dataclass(frozen=True, slots=True)
class Scored:
    """Completed blind trial with its scores."""

    case: Case
    outcome: TrialOutcome
    diagnosis: dict[str, Any]
    """The diagnosis as JSON."""
    true: tuple[bool, ...]
    """Whether each effect that the diagnosis lists is a true cause, independent of the verdict."""


def hidden(case: Case) -> tuple[PlantConfig, Rig]:
    """Draw the plant of a case, and the rig file for dpr-lab: measured masses, and bounds of the other parameters."""
    base, rig = weighed(load_plant("paper", case.seed), load_rig("paper"))
    wanted = parse_request(case.draw)
    return draw_plant(wanted, base, rig), described(wanted, rig)


def opened(plant: PlantConfig, rig: Rig) -> Truth:
    """Return the true parameters and effects of a plant."""
    return read_truth(truth(plant_of(plant, rig)))


def run_case(case: Case) -> Scored:
    """Draw, record, diagnose, reveal and score one plant."""
    from dpr_lab.gap.diagnose import diagnose

    plant, rig = hidden(case)
    runs = record(plant, rig)
    begin = time.process_time()
    diagnosed = diagnose(runs, rig).to_json()
    seconds = time.process_time() - begin
    kind, _, level = case.draw.partition(":")
    result = opened(plant, rig)
    outcome = score(
        diagnosed, result, rig, kind=kind, level=level.partition(":")[0] or "clear", seed=case.seed, seconds=seconds
    )
    true = tuple(cause_named(effect, result) is not None for effect in diagnosed["effects"])
    return Scored(case, outcome, diagnosed, true)


def run_all(cases: Sequence[Case], workers: int) -> Iterator[Scored | tuple[Case, str]]:
    """Run all cases in parallel processes of one thread each, and yield each result as soon as it is complete.

    For a case that failed, the case and its error message are yielded.
    """
    for name in THREADS:
        os.environ[name] = "1"
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        jobs = {pool.submit(run_case, case): case for case in cases}
        for job in as_completed(jobs):
            error = job.exception()
            yield job.result() if error is None else (jobs[job], f"{type(error).__name__}: {error}")


def warm_up(rig: Rig, runs: list[Run]) -> None:
    """Fill the kernel cache once, so that the processes do not all compile."""
    from dpr_lab.gap.diagnose import diagnose

    diagnose(runs, rig)
