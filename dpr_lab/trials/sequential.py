"""A sequential trial: choose a release, record it on a sealed plant, diagnose, and so on until the cause is decided."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dpr_lab.errors import DprError
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.planning.forecast import STOPPING, decided
from dpr_lab.planning.release import Release
from dpr_lab.rig import Rig, parse_rig
from dpr_lab.rig_tables import Pose
from dpr_lab.run import Run
from dpr_lab.trials.case import run_of
from dpr_lab.trials.next_release import CHOOSERS, Chooser, Situation
from dpr_lab.trials.score import score
from dpr_lab.trials.sealing import HeldPlant, Kind, Level, PlantRequest, sealed_in_memory
from dpr_lab.trials.truth import Truth, unsealed
from dpr_lab.version import __version__

MOST = 6
"""Recordings after which a plant counts as undecided."""

Record = Callable[[Release, int], Run]
"""Record a release, before which so many were made."""


def run_sequential_case(case: dict[str, Any]) -> dict[str, Any]:
    """One sealed plant, by each strategy from the beginning.

    Args:
        case: as of `run_case`; `strategies`, names of `CHOOSERS`

    Returns:
        strategy -> `recordings` until decided, null where it was not; `right`; `forecasts`, of each plan that left
        causes open: probability of a decision with one release more, and whether it came; and so on

    Raises:
        DprError: the device, the diagnosis or the seal failed, or another version is installed here.
    """
    import numba

    if case["version"] != __version__:
        raise DprError(f"this worker has dpr-lab {__version__}, the campaign is of {case['version']}: install the same")
    numba.set_num_threads(1)
    request = PlantRequest(Kind(case["kind"]), Level(case["level"]), case["seed"], plant=case["plant"])
    results = {}
    for name in case["strategies"]:
        with sealed_in_memory(request, case["rig"], direct=False) as plant:
            rig = parse_rig(plant.public["rig"])
            rng = np.random.default_rng([case["seed"], *name.encode()])
            done = played(rig, CHOOSERS[name], lambda release, before: _recorded(plant, rig, release, before), rng)
            truth = unsealed(plant.opened(), plant.public["seal"])
        results[name] = done | _judged(done.pop("diagnosis"), truth, rig)
    return {"outcome": results}


def played(rig: Rig, choose: Chooser, record: Record, rng: np.random.Generator, most: int = MOST) -> dict[str, Any]:
    """Choose, record and diagnose until the causes are decided.

    Args:
        rig: the rig
        choose: how the next release is chosen
        record: makes it
        rng: of what is chosen at random
        most: recordings, at most

    Returns:
        `recordings`, `forecasts`, `poses`, `ratio_std` after three, `plan_seconds`, and the last `diagnosis`
    """
    runs: list[Run] = []
    diagnosis: Diagnosis | None = None
    forecasts: list[dict[str, Any]] = []
    poses, spread, seconds, stopped = [], None, [], None
    while len(runs) < most:
        began = time.process_time()
        release, plan = choose(Situation(rig, runs, diagnosis, rng))
        if plan is not None:
            seconds.append(time.process_time() - began)
        runs.append(record(release, len(runs)))
        poses.append([release.theta1, release.theta2])
        if len(runs) < STOPPING.fewest:
            continue
        diagnosis = _diagnosed(runs, rig)
        over = decided(diagnosis, len(runs))
        if plan is not None and plan.forecast:
            forecasts.append({"after": len(runs) - 1, "stated": plan.forecast[0], "came": over})
        if len(runs) == 3:
            spread = np.sqrt(np.diag(np.array(diagnosis.ratio_covariance))).tolist()
        if over:
            stopped = len(runs)
            break
    return {
        "recordings": stopped,
        "forecasts": forecasts,
        "poses": poses,
        "ratio_std": spread,
        "plan_seconds": seconds,
        "diagnosis": diagnosis,
    }


def _diagnosed(runs: Sequence[Run], rig: Rig) -> Diagnosis:
    from dpr_lab.gap.diagnose import diagnose

    return diagnose(runs, rig)


def _recorded(plant: HeldPlant, rig: Rig, release: Release, before: int) -> Run:
    """Record a release on a sealed plant, as a run of its rig."""
    wanted: dict[str, Any] = {"theta1": release.theta1, "theta2": release.theta2, "duration_s": release.duration_s}
    if release.added is not None:
        wanted["added_mass"] = release.added.model_dump()
    recording = plant.record(wanted)
    pose = Pose(theta1=release.theta1, theta2=release.theta2)
    there = rig.model_copy(update={"poses": {recording["pose"]: pose}, "added_mass": release.added})
    return replace(run_of(recording, there), rig_sha256=rig.sha256)


def _judged(diagnosis: Diagnosis, truth: Truth, rig: Rig) -> dict[str, Any]:
    """Whether the last diagnosis names the causes, or that there are none."""
    outcome = score(diagnosis.to_json(), truth, rig, **truth.drawn, seconds=diagnosis.seconds)
    return {"right": outcome.grade == "right", "grade": outcome.grade, "score": outcome.to_json()}
