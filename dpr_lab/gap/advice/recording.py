"""Checks by a recording of the release in which two causes differ most."""

from collections.abc import Mapping, Sequence

import numpy as np

from dpr_lab.effects import EFFECTS, effect_params, without_effect
from dpr_lab.errors import RunError
from dpr_lab.estimation.usable_runs import refuse_other_rigs
from dpr_lab.fitting.estimate import Estimate, moved
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.advice.check_kind import CheckAnswer, OpenQuestion, Result, expected_bits, log_mean
from dpr_lab.gap.advice.expected_recordings import ExpectedRecording
from dpr_lab.gap.advice.measurement import CHECK
from dpr_lab.gap.bare_model import fit_bare_model
from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, free_parameters, hypothesis
from dpr_lab.gap.hypothesis.refits import refit, refit_with, shaped
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest, score_test
from dpr_lab.gap.result.checks import NONE_OF_THEM, AdvisedCheck
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.as_diagnosed import recordings_as_in
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.run import torque_kinds

DISTINGUISHED = 5.0
"""Minimum distance of two causes in a recommended recording, in standard deviations of the noise."""


def form(check: AdvisedCheck) -> str:
    """Describe the command-line argument that gives the result of a recording."""
    return "its run files"


def propose(question: OpenQuestion, proposed: Sequence[AdvisedCheck]) -> list[AdvisedCheck]:
    """Propose, for each other cause, the release in which it differs most from the named effect.

    No release is proposed for a cause that no release distinguishes.
    """
    checks: list[AdvisedCheck] = []
    if not question.expected:
        return checks
    about, probability = question.about, question.causes
    for other in (name for name in question.causes if name != about):
        # a richer form may have a size that a simpler form cannot reproduce, so both directions are tested
        pairs = ((about, other), (other, about)) if question.one_class else ((about, other),)
        best, separation = _most_different(question, pairs)
        if best is None:
            continue
        spread = np.sqrt(question.chosen.inflation * CALIBRATION.temperature)
        bits = expected_bits([probability[about], probability[other]], separation / spread)
        check = question.check("recording", f"Record {best.text}.", (about, other), bits)
        checks.append(check.model_copy(update={"release": best.release}))
    return checks


def _most_different(question: OpenQuestion, pairs: Sequence[tuple[str, str]]) -> tuple[ExpectedRecording | None, float]:
    """Return the release in which the predictions of two causes differ most, and their distance.

    The distance is in standard deviations of the noise. For members of a class, a fit to simulated readings must
    confirm it. The release is None, and the distance 0, if no release distinguishes the causes.
    """
    separations = [max(expected.distance(*pair) for pair in pairs) for expected in question.expected]
    for best in np.argsort(separations)[::-1].tolist():
        expected, separation = question.expected[best], separations[best]
        if question.one_class and separation >= DISTINGUISHED:
            separation = min(separation, _distance_after_fits(expected, *pairs[0]))
        if separation >= DISTINGUISHED:
            return expected, separation
    return None, 0.0


def _distance_after_fits(expected: ExpectedRecording, name: str, other: str) -> float:
    """Fit one of two causes to a simulation of the other, and return the distance.

    A richer form can imitate its simpler form, so only the simpler form is fitted to readings of the richer one. For
    other causes, each is fitted to readings of the other, and the smaller distance counts, because a fit may end before
    its minimum.
    """
    if name in EFFECTS[other].nested:
        return expected.distance_after_fit(other, name)
    first = expected.distance_after_fit(name, other)
    if first < DISTINGUISHED or other in EFFECTS[name].nested:
        return first
    return min(first, expected.distance_after_fit(other, name))


def result(diagnosis: Diagnosis, check: AdvisedCheck, answer: CheckAnswer, prior: Mapping[str, float]) -> Result:
    """Return the tempered likelihood of the runs of a check under each candidate.

    Each candidate is fitted to these runs. A cause outside the candidates has their mean likelihood, so that its
    probability does not change.

    Raises:
        RunError: the runs cannot show the named effect, belong to another rig, or no candidate can be fitted to them.
    """
    open_ones = {check.about, *check.splits, *(r.name for r in diagnosis.rivals if r.instead_of == check.about)}
    fitted = _fitted(diagnosis, check.about, [name for name in prior if name in open_ones], answer)
    if check.about not in fitted:
        raise RunError(f"these runs cannot show {check.about}: record the release of check {check.id}")
    best = min(fitted.values(), key=lambda candidate: candidate.cost)
    if not np.isfinite(best.cost):
        raise RunError(f"no candidate of check {check.id} can be fitted to these runs: record the release again")
    unit = CALIBRATION.unit(best.inflation)
    worse = {name: (candidate.cost - best.cost) / unit for name, candidate in fitted.items()}
    # the density of a candidate that cannot be simulated is practically zero; its logarithm must be finite
    densities = {name: -float(np.nan_to_num(difference, posinf=1e6)) for name, difference in worse.items()}
    # indistinguishable members have the same likelihood as the named effect
    densities |= {name: densities[check.about] for name in prior if name not in densities}
    average = log_mean(np.array([densities[name] for name in prior]), np.array(list(prior.values())))
    driven = "".join(f", driven by {kind} torques" for kind in torque_kinds(answer.runs))
    words = f"recorded: {', '.join(run.name for run in answer.runs)}{driven}"
    return Result(words, {**densities, NONE_OF_THEM: average})


def _fitted(diagnosis: Diagnosis, about: str, names: Sequence[str], answer: CheckAnswer) -> dict[str, Hypothesis]:
    """Fit each candidate to the runs, together with the other effects of the diagnosed model.

    The fits start from the bare model and, if the named effect is part of the diagnosed model, also from this model.
    The better fit of each candidate is returned.
    """
    if answer.rig is None:
        raise RunError("state the rig file of the recorded runs")
    rig = answer.rig
    refuse_other_rigs(answer.runs, rig)
    if diagnosis.evidence is not None and rig.name != diagnosis.evidence.rig:
        raise RunError(
            f"{answer.runs[0].file or answer.runs[0].name}: is a run of rig {rig.name}, but the diagnosis is of rig"
            f" {diagnosis.evidence.rig}: record the release of the check with that rig"
        )
    recordings = recordings_as_in(diagnosis, answer.runs, rig)
    recordings, problem, bare = fit_bare_model(recordings, diagnosis.unknowns)
    others = {name: values for name, values in diagnosis.model_effects.items() if name != about}
    without = _with_effects(problem, bare.estimate, others) if others else bare
    test = _test(recordings, problem, without, names)
    fits = {
        name: refit_with(problem, without, test, score, CHECK.iterations)
        for name in names
        if (score := test.best_score(name)) is not None
    }
    if about not in fits or about not in diagnosis.model_effects:
        return fits
    diagnosed = bare.estimate.changed(ratios=diagnosis.unknowns, params=effect_params(diagnosis.model_effects))
    named = _with_effects(problem, _with_states(problem, recordings, diagnosed), diagnosis.model_effects)
    test = _test(recordings, problem, named, [name for name in fits if name != about])
    exchanged = {about: named} | {
        name: _exchanged(problem, named, about, score) for name in fits if (score := test.best_score(name)) is not None
    }
    return {
        name: min(model, exchanged.get(name, model), key=lambda fitted: fitted.cost) for name, model in fits.items()
    }


def _with_states(problem: Problem, recordings: Recordings, model: Estimate) -> Estimate:
    """Fit the initial state of each segment to the readings, and keep all other values of the model.

    The fits start from the states of the model, from the readings, and from the readings at rest. The best of the three
    is chosen for each segment, because a segment in which dry friction stops a rod has several local minima.
    """
    _, measured = recordings.cut(recordings.working_length)
    at_rest = measured * np.array([1.0, 1.0, 0.0, 0.0, 1.0, 0.0])[: measured.shape[1]]
    starts = [model.changed(initial=initial) for initial in (model.initial, measured, at_rest)]
    fits = [fit(problem, start, (), iterations=CHECK.iterations) for start in starts]
    chi2 = np.array([np.nan_to_num(fitted.linear.chi2_by_segment, nan=np.inf) for fitted in fits])
    states = np.array([fitted.estimate.initial for fitted in fits])
    return model.changed(initial=states[chi2.argmin(axis=0), range(len(measured))])


def _exchanged(problem: Problem, named: Hypothesis, about: str, score: Score) -> Hypothesis:
    """Replace the named effect of a fitted set by another effect, and fit this set.

    The fit starts from the ratios of the fitted set, and from the size whose linear signature is closest to that of the
    named effect. A fit that starts from the bare model can end in a local minimum. For example, in a release that soon
    comes to rest, an excessive viscous friction can replace the Coulomb friction.
    """
    start = shaped(named, score)
    free = free_parameters(start, (*named.effects, score.effect.name), problem)
    A, _ = fit(problem, start, free, iterations=0).linear.flat
    old = [i for i, parameter in enumerate(free) if parameter.effect == about and parameter.amplitude]
    new = [i for i, parameter in enumerate(free) if parameter.effect == score.effect.name and parameter.amplitude]
    signature = A[:, old] @ np.array([free[i].read(start) for i in old])
    sizes = np.asarray(np.linalg.lstsq(A[:, new], signature, rcond=1e-10)[0], dtype=np.float64)
    without = start.changed(params=without_effect(start.params, about))
    exchanged = moved(without, [free[i] for i in new], sizes, np.zeros_like(without.initial))
    names = tuple(score.effect.name if name == about else name for name in named.effects)
    return refit(problem, exchanged, names, CHECK.iterations)


def _with_effects(problem: Problem, start: Estimate, effects: Mapping[str, Mapping[str, float]]) -> Hypothesis:
    """Fit a set of effects with given initial sizes."""
    initial = start.changed(params=effect_params(effects))
    free = free_parameters(initial, tuple(effects), problem)
    return hypothesis(problem, tuple(effects), fit(problem, initial, free, iterations=CHECK.iterations))


def _test(recordings: Recordings, problem: Problem, model: Hypothesis, names: Sequence[str]) -> ScoreTest:
    """Compute the score test of the effects `names`, which a model of the new runs does not contain."""
    return score_test(problem, model.fit, [EFFECTS[name] for name in names], recordings.properties)
