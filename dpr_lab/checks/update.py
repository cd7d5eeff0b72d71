"""Update of a diagnosis by the result of a recommended check.

The hypotheses about one named effect are its candidates (the members of its class, equally probable before any check,
and its alternatives) and a cause that is none of them. With p_c the probability of hypothesis c, and L_c the predictive
density of the result under it, Bayes' theorem gives

    p_c after  =  p_c L_c / sum over all of p_j L_j,          p_none = max(1 - sum over candidates of p_c, p_least),

    Bayes factor of c  =  L_c / (sum over j != c of p_j L_j / sum over j != c of p_j).

The densities of a measured amplitude are those of `dpr_lab.gap.advice.measurement`. A recording has the predictive cost
of each candidate, fitted with the other named effects and tempered as in `dpr_lab.gap.classes.posterior`; it says
nothing of a cause that was not fitted, whose probability it keeps. Nothing of the old recordings is fitted again.
Equations (57) and (58) of docs/theory.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import special

from dpr_lab.checks.plausibility import question, refuse_impossible
from dpr_lab.checks.wording import conclusion, likeliest
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.errors import RunError, unknown_name
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.advice.measurement import SETTINGS, predictions
from dpr_lab.gap.bare_model import fit_bare_model
from dpr_lab.gap.classes.posterior import CALIBRATION
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, free_parameters, hypothesis, refit_with
from dpr_lab.gap.hypothesis.score_test import score_test
from dpr_lab.gap.hypothesis.steps import recorded
from dpr_lab.gap.result.diagnosis import (
    NONE_OF_THEM,
    AdvisedCheck,
    CheckDone,
    Diagnosis,
    NamedEffect,
    RivalEffect,
)
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.rig import Rig
from dpr_lab.run import Run, torque_kinds

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Result:
    """The result of a check and what it says of each hypothesis."""

    words: str
    log_densities: Mapping[str, float]
    """Of each candidate and of none of them."""
    value: float | None = None
    std: float | None = None
    explained: bool = True
    """Whether any candidate predicts it."""


def find_check(diagnosis: Diagnosis, name: str) -> AdvisedCheck:
    """The check with this id.

    Raises:
        RunError: the diagnosis has no such check.
    """
    check = next((check for check in diagnosis.checks if check.id == name), None)
    if check is None:
        raise RunError(
            unknown_name(f"this diagnosis recommends no check {name!r}", name, [c.id for c in diagnosis.checks])
        )
    return check


def update_with_measurement(
    diagnosis: Diagnosis, check: AdvisedCheck, value: float, std: float, *, confirmed: bool = False
) -> Diagnosis:
    """The diagnosis after a measurement.

    Args:
        diagnosis: it recommends the check
        check: what was measured
        value: of `check.quantity`, in its unit
        std: its standard uncertainty, in the same unit
        confirmed: whether a value that no candidate predicts is taken all the same

    Raises:
        RunError: the check needs a recording; the value cannot be, or no candidate predicts it and it is not confirmed.
    """
    if check.kind != "measurement" or check.quantity is None:
        raise RunError(f"check {check.id} is a recording ({check.text}): give its run files, not a value")
    predicted = predictions(diagnosis, check, candidates(diagnosis, check.about))
    refuse_impossible(check, value, std, predicted.largest)
    explained = predicted.nearest(value, std) <= SETTINGS.questioned
    if not explained and not confirmed:
        raise RunError(question(diagnosis, check, value, predicted))
    words = f"{check.quantity.name} = {check.quantity.shown(value)} ± {check.quantity.shown(std)}"
    return _updated(diagnosis, check, Result(words, predicted.log_densities(value, std), value, std, explained))


def update_with_recordings(diagnosis: Diagnosis, check: AdvisedCheck, runs: Sequence[Run], rig: Rig) -> Diagnosis:
    """The diagnosis after a recording.

    Args:
        diagnosis: it recommends the check
        check: what was recorded
        runs: the recordings
        rig: lengths, masses and encoders

    Raises:
        RunError: the check needs a measurement, or the runs cannot be fitted.
    """
    if check.kind != "recording":
        raise RunError(f"check {check.id} is a measurement ({check.text}): give --value and --std, not runs")
    before = candidates(diagnosis, check.about)
    open_ones = {check.about, *check.splits, *(r.name for r in diagnosis.rivals if r.instead_of == check.about)}
    fitted = _fitted(diagnosis, check.about, [name for name in before if name in open_ones], runs, rig)
    best = min(fitted.values(), key=lambda candidate: candidate.cost)
    scale = 2 * best.residuals.inflation * CALIBRATION.temperature
    densities = {name: -(candidate.cost - best.cost) / scale for name, candidate in fitted.items()}
    # Members that the recording does not split are as probable as the named effect, as before.
    densities |= {name: densities[check.about] for name in before if name not in densities}
    average = _log_mean(np.array([densities[name] for name in before]), np.array(list(before.values())))
    driven = "".join(f", driven by {kind} torques" for kind in torque_kinds(runs))
    words = f"recorded: {', '.join(run.name for run in runs)}{driven}"
    return _updated(diagnosis, check, Result(words, {**densities, NONE_OF_THEM: average}))


def candidates(diagnosis: Diagnosis, about: str) -> dict[str, float]:
    """Probability of each member of a named effect's class and of each of its alternatives."""
    if done := _done(diagnosis, about):
        return {name: p for name, p in done[-1].after.items() if name != NONE_OF_THEM}
    named = _named(diagnosis, about)
    members = dict.fromkeys(named.members, named.probability / len(named.members))
    return members | {rival.name: rival.probability for rival in diagnosis.rivals if rival.instead_of == about}


def hypotheses(diagnosis: Diagnosis, about: str) -> dict[str, float]:
    """Probability of each candidate and of none of them; they add up to one."""
    if (done := _done(diagnosis, about)) and NONE_OF_THEM in done[-1].after:
        return dict(done[-1].after)
    probabilities = candidates(diagnosis, about)
    none = max(1.0 - sum(probabilities.values()), SETTINGS.outside)
    whole = sum(probabilities.values()) + none
    return {name: p / whole for name, p in (*probabilities.items(), (NONE_OF_THEM, none))}


def _done(diagnosis: Diagnosis, about: str) -> list[CheckDone]:
    return [one for one in diagnosis.checks_done if one.check.about == about]


def _named(diagnosis: Diagnosis, about: str) -> NamedEffect:
    return next(effect for effect in diagnosis.effects if effect.name == about)


def _fitted(
    diagnosis: Diagnosis, about: str, names: Sequence[str], runs: Sequence[Run], rig: Rig
) -> dict[str, Hypothesis]:
    """Each candidate fitted to new runs, with the other named effects."""
    recordings = Recordings(tuple(record(run, rig) for run in runs), rig, exact_torques=diagnosis.exact_torques)
    recordings, problem, bare = fit_bare_model(recordings, diagnosis.unknowns)
    others = {name: dict(values) for name, values in diagnosis.model_effects.items() if name != about}
    less = bare
    if others:
        at = bare.fit.estimate.changed(params=effect_params(others))
        free = free_parameters(at, tuple(others), problem)
        less = hypothesis(problem, others, fit(problem, at, free, iterations=SETTINGS.iterations))
    known = recorded(recordings.records, problem, less.fit)
    test = score_test(problem, less.fit, [EFFECTS[name] for name in names], known)
    scores = {name: test.of(name) for name in names}
    return {
        name: refit_with(problem, less, test, score, SETTINGS.iterations)
        for name, score in scores.items()
        if score is not None
    }


def posterior(
    prior: Mapping[str, float], log_densities: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, float]]:
    """Probabilities after a result, and the logarithm to base 10 of each Bayes factor against all others together.

    Args:
        prior: hypothesis -> probability
        log_densities: hypothesis -> natural logarithm of the density of the result under it
    """
    names = list(prior)
    p, L = np.array([prior[name] for name in names]), np.array([log_densities[name] for name in names])
    with np.errstate(divide="ignore"):
        after = special.softmax(np.log(p) + L)
    others = [np.arange(len(names)) != k for k in range(len(names))]
    factors = [(L[k] - _log_mean(L[rest], p[rest])) / np.log(10) for k, rest in enumerate(others)]
    return dict(zip(names, after.tolist(), strict=True)), dict(zip(names, factors, strict=True))


def _log_mean(log_densities: Array, weights: Array) -> float:
    """Logarithm of the mean of densities; unweighted where all weights are zero."""
    weights = weights if weights.any() else np.ones_like(weights)
    return float(np.asarray(special.logsumexp(log_densities, b=weights / weights.sum()))[()])


def _updated(diagnosis: Diagnosis, check: AdvisedCheck, result: Result) -> Diagnosis:
    """The diagnosis with the probabilities after a result."""
    before = hypotheses(diagnosis, check.about)
    after, factors = posterior(before, result.log_densities)
    done = CheckDone(
        check=check,
        result=result.words,
        value=result.value,
        std=result.std,
        before=before,
        after=after,
        log10_bayes_factor=factors,
    )
    effects, rivals = _standing(diagnosis, check.about, after)
    moved = {**diagnosis.probabilities, **after, NONE_OF_THEM: _outside(diagnosis, done)}
    moved[check.about] = next(effect.probability for effect in effects if effect.name == check.about)
    kind, sentence = conclusion(diagnosis, done, result.explained)
    return diagnosis.model_copy(
        update={
            "verdict": kind,
            "effects": effects,
            "rivals": rivals,
            "probabilities": moved,
            "sentence": sentence,
            "remedies": _remedies(diagnosis, check.about, done),
            "checks": [left for left in diagnosis.checks if left.id != check.id],
            "checks_done": [*diagnosis.checks_done, done],
        }
    )


def _outside(diagnosis: Diagnosis, done: CheckDone) -> float:
    """Probability that some cause is outside the library: the largest of the named effects, checked or not."""
    checked = {one.check.about: one.after[NONE_OF_THEM] for one in diagnosis.checks_done if NONE_OF_THEM in one.after}
    checked[done.check.about] = done.after[NONE_OF_THEM]
    unchecked = any(effect.name not in checked for effect in diagnosis.effects)
    return max([*checked.values(), *([diagnosis.probabilities.get(NONE_OF_THEM, 0.0)] if unchecked else [])])


def _remedies(diagnosis: Diagnosis, about: str, done: CheckDone) -> list[str]:
    """The remedies without that of an effect that is not the most probable cause any more."""
    if likeliest(done.after) == about:
        return diagnosis.remedies
    return [remedy for remedy in diagnosis.remedies if not remedy.startswith(f"For {about}:")]


def _standing(
    diagnosis: Diagnosis, about: str, after: Mapping[str, float]
) -> tuple[list[NamedEffect], list[RivalEffect]]:
    """Named effects and rivals; members of the class that a check split off are rivals from then on."""
    named = _named(diagnosis, about)
    whole = sum(after[name] for name in named.members)
    kept = [name for name in named.members if after[name] > SETTINGS.dropped * whole]
    kept = kept if about in kept else [about]
    split = [name for name in named.members if name not in kept]
    standing = named.model_copy(update={"members": kept, "probability": sum(after[name] for name in kept)})
    effects = [standing if effect.name == about else effect for effect in diagnosis.effects]
    rivals = [
        rival.model_copy(update={"probability": after[rival.name]}) if rival.instead_of == about else rival
        for rival in diagnosis.rivals
    ]
    rivals += [
        RivalEffect.model_validate(
            {"name": name, "class": [name], "probability": after[name], "cosine": 1.0, "instead_of": about}
        )
        for name in split
    ]
    return effects, sorted(rivals, key=lambda rival: -rival.probability)
