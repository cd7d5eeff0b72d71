"""Plan of the next recordings: releases, their expected information, and the stopping rule."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.acceptance.free_run import free_run_errors
from dpr_lab.acceptance.gain import with_gain
from dpr_lab.acceptance.judge import judge
from dpr_lab.errors import ConfigError
from dpr_lab.estimation.usable_runs import refuse_unusable
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.subject import refuse_other_subject
from dpr_lab.planning.candidates import cheapest_minutes, minutes, mounted_now
from dpr_lab.planning.knowledge import Acting, Knowledge, known_after, known_before
from dpr_lab.planning.limits import PlanLimits
from dpr_lab.planning.result import Plan
from dpr_lab.planning.sequence import Planner, SequenceStep
from dpr_lab.planning.signals import driven_releases
from dpr_lab.planning.stopping import STOPPING, decided, reservation
from dpr_lab.planning.summary import (
    NOTICEABLE,
    inseparable,
    inseparable_pairs,
    reason_for,
    separable_gain,
    summed_up,
)
from dpr_lab.planning.worth.criteria import ratio_std
from dpr_lab.planning.worth.objective import Objective
from dpr_lab.rig import Rig
from dpr_lab.run import Run, as_runs


@dataclass(frozen=True, slots=True)
class PlanLength:
    """Number of releases in a plan."""

    usual: int = 3
    """Maximum number of releases in a plan without a budget; three releases distinguish most effects."""
    optional: int = 1
    """Number of releases if the causes are decided, but effects are not excluded."""
    most: int = 12
    """Maximum number of releases in a plan with a budget."""


LENGTH = PlanLength()


def plan(
    rig: Rig,
    runs: Run | Sequence[Run] = (),
    diagnosis: Diagnosis | None = None,
    *,
    limits: PlanLimits | None = None,
    budget_min: float | None = None,
    count: int | None = None,
    seed: int = 0,
) -> Plan:
    """Plan the next recordings of a rig.

    If there is no budget, up to three releases are planned. Once the causes and all limits are decided, the plan
    contains no release, or one release that tests the effects that are not excluded.

    Args:
        rig: the rig
        runs: the runs recorded so far; may be empty
        diagnosis: diagnosis of these runs; None: the function diagnoses them
        limits: reachable poses, permitted mountings, drives, and the duration of each step
        budget_min: time at the rig, minutes
        count: maximum number of releases; None: the number is chosen as described above
        seed: seed of the search for start poses

    Returns:
        the planned releases, their expected information, and whether further releases are necessary

    Raises:
        ConfigError: the budget is too small for one release, or no pose can be reached; or the diagnosis was made with
            another description of the rig.
        RunError: a run is given twice, cannot be used, or belongs to another rig; or the diagnosis belongs to other
            runs.

    Source: docs/theory.md, section 15.
    """
    limits, runs = limits or PlanLimits(), as_runs(runs)
    refuse_unusable(runs, rig)
    if budget_min is not None and budget_min < (least := cheapest_minutes(rig, limits)):
        raise ConfigError(
            f"a budget of {budget_min:.2g} min is too small: one release takes {least:.2g} min (place, release and"
            f" record {limits.recording.shortest_s:g} s). Raise the budget, or lower recording.shortest_s or"
            " minutes.place in the limits file"
        )
    if diagnosis is not None:
        refuse_other_subject(diagnosis, runs, rig)
    elif runs:
        diagnosis = diagnose(runs, rig)
    started, acting = time.perf_counter(), Acting.of(rig, limits)
    known = known_after(runs, rig, diagnosis, acting) if runs and diagnosis else known_before(rig, acting)
    if runs and diagnosis and limits.has_any:
        free = limits.free_run
        errors = free_run_errors(runs, rig, diagnosis, free.horizon_s) if free else {}
        tested = judge(with_gain(diagnosis, runs, rig), limits, errors).limits
        undecided = tuple(limit.quantity for limit in tested if limit.answer == "not decidable")
        known = replace(known, free_run_rad=tuple(errors.values()), open_limits=undecided)
    objective = Objective.of(known, limits)
    planner = Planner(objective, limits, np.random.default_rng(seed), driven_releases(known.model, limits, rig))
    most = count
    if most is None:
        most = usual_count(known) if budget_min is None else LENGTH.most
    steps = worthwhile(objective, planner.sequence(most, budget_min) if most else [], limits)
    return summed_up(objective, steps, limits, time.perf_counter() - started)


def worthwhile(objective: Objective, steps: Sequence[SequenceStep], limits: PlanLimits) -> list[SequenceStep]:
    """Omit the releases, after the first two, that add no noticeable information to the earlier ones."""
    known, useful = objective.known, list[SequenceStep]()
    F, mounted = known.information, mounted_now(known.rig)
    stuck = inseparable(objective, inseparable_pairs(objective, steps, objective.separated(F)))
    for step in steps:
        then = F + step.information
        before, after = separable_gain(objective, F, stuck), separable_gain(objective, then, stuck)
        share = 1 - float(np.exp(np.log(ratio_std(known, then) / ratio_std(known, F)).mean()))
        if len(useful) < STOPPING.fewest or share >= NOTICEABLE.ratios or reason_for(before, after):
            useful.append(replace(step, minutes=minutes(step.release, mounted, limits)))
            F, mounted = then, step.release.mounted
    return useful


def usual_count(known: Knowledge) -> int:
    """Return the maximum number of releases in a plan without a budget.

    If the causes and all limits are decided, it is `LENGTH.optional` while another effect is not excluded, otherwise 0.
    """
    if known.diagnosis is None or not decided(known.diagnosis) or known.open_limits:
        return LENGTH.usual
    return LENGTH.optional if reservation(known.diagnosis) else 0
