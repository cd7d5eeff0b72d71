"""Sequential trials: releases of a sealed plant are chosen, recorded and diagnosed until the causes are decided."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.planning.candidates import minutes, mounted_now
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.plan import plan
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.result import Plan
from dpr_lab.planning.signals import arm_input
from dpr_lab.planning.stopping import decided
from dpr_lab.rig import Rig, parse_rig
from dpr_lab.rig_tables import Pose
from dpr_lab.run import Run
from dpr_lab.trials.case import plant_of, run_of
from dpr_lab.trials.next_release import SEQUENTIAL, STRATEGIES, Chooser, Situation, limits_of
from dpr_lab.trials.score import score
from dpr_lab.trials.sealing import HeldPlant
from dpr_lab.trials.truth import Truth, unsealed

Record = Callable[[CandidateRelease], Run]
"""Function that records a release."""


def run_sequential_case(case: dict[str, Any]) -> dict[str, Any]:
    """Run a sequential trial of one sealed plant with each strategy.

    Args:
        case: the case as for `run_case`; the additional entry `strategies` contains names of `STRATEGIES`

    Returns:
        `outcome`: the score of the last diagnosis of the first strategy. `strategies`: a dict for each strategy with
        the entries `recordings`, the number of releases until the causes were decided or until only a bench check
        could decide them (None if neither occurred); `minutes`, the time at the rig; `right`, `true`
        (`TrialOutcome.is_true`) and `score` of the last diagnosis; `looks`, the state after each release

    Raises:
        DprError: the device, the diagnosis or the seal failed, or another version is installed here.
    """
    with plant_of(case, direct=False) as plant:
        rig = parse_rig(plant.public["rig"])
        results = {
            name: played(
                rig,
                STRATEGIES[name].choose,
                partial(_recorded, plant, rig),
                np.random.default_rng([case["seed"], *name.encode()]),
                limits_of(rig, plant.public.get("largest_input"), STRATEGIES[name].times),
            )
            for name in case["strategies"]
        }
        truth = unsealed(plant.opened(), plant.public["seal"])
    strategies = {name: _judged(result, truth, rig) for name, result in results.items()}
    return {"outcome": next(iter(strategies.values()))["score"], "strategies": strategies}


@dataclass(frozen=True, slots=True)
class SequentialLook:
    """State of a sequential trial after a release: diagnosis, stopping rule and forecast."""

    release: CandidateRelease
    diagnosis: Diagnosis
    """Diagnosis of all runs recorded so far."""
    decided: bool
    """Whether the recordings decide the causes."""
    bench_check: bool
    """Whether only a bench check can separate the remaining causes."""
    forecast: tuple[float, ...]
    """Probabilities that the causes are decided after this release, after the next release, and so on.

    They come from the plan that recommended this release; empty without such a plan.
    """
    plan_seconds: float | None
    """Processor time of the plan that recommended the release, s; None if no plan was used."""

    @property
    def is_last(self) -> bool:
        """Whether no further release is necessary."""
        return self.decided or self.bench_check


def played(
    rig: Rig,
    choose: Chooser,
    record: Record,
    rng: np.random.Generator,
    limits: PlanLimits,
    most: int = SEQUENTIAL.most,
) -> list[SequentialLook]:
    """Choose, record and diagnose releases until the recordings decide the causes.

    The trial also ends if only a bench check can decide the causes. This stopping rule is the same for all strategies
    and needs a plan, so a plan is computed after each release of every strategy.

    Args:
        rig: the rig
        choose: function that selects the next release
        record: function that records a release
        rng: random generator
        limits: limits of the plan
        most: maximum number of recordings

    Returns:
        a `SequentialLook` for each release
    """
    runs: list[Run] = []
    looks: list[SequentialLook] = []
    proposal: Plan | None = None
    seconds = 0.0
    while len(runs) < most and not (looks and looks[-1].is_last):
        began = time.process_time()
        release, used = choose(Situation(rig, runs, looks[-1].diagnosis if looks else None, rng, limits, proposal))
        seconds += time.process_time() - began
        runs.append(record(release))
        diagnosis = diagnose(runs, rig)
        is_decided = decided(diagnosis)
        forecast = tuple(used.forecast) if used else ()
        began = time.process_time()
        proposal = None if is_decided else plan(rig, runs, diagnosis, limits=limits, count=2)
        stuck = proposal is not None and proposal.state == "bench check"
        looks.append(SequentialLook(release, diagnosis, is_decided, stuck, forecast, seconds if used else None))
        seconds = time.process_time() - began
    return looks


def _recorded(plant: HeldPlant, rig: Rig, release: CandidateRelease) -> Run:
    """Record a release on a sealed plant, and return the run."""
    request: dict[str, Any] = {"theta1": release.theta1, "theta2": release.theta2, "duration_s": release.duration_s}
    if release.added is not None:
        request["added_mass"] = release.added.model_dump()
    if release.arm == "driven" and release.torques is not None:
        request["input"] = {"t": release.torques.t.tolist(), "values": arm_input(release.torques, rig).tolist()}
    recording = plant.record(request)
    pose = Pose(theta1=release.theta1, theta2=release.theta2)
    rig_there = rig.model_copy(update={"poses": {recording["pose"]: pose}, "added_mass": release.added})
    return replace(run_of(recording, rig_there), rig_sha256=rig.sha256)


def _minutes(releases: Sequence[CandidateRelease], rig: Rig) -> float:
    """Return the time at the rig for a sequence of releases, minutes; each step has its default duration."""
    mounted, total = mounted_now(rig), 0.0
    for release in releases:
        total += minutes(release, mounted, PlanLimits())
        mounted = release.mounted
    return total


def _judged(looks: Sequence[SequentialLook], truth: Truth, rig: Rig) -> dict[str, Any]:
    """Return the result of the sequential trial with one strategy as JSON values."""
    outcomes = [score(k.diagnosis.to_json(), truth, rig, **truth.drawn, seconds=k.diagnosis.seconds) for k in looks]
    return {
        "recordings": len(looks) if looks[-1].is_last else None,
        "minutes": _minutes([look.release for look in looks], rig),
        "right": outcomes[-1].grade == "right",
        "true": outcomes[-1].is_true,
        "score": outcomes[-1].to_json(),
        "looks": [
            {
                "theta": [look.release.theta1, look.release.theta2],
                "verdict": look.diagnosis.verdict,
                "named": list(outcome.named),
                "probability": [max(e.odds.values(), default=1.0) * e.probability for e in look.diagnosis.effects],
                "decided": look.decided,
                "bench_check": look.bench_check,
                "right": outcome.grade == "right",
                "duration_s": look.release.duration_s,
                "forecast": list(look.forecast),
                "ratio_std": np.sqrt(np.diag(np.array(look.diagnosis.ratio_covariance))).tolist(),
                "plan_seconds": look.plan_seconds,
            }
            for look, outcome in zip(looks, outcomes, strict=True)
        ],
    }
