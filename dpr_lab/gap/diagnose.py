"""Diagnosis of recordings, in the stages `STAGES`."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache

from dpr_lab.arrays import Array
from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Effect
from dpr_lab.effects.families import expected_of
from dpr_lab.errors import RunError
from dpr_lab.estimation.motion import refuse_without_motion
from dpr_lab.estimation.usable_runs import refuse_unusable
from dpr_lab.gap.advice.advise import advise
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.classes.posterior import effect_posterior
from dpr_lab.gap.conclusion.conclusion import conclude
from dpr_lab.gap.conclusion.description import description
from dpr_lab.gap.conclusion.own_scale import at_own_scale
from dpr_lab.gap.conclusion.uncertainty import whole_covariance
from dpr_lab.gap.corrections import ForwardSelected, corrected, with_other_noise
from dpr_lab.gap.damage.disturbances import without_disturbances
from dpr_lab.gap.evidence.evidence import evidence
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.input import refuse_wrong_input
from dpr_lab.gap.screen.pieces import in_pieces
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.screen.time_scale import with_time_scale
from dpr_lab.gap.state import Event, Fitted, Request, ScreenedRuns, Selected, Transferred
from dpr_lab.gap.transfer.free_run import free_runs
from dpr_lab.gap.transfer.gap_size import gap
from dpr_lab.gap.transfer.out_of_sample import held_out_prediction
from dpr_lab.gap.transfer.repeatability import gap_budget
from dpr_lab.gap.transfer.transfer import judged, transfer
from dpr_lab.gap.where.discrepancy import discrepancy
from dpr_lab.gap.where.locate import locate
from dpr_lab.gap.which.applicable import applicable
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.select import forward, refined
from dpr_lab.gap.which.sizes import refuse_rising
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
    """Diagnose the gap between simulation and rig: location, causes, probabilities, reduction.

    Args:
        runs: one recorded run or several; three releases or more distinguish effects best
        rig: lengths, masses and encoders
        held_out: recordings that are not fitted, and on which the reduction of the gap is measured
        library: effects to choose from, by name; by default, all of `dpr_lab.effects.EFFECTS`
        max_effects: maximum number of effects in the model
        start: (7,) initial ratios, b and p/b; by default, those of the rig file
        seed: seed of the bootstrap; the same seed gives the same result
        on_progress: function that is called at the start of each stage, fit and score test

    Raises:
        RunError: there are no runs, or a run is given twice, belongs to another rig, is too short, contains no motion,
            or contradicts its description.
        IdentificationError: a run has a gap that is too long, the known torques or masses fit only with a negative
            inertia, or the weight of the inner rod acts upwards in the selected model.
    """
    started = time.perf_counter()
    to_fit = as_runs(runs)
    named = with_distinct_names([*to_fit, *as_runs(held_out)])
    refuse_unusable(named, rig)
    request = Request(
        runs=named[: len(to_fit)],
        held_out=named[len(to_fit) :],
        rig=rig,
        library=EFFECTS if library is None else library,
        max_effects=max_effects,
        start=nominal_ratios(rig) if start is None else start,
        seed=seed,
        on_progress=on_progress or (lambda event: None),
    )
    preliminary = corrected(_forward_selected(_screened(request)), _forward_selected)
    state = _transferred(_selected(preliminary))
    _begin(request, "advice")
    advice = advise(state.fitted.recordings, state.selection.chosen, state.posteriors)
    _begin(request, "evidence")
    return conclude(state, advice, evidence(state), started)


def _begin(request: Request, stage: str) -> None:
    """Report the start of a stage."""
    request.on_progress(StageBegan(STAGES.index(stage) + 1, len(STAGES), stage))


def _screened(request: Request) -> ScreenedRuns:
    """Cut long records into pieces, and screen all runs.

    Raises:
        RunError: there are no runs, or a run contradicts its description.
    """
    if not request.runs:
        raise RunError("no runs to diagnose")
    for run in (*request.runs, *request.held_out):
        refuse_without_motion(run, request.rig)
    _begin(request, "screen")
    runs, held_out, division = in_pieces(request.runs, request.held_out)
    request = replace(request, runs=runs, held_out=held_out)
    to_fit, to_predict = (
        Recordings(tuple(record(run, request.rig) for run in group), request.rig) for group in (runs, held_out)
    )
    refuse_wrong_input(to_fit, request.start)
    return ScreenedRuns(request=request, recordings=to_fit, held_out=to_predict, division=division)


def _fitted(screened: ScreenedRuns) -> Fitted:
    """Fit the bare model and locate its residual; prepare the held-out runs with the same noise and shutter."""
    request = screened.request
    _begin(request, "bare model")
    recordings, problem, bare = fit_bare_model(screened.recordings, request.start)
    recordings = with_time_scale(recordings, bare.estimate.ratios)
    held_out = without_disturbances(screened.held_out, bare.estimate.ratios)
    held_out = replace(held_out, ratios=recordings.ratios, torque_noise_Nm=recordings.torque_noise_Nm)
    held_out = held_out.with_tracking_noise(recordings.tracking).with_shutter(recordings.shutter)
    prediction = held_out_prediction(held_out, bare) if held_out.records else None
    _begin(request, "where")
    return Fitted(
        request=request,
        recordings=recordings,
        held_out=held_out,
        division=screened.division,
        problem=problem,
        bare=bare,
        held_out_prediction=prediction,
        residual_maps=locate(problem, bare),
    )


def _forward_selected(screened: ScreenedRuns) -> ForwardSelected:
    """Fit the bare model, and add effects to it by forward selection."""
    fitted = _fitted(screened)
    request, prediction = fitted.request, fitted.held_out_prediction
    _begin(request, "which")
    library = applicable(request.library, fitted.problem, of_points=fitted.recordings.of_points)
    fitted_sets = FittedSets(
        fitted.recordings,
        fitted.problem,
        library,
        fitted.bare,
        request.on_progress,
        expected=frozenset(expected_of(request.rig.joints.geared)) & library.keys(),
        held_out_chi2=None if prediction is None else lambda model: float(prediction.chi2(model).sum()),
    )
    return ForwardSelected(fitted, forward(fitted_sets, request.max_effects))


def _selected(preliminary: ForwardSelected) -> Selected:
    """Refine the selected set, and compute the class of each effect in it.

    The refinement takes most of the time. If the refined set shows another noise of the known torques, selection and
    refinement are repeated once.
    """
    selection = refined(preliminary.search)
    if changed := with_other_noise(preliminary.fitted, selection.chosen):
        preliminary = _forward_selected(changed)
        selection = refined(preliminary.search)
    fitted, chosen = preliminary.fitted, selection.chosen
    refuse_impossible_scale(chosen.estimate.ratios, fitted.request.runs, fitted.request.rig, chosen.effects)
    _begin(fitted.request, "classes")
    selection = at_own_scale(selection, fitted.problem, fitted.request.rig)
    if selection.bare is not fitted.bare:
        fitted = replace(fitted, bare=selection.bare, residual_maps=locate(fitted.problem, selection.bare))
    return Selected(
        fitted=fitted,
        selection=selection,
        posteriors=tuple(effect_posterior(selection, name) for name, _ in selection.path),
    )


def _transferred(selected: Selected) -> Transferred:
    """Test the selected set on held-out data, and compute the size of the gap and the covariance."""
    fitted, selection = selected.fitted, selected.selection
    rig, recordings, problem, chosen = fitted.request.rig, fitted.recordings, fitted.problem, selection.chosen
    _begin(fitted.request, "transfer")
    everything = recordings.only([*recordings.records, *fitted.held_out.records])
    of_model = cache(lambda model: free_runs(everything, model.estimate, free=model.fit.free))
    simulated = {name: of_model(model) for name, model in selection.models.items()}
    outcome = transfer(selected, simulated)
    described = description(recordings.records, rig, problem, selection, outcome)
    if not described.withholds:
        refuse_rising(problem, chosen)
    budget = gap_budget(recordings, everything, problem, selection)
    remainder = discrepancy(problem, chosen)
    return Transferred(
        fitted=fitted,
        selection=selection,
        posteriors=judged(outcome, selected.posteriors, forced=described.forced, remainder=not chosen.at_noise_floor),
        free_runs=simulated,
        transfer=outcome,
        description=described,
        remainder=remainder,
        gap=gap(selected, outcome, simulated, budget, remainder),
        covariance=whole_covariance(problem, chosen, rig, remainder),
    )
