"""From runs to a diagnosis: screen, bare model, where, which, how sure, how far, what next."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Effect
from dpr_lab.effects.families import expected_of
from dpr_lab.errors import RunError
from dpr_lab.estimation.motion import refuse_without_motion
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.advice.advise import advise
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.classes.posterior import effect_posterior
from dpr_lab.gap.conclusion.conclusion import Findings, conclude
from dpr_lab.gap.conclusion.description import description
from dpr_lab.gap.conclusion.uncertainty import covariance
from dpr_lab.gap.evidence.evidence import evidence
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.thresholds import far_from_noise
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.pieces import in_pieces
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.free_run import free_runs
from dpr_lab.gap.transfer.gap import gap
from dpr_lab.gap.transfer.out_of_sample import Unseen, held_out_runs
from dpr_lab.gap.transfer.transfer import transfer
from dpr_lab.gap.where.locate import locate
from dpr_lab.gap.which.select import select
from dpr_lab.gap.which.selected import Selection
from dpr_lab.identification.misread.refuse import refuse_negative_scale
from dpr_lab.identification.misread.solvable import solvable
from dpr_lab.progress import FitBegan, ScoreTestBegan, StageBegan
from dpr_lab.rig import Rig
from dpr_lab.run import Run, as_runs

STAGES = ("screen", "bare model", "where", "which", "classes", "how far", "advice", "evidence")
"""Names of the stages, in order."""


@solvable
def diagnose(
    runs: Run | Sequence[Run],
    rig: Rig,
    *,
    held_out: Run | Sequence[Run] = (),
    library: Mapping[str, Effect] | None = None,
    max_effects: int = 4,
    start: NDArray[np.float64] | None = None,
    seed: int = 0,
    on_progress: Callable[[StageBegan | FitBegan | ScoreTestBegan], None] | None = None,
) -> Diagnosis:
    """Say where simulation and rig differ, which effects cause it, how sure that is, and how much of it closes.

    Args:
        runs: what was recorded, one run or several; three releases or more tell effects apart best
        rig: lengths, masses and encoders
        held_out: recordings that only measure how far the gap closes
        library: the effects to choose from; all of `dpr_lab.effects.EFFECTS` by default
        max_effects: at most so many at once
        start: (7,) ratios, b and p/b to start from; the rig file's values by default
        seed: of the bootstrap; same seed, same answer
        on_progress: called with each stage, fit and score test as it begins

    Raises:
        RunError: no runs, or one that is too short or without motion.
        IdentificationError: known torques or masses fit only a negative inertia.
    """
    runs, held_out = as_runs(runs), as_runs(held_out)
    on_progress = on_progress or (lambda event: None)
    library = EFFECTS if library is None else library
    if not runs:
        raise RunError("no runs to diagnose")
    for run in (*runs, *held_out):
        refuse_without_motion(run, rig)

    def begin(stage: str) -> None:
        on_progress(StageBegan(STAGES.index(stage) + 1, len(STAGES), stage))

    began = time.perf_counter()
    begin("screen")
    runs, held_out, cut = in_pieces(runs, held_out)
    recordings, unseen = (Recordings(tuple(record(run, rig) for run in some), rig) for some in (runs, held_out))
    begin("bare model")
    begun = nominal_ratios(rig) if start is None else start
    recordings, problem, bare = fit_bare_model(recordings, begun)
    begin("where")
    places = locate(problem, bare)
    begin("which")
    setups = problem.segments.setups
    driven, arm_known = any(setup.torques for setup in setups), any(setup.arm for setup in setups)
    library = {
        name: effect
        for name, effect in library.items()
        if name not in problem.always
        and (driven or not effect.driven)
        and not (arm_known and effect.stage == "arm")  # it moves as it is known to
    }

    def choose(recordings: Recordings, problem: Problem, bare: Hypothesis) -> tuple[Unseen | None, Selection]:
        apart = held_out_runs(replace(unseen, ratios=recordings.ratios), bare) if unseen.records else None
        return apart, select(
            recordings,
            problem,
            bare,
            library,
            max_effects=max_effects,
            expected=expected_of(rig.joints.geared),
            unseen_chi2=None if apart is None else lambda at: float(apart.chi2(at).sum()),
            on_progress=on_progress,
        )

    apart, selection = choose(recordings, problem, bare)
    if problem.disturbance is not None and far_from_noise(selection.chosen):
        # What is left is no noise of the torques: it adds up along a segment, where to whiten is to look away from it.
        recordings, problem, bare = fit_bare_model(replace(recordings, exact_torques=True), begun)
        places = locate(problem, bare)
        apart, selection = choose(recordings, problem, bare)
    refuse_negative_scale(selection.chosen.fit.estimate.ratios, runs, rig)
    unseen = replace(unseen, ratios=recordings.ratios)
    begin("classes")
    posteriors = tuple(effect_posterior(selection, name) for name, _ in selection.path)
    begin("how far")
    transferred = transfer(recordings, apart, problem, selection, np.random.default_rng(seed))
    posteriors = transferred.judged(posteriors)
    described = description(runs, rig, selection, transferred)
    everything = recordings.only([*recordings.records, *unseen.records])
    models = {"before": selection.base, "after": selection.chosen}
    freely = {name: free_runs(everything, at.fit.estimate) for name, at in models.items()}
    size = gap(recordings, problem, selection, transferred, freely)
    begin("advice")
    advice = advise(recordings, selection.chosen, posteriors)
    spread = covariance(problem, selection.chosen, rig)
    findings = Findings(
        recordings, problem, selection, posteriors, transferred, described, places, size, tuple(advice), spread, cut
    )
    begin("evidence")
    rests_on = evidence(recordings, unseen, problem, selection, transferred, freely)
    return conclude(findings, rests_on, seconds=time.perf_counter() - began)
