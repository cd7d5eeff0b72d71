"""The diagnosis in stages: screening, bare model, location, selection, classes, transfer, advice, evidence."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.drive_gain import DRIVE_GAIN
from dpr_lab.effects.effect import Effect
from dpr_lab.effects.families import expected_of
from dpr_lab.effects.free_arm import FREE_ARM
from dpr_lab.effects.torque_scale import TORQUE_SCALE_JOINT0
from dpr_lab.errors import RunError
from dpr_lab.estimation.motion import refuse_without_motion
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.advice.advise import advise
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios, with_likeliest_noise
from dpr_lab.gap.classes.posterior import effect_posterior
from dpr_lab.gap.conclusion.conclusion import Findings, conclude
from dpr_lab.gap.conclusion.description import description
from dpr_lab.gap.conclusion.uncertainty import covariance
from dpr_lab.gap.evidence.evidence import evidence
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.thresholds import far_from_noise
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.disturbances import without_disturbances
from dpr_lab.gap.screen.input import refuse_wrong_input
from dpr_lab.gap.screen.pieces import in_pieces
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.transfer.free_run import free_runs
from dpr_lab.gap.transfer.gap import gap
from dpr_lab.gap.transfer.out_of_sample import Unseen, held_out_runs
from dpr_lab.gap.transfer.repeatability import gap_budget
from dpr_lab.gap.transfer.transfer import transfer
from dpr_lab.gap.where.discrepancy import discrepancy
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

Event = StageBegan | FitBegan | ScoreTestBegan


@dataclass(frozen=True, slots=True)
class Request:
    """Options of a diagnosis."""

    rig: Rig
    library: Mapping[str, Effect]
    """Effects to choose from."""
    max_effects: int
    start: NDArray[np.float64] | None
    """(7,) initial ratios, b and p/b; None for the values of the rig file."""
    on_progress: Callable[[Event], None]

    def begin(self, stage: str) -> None:
        """Report the start of a stage."""
        self.on_progress(StageBegan(STAGES.index(stage) + 1, len(STAGES), stage))


@dataclass(frozen=True, slots=True)
class Fitted:
    """The recordings with the bare model fitted to them."""

    recordings: Recordings
    problem: Problem
    bare: Hypothesis
    unseen: Recordings
    """Recordings that take no part in any fit, without what disturbed them."""
    held_out: Unseen | None
    """The same as the bare model follows them; None where there are none."""


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
    on_progress: Callable[[Event], None] | None = None,
) -> Diagnosis:
    """Diagnose the gap between simulation and rig: its location, its causes, their probabilities, its reduction.

    If known torques drive the rods, their noise is at first part of the model. If the residual of the selected effects
    far exceeds the noise, the torques are assumed to be exact, and the bare model and the effects are fitted again: an
    error that accumulates along a segment is not torque noise, and whitening would hide it.

    Args:
        runs: one recorded run or several; three releases or more distinguish effects best
        rig: lengths, masses and encoders
        held_out: recordings that only measure the reduction of the gap
        library: the effects to choose from; all of `dpr_lab.effects.EFFECTS` by default
        max_effects: maximum number of effects in the model
        start: (7,) initial ratios, b and p/b; the rig file's values by default
        seed: of the bootstrap; the same seed gives the same result
        on_progress: called at the start of each stage, fit and score test

    Raises:
        RunError: no runs, or one that is too short or without motion.
        IdentificationError: known torques or masses fit only a negative inertia.
    """
    started = time.perf_counter()
    runs, held_out = as_runs(runs), as_runs(held_out)
    if not runs:
        raise RunError("no runs to diagnose")
    for run in (*runs, *held_out):
        refuse_without_motion(run, rig)
    request = Request(rig, EFFECTS if library is None else library, max_effects, start, on_progress or _silent)

    request.begin("screen")
    runs, held_out, cut = in_pieces(runs, held_out)
    recordings, unseen = (Recordings(tuple(record(run, rig) for run in some), rig) for some in (runs, held_out))
    refuse_wrong_input(recordings, nominal_ratios(rig) if start is None else start)
    request.begin("bare model")
    fitted = _fitted(request, recordings, unseen)
    request.begin("where")
    places = locate(fitted.problem, fitted.bare)
    request.begin("which")
    selection = _selected(request, fitted)
    if other := _with_other_noise(fitted, selection.chosen):
        fitted = _fitted(request, other, fitted.unseen)
        places, selection = locate(fitted.problem, fitted.bare), _selected(request, fitted)
    refuse_negative_scale(selection.chosen.fit.estimate.ratios, runs, rig)
    recordings, problem, unseen = fitted.recordings, fitted.problem, fitted.unseen
    request.begin("classes")
    posteriors = tuple(effect_posterior(selection, name) for name, _ in selection.path)
    request.begin("how far")
    everything = recordings.only([*recordings.records, *unseen.records])
    models = {"before": selection.base, "after": selection.chosen}
    freely = {name: free_runs(everything, model.fit.estimate) for name, model in models.items()}
    carried = transfer(recordings, fitted.held_out, problem, selection, freely, np.random.default_rng(seed))
    posteriors = carried.judged(posteriors)
    described = description(runs, rig, selection, carried)
    repeats = gap_budget(recordings, everything, problem, selection)
    remainder = discrepancy(problem, selection.chosen)
    size = gap(recordings, problem, selection, carried, freely, repeats, remainder)
    request.begin("advice")
    advice = tuple(advise(recordings, selection.chosen, posteriors))
    spread = covariance(problem, selection.chosen, rig, remainder)
    findings = Findings(
        recordings, problem, selection, posteriors, carried, described, places, size, advice, spread, remainder, cut
    )
    request.begin("evidence")
    unseen = replace(unseen, ratios=recordings.ratios, torque_noise_Nm=recordings.torque_noise_Nm)
    rests_on = evidence(recordings, unseen, problem, selection, carried, freely)
    return conclude(findings, rests_on, seconds=time.perf_counter() - started)


def _fitted(request: Request, recordings: Recordings, unseen: Recordings) -> Fitted:
    start = nominal_ratios(request.rig) if request.start is None else request.start
    recordings, problem, bare = fit_bare_model(recordings, start)
    unseen = without_disturbances(unseen, bare.fit.estimate.ratios)
    alike = replace(unseen, ratios=recordings.ratios, torque_noise_Nm=recordings.torque_noise_Nm)
    held_out = held_out_runs(alike, bare) if unseen.records else None
    return Fitted(recordings, problem, bare, unseen, held_out)


def _with_other_noise(fitted: Fitted, model: Hypothesis) -> Recordings | None:
    """The recordings with less or no noise of their torques, if the selected model requires it."""
    if fitted.problem.disturbance is not None and far_from_noise(model):
        return replace(fitted.recordings, exact_torques=True)
    return with_likeliest_noise(fitted.recordings, fitted.problem, model)


def _selected(request: Request, fitted: Fitted) -> Selection:
    held_out = fitted.held_out
    return select(
        fitted.recordings,
        fitted.problem,
        fitted.bare,
        applicable(request.library, fitted.problem),
        max_effects=request.max_effects,
        expected=expected_of(request.rig.joints.geared),
        unseen_chi2=None if held_out is None else lambda model: float(held_out.chi2(model).sum()),
        on_progress=request.on_progress,
    )


def applicable(library: Mapping[str, Effect], problem: Problem) -> dict[str, Effect]:
    """The effects of a library that can act in these recordings and are not always fitted."""
    setups = problem.segments.setups
    driven = {
        "rods": any(setup.torques and setup.torques.joints.any() and setup.inner is None for setup in setups),
        "arm": any(setup.torques and setup.torques.on_arm is not None for setup in setups),
    }
    of_stage = {"drive": driven["rods"], "drive0": driven["arm"], "input": any(driven.values())}
    moves = problem.segments.arm_moves
    arm_known = moves or any(setup.arm for setup in setups)
    known = DRIVE_GAIN.name not in problem.always and not any(s.torques and s.torques.scaled for s in setups)
    fixed = {FREE_ARM.name, DRIVE_GAIN.name, *([] if known else [TORQUE_SCALE_JOINT0.name])}
    return {
        name: effect
        for name, effect in library.items()
        if name not in problem.always
        and name not in fixed
        and of_stage.get(effect.stage, True)
        and (moves or not effect.of_arm)
        and not (arm_known and effect.stage == "arm")  # the arm's motion is prescribed, or computed
    }


def _silent(event: Event) -> None:
    """Report no progress."""
