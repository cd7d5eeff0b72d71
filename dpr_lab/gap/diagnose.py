"""The diagnosis in stages: screening, bare model, location, selection, classes, transfer, advice, evidence."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Effect
from dpr_lab.effects.families import expected_of
from dpr_lab.errors import RunError
from dpr_lab.estimation.motion import refuse_without_motion
from dpr_lab.gap.advice.advise import advise
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.classes.posterior import effect_posterior
from dpr_lab.gap.conclusion.at_bounds import second_moments
from dpr_lab.gap.conclusion.conclusion import conclude
from dpr_lab.gap.conclusion.description import description
from dpr_lab.gap.conclusion.uncertainty import covariance
from dpr_lab.gap.evidence.evidence import evidence
from dpr_lab.gap.known_torques import earlier_share, no_worse, with_other_noise
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.rolling_shutter import explains_more, likeliest_shutter
from dpr_lab.gap.screen.disturbances import without_disturbances
from dpr_lab.gap.screen.input import refuse_wrong_input
from dpr_lab.gap.screen.pieces import in_pieces
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.screen.time_scale import with_time_scale
from dpr_lab.gap.state import (
    Advised,
    Classified,
    Event,
    Fitted,
    Located,
    Request,
    ScreenedRuns,
    Selected,
    Supported,
    Transferred,
)
from dpr_lab.gap.transfer.free_run import free_runs
from dpr_lab.gap.transfer.free_swing import expected_errors, free_swings
from dpr_lab.gap.transfer.gap_size import gap
from dpr_lab.gap.transfer.out_of_sample import held_out_prediction
from dpr_lab.gap.transfer.repeatability import gap_budget
from dpr_lab.gap.transfer.transfer import transfer
from dpr_lab.gap.where.discrepancy import discrepancy
from dpr_lab.gap.where.locate import locate
from dpr_lab.gap.which.applicable import applicable
from dpr_lab.gap.which.select import Draft, forward, refined
from dpr_lab.identification.misread.refuse import refuse_impossible_scale
from dpr_lab.identification.misread.solvable import solvable
from dpr_lab.progress import StageBegan
from dpr_lab.rig import Rig
from dpr_lab.run import Run, as_runs, with_distinct_names

STAGES = ("screen", "bare model", "where", "which", "classes", "transfer", "advice", "evidence")
"""Names of the stages, in order."""


@solvable
def diagnose(
    runs: Run | Sequence[Run],
    rig: Rig,
    *,
    held_out: Run | Sequence[Run] = (),
    library: Mapping[str, Effect] | None = None,
    max_effects: int = 4,
    start: Array | None = None,
    seed: int = 0,
    on_progress: Callable[[Event], None] | None = None,
) -> Diagnosis:
    """Diagnose the gap between simulation and rig: its location, its causes, their probabilities, its reduction.

    Args:
        runs: one recorded run or several; three releases or more distinguish effects best
        rig: lengths, masses and encoders
        held_out: recordings that are not fitted, to measure the reduction of the gap
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
    to_fit = as_runs(runs)
    named = with_distinct_names([*to_fit, *as_runs(held_out)])
    request = Request(
        runs=named[: len(to_fit)],
        held_out=named[len(to_fit) :],
        rig=rig,
        library=EFFECTS if library is None else library,
        max_effects=max_effects,
        start=nominal_ratios(rig) if start is None else start,
        seed=seed,
        on_progress=on_progress or _silent,
    )
    screened = _screened(request)
    fitted = _fitted(screened)
    located = _located(fitted)
    selected = _selected(located)
    classified = _classified(selected)
    transferred = _transferred(classified)
    advised = _advised(transferred)
    supported = _supported(advised)
    return conclude(supported, seconds=time.perf_counter() - started)


def _begin(request: Request, stage: str) -> None:
    """Report the start of a stage."""
    request.on_progress(StageBegan(STAGES.index(stage) + 1, len(STAGES), stage))


def _screened(request: Request) -> ScreenedRuns:
    if not request.runs:
        raise RunError("no runs to diagnose")
    for run in (*request.runs, *request.held_out):
        refuse_without_motion(run, request.rig)
    _begin(request, "screen")
    runs, held_out, cut = in_pieces(request.runs, request.held_out)
    request = replace(request, runs=runs, held_out=held_out)
    to_fit, to_predict = (
        Recordings(tuple(record(run, request.rig) for run in group), request.rig) for group in (runs, held_out)
    )
    refuse_wrong_input(to_fit, request.start)
    return ScreenedRuns(request=request, recordings=to_fit, held_out=to_predict, cut=cut)


def _fitted(screened: ScreenedRuns) -> Fitted:
    _begin(screened.request, "bare model")
    recordings, problem, bare = fit_bare_model(screened.recordings, screened.request.start)
    recordings = with_time_scale(recordings, bare.fit.estimate.ratios)
    held_out = without_disturbances(screened.held_out, bare.fit.estimate.ratios)
    held_out = replace(held_out, ratios=recordings.ratios, torque_noise_Nm=recordings.torque_noise_Nm)
    held_out = held_out.with_tracking(recordings.tracking).with_shutter(recordings.shutter)
    return Fitted.after(
        screened,
        recordings=recordings,
        held_out=held_out,
        problem=problem,
        bare=bare,
        held_out_prediction=held_out_prediction(held_out, bare) if held_out.records else None,
    )


def _located(fitted: Fitted) -> Located:
    _begin(fitted.request, "where")
    return Located.after(fitted, places=locate(fitted.problem, fitted.bare))


def _selected(located: Located) -> Selected:
    """The selected set of effects.

    Known torques initially have noise. The set of forward selection shows whether this noise is real (`known_torques`);
    if not, the bare model is fitted and the effects are searched again. This is decided before the set is refined,
    which takes most of the time, and once more for the refined set.
    """
    located, draft = _with_torque_model(located, _drafted(located))
    located, draft = _with_shutter(located, draft)
    selected = Selected.after(located, selection=refined(draft))
    if changed := with_other_noise(selected.recordings, selected.problem, selected.selection.chosen):
        located, draft = _searched_again(replace(located, recordings=changed))
        selected = Selected.after(located, selection=refined(draft))
    refuse_impossible_scale(selected.selection.chosen.fit.estimate.ratios, selected.request.runs, selected.request.rig)
    return selected


def _with_torque_model(located: Located, draft: Draft, most_changes: int = 2) -> tuple[Located, Draft]:
    """Repeat forward selection with the noise and the intermediate values of known torques that its result implies."""
    for _ in range(most_changes):
        changed = with_other_noise(located.recordings, located.problem, draft.model)
        if changed is None:
            break
        located, draft = _searched_again(replace(located, recordings=changed))
    if share := earlier_share(located.recordings, draft.model):
        recordings, held_out = (runs.with_earlier_torques(share) for runs in (located.recordings, located.held_out))
        located_earlier, draft_earlier = _searched_again(replace(located, recordings=recordings, held_out=held_out))
        if no_worse(draft.model, draft_earlier.model):
            return located_earlier, draft_earlier
    return located, draft


def _with_shutter(located: Located, draft: Draft) -> tuple[Located, Draft]:
    """Forward selection with readings that are corrected for a rolling shutter, if they are explained better.

    First the bare model proposes the delay, because an effect may imitate a part of it. Then the selected set does,
    which contains other causes.
    """
    for selected in (False, True):
        model = draft.model if selected else located.bare
        shutter = likeliest_shutter(located.recordings, located.problem, model)
        if shutter is None:
            continue
        known = located.recordings.shutter is not None
        recordings = located.recordings.with_shutter(shutter)
        corrected, corrected_draft = _searched_again(replace(located, recordings=recordings))
        if known or explains_more(draft.model, corrected_draft.model):
            located, draft = corrected, corrected_draft
    return located, draft


def _searched_again(located: Located) -> tuple[Located, Draft]:
    """Fit the bare model to changed recordings and repeat forward selection."""
    located = _located(_fitted(located))
    return located, _drafted(located)


def _drafted(located: Located) -> Draft:
    request, prediction = located.request, located.held_out_prediction
    _begin(request, "which")
    return forward(
        located.recordings,
        located.problem,
        located.bare,
        applicable(request.library, located.problem, of_points=located.recordings.of_points),
        max_effects=request.max_effects,
        expected=expected_of(request.rig.joints.geared),
        held_out_chi2=None if prediction is None else lambda model: float(prediction.chi2(model).sum()),
        on_progress=request.on_progress,
    )


def _classified(selected: Selected) -> Classified:
    _begin(selected.request, "classes")
    selection = selected.selection
    posteriors = tuple(effect_posterior(selection, name) for name, _ in selection.path)
    return Classified.after(selected, posteriors=posteriors)


def _transferred(before: Classified) -> Transferred:
    request, recordings, problem, selection = before.request, before.recordings, before.problem, before.selection
    _begin(request, "transfer")
    everything = recordings.only([*recordings.records, *before.held_out.records])
    runs_by_model = {name: free_runs(everything, model.fit.estimate) for name, model in selection.models.items()}
    rng = np.random.default_rng(request.seed)
    swings = free_swings(runs_by_model["before"], selection.base)
    expected = expected_errors(swings, selection.base.residuals.independent_noise)
    transferred = transfer(recordings, before.held_out_prediction, problem, selection, runs_by_model, expected, rng)
    budget = gap_budget(recordings, everything, problem, selection)
    remainder = discrepancy(problem, selection.chosen)
    return Transferred.after(
        before,
        posteriors=transferred.judged(before.posteriors),
        free_runs=runs_by_model,
        transfer=transferred,
        description=description(recordings.records, request.rig, problem, selection, transferred),
        remainder=remainder,
        gap=gap(recordings, problem, selection, transferred, runs_by_model, budget, remainder),
    )


def _advised(before: Transferred) -> Advised:
    _begin(before.request, "advice")
    chosen = before.selection.chosen
    return Advised.after(
        before,
        advice=tuple(advise(before.recordings, chosen, before.posteriors)),
        covariance=covariance(before.problem, chosen, before.request.rig, before.remainder)
        + second_moments(before.problem, chosen.fit, chosen.residuals.inflation),
    )


def _supported(before: Advised) -> Supported:
    _begin(before.request, "evidence")
    parts = evidence(
        before.recordings, before.held_out, before.problem, before.selection, before.transfer, before.free_runs
    )
    return Supported.after(before, evidence=parts)


def _silent(event: Event) -> None:
    """Report no progress."""
