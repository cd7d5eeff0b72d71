"""Update a diagnosis with the result of a recommended check.

The hypotheses about one named effect are its candidates and a further hypothesis, that another cause acts. The
candidates are the members of the class of the effect, weighted by the prior of their fitted sizes, and its
alternatives. Let p_c be the probability of hypothesis c, and L_c the predictive density of the result under c. Bayes'
theorem gives

    p_c after  =  p_c L_c / sum over all of p_j L_j,          p_none = max(1 - sum over candidates of p_c, p_least),

    Bayes factor of c  =  L_c / (sum over j != c of p_j L_j / sum over j != c of p_j).

The densities of a measured amplitude are those of `dpr_lab.gap.advice.measurement`. For a recording, each candidate is
fitted together with the other named effects. Its density follows from its predictive cost, tempered as in
`dpr_lab.gap.classes.posterior`. A recording contains no information about causes other than the candidates, so their
probability does not change. The earlier recordings are not fitted again. Source: docs/theory.md, equations (57) and
(58).
"""

from collections.abc import Collection, Mapping

import numpy as np

from dpr_lab.effects import EFFECTS
from dpr_lab.errors import RunError, unknown_name
from dpr_lab.gap.advice.advise import kind_of
from dpr_lab.gap.advice.check_kind import CheckAnswer, Result, expected_bits, log_mean
from dpr_lab.gap.advice.measurement import CHECK, has
from dpr_lab.gap.conclusion.causes import to_rule_out, to_simulator
from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.result.causes import NamedEffect, RivalEffect
from dpr_lab.gap.result.checks import NONE_OF_THEM, AdvisedCheck, CheckDone, camera_checks, recommended
from dpr_lab.gap.result.diagnosis import Diagnosis, Verdict


def find_check(diagnosis: Diagnosis, name: str) -> AdvisedCheck:
    """Return the check with a given identifier.

    Raises:
        RunError: the diagnosis has no such check, or already contains its result.
    """
    if done := next((done for done in diagnosis.checks_done if done.check.id == name), None):
        raise RunError(
            f"the result of check {name} is recorded already: {done.result}. To correct it, record the correct result"
            " in the diagnosis that was made before this check"
        )
    check = next((check for check in diagnosis.checks if check.id == name), None)
    if check is None:
        raise RunError(
            unknown_name(f"this diagnosis recommends no check {name!r}", name, [c.id for c in diagnosis.checks])
        )
    return check


def update(diagnosis: Diagnosis, check: AdvisedCheck, answer: CheckAnswer) -> Diagnosis:
    """Update a diagnosis with the result of a check.

    Args:
        diagnosis: the diagnosis that recommends the check
        check: the check
        answer: result of the check

    Raises:
        RunError: the answer does not belong to this kind of check, the value is impossible or doubtful and not
            confirmed, or the runs cannot be fitted.
    """
    refuse_other_result(check, answer.entered)
    result = kind_of(check).result(diagnosis, check, answer, candidates(diagnosis, check.about))
    return _updated(diagnosis, check, answer, result)


def refuse_other_result(check: AdvisedCheck, given: set[str]) -> None:
    """Test whether the entered fields of a `CheckAnswer` are those that the kind of check requires.

    Raises:
        RunError: a field is missing, or another field is entered.
    """
    kind = kind_of(check)
    if given != kind.takes:
        wrong = given - kind.takes
        problem = f"does not take {_options(wrong)}" if wrong else f"lacks {_options(kind.takes - given)}"
        raise RunError(
            f"check {check.id} is a {check.kind} and {problem}: give its result, {kind.form(check)}. The check:"
            f" {check.text}"
        )


def _options(fields: Collection[str]) -> str:
    """Return fields of a `CheckAnswer` as the options of the command."""
    return " and ".join("run files" if name == "runs" else f"--{name}" for name in sorted(fields, reverse=True))


def candidates(diagnosis: Diagnosis, about: str) -> dict[str, float]:
    """Return the probability of each candidate cause of a named effect.

    The candidates are the members of its class and its alternatives. If checks are completed, the probabilities are
    those after the last one.
    """
    if done := _last(diagnosis, about):
        return {name: p for name, p in done.after.items() if name != NONE_OF_THEM}
    rivals = {rival.name: rival.probability for rival in diagnosis.rivals if rival.instead_of == about}
    return _named(diagnosis, about).candidates | rivals


def hypotheses(diagnosis: Diagnosis, about: str) -> dict[str, float]:
    """Return the probability of each candidate and of a cause outside the candidates; the sum is one."""
    if (done := _last(diagnosis, about)) and NONE_OF_THEM in done.after:
        return dict(done.after)
    probabilities = candidates(diagnosis, about)
    outside = max(1.0 - sum(probabilities.values()), CALIBRATION.outside_when_closed)
    total = sum(probabilities.values()) + outside
    return {name: p / total for name, p in (*probabilities.items(), (NONE_OF_THEM, outside))}


def _last(diagnosis: Diagnosis, about: str) -> CheckDone | None:
    """Return the last completed check of a named effect, or None."""
    return next((done for done in reversed(diagnosis.checks_done) if done.check.about == about), None)


def _named(diagnosis: Diagnosis, about: str) -> NamedEffect:
    return next(effect for effect in diagnosis.effects if effect.name == about)


def posterior(
    prior: Mapping[str, float], log_densities: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, float]]:
    """Return the probabilities and the log10 Bayes factors of all hypotheses after a result.

    Args:
        prior: probability by hypothesis
        log_densities: natural logarithm of the predictive density of the result, by hypothesis
    """
    names = list(prior)
    p, L = np.array([prior[name] for name in names]), np.array([log_densities[name] for name in names])
    with np.errstate(divide="ignore"):
        log_joint = np.log(p) + L
    after = np.exp(log_joint - np.logaddexp.reduce(log_joint))
    others = [np.arange(len(names)) != k for k in range(len(names))]
    factors = [
        (L[k] - log_mean(L[alternatives], p[alternatives])) / np.log(10) for k, alternatives in enumerate(others)
    ]
    return dict(zip(names, after.tolist(), strict=True)), dict(zip(names, factors, strict=True))


def _updated(diagnosis: Diagnosis, check: AdvisedCheck, answer: CheckAnswer, result: Result) -> Diagnosis:
    """Return the diagnosis with its probabilities updated by a result."""
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
        recordings=[run.sha256 for run in answer.runs if run.sha256],
    )
    effects, rivals = _standing(diagnosis, check.about, after)
    probabilities = {**diagnosis.probabilities, **after, NONE_OF_THEM: _outside(diagnosis, done)}
    standing = next(effect for effect in effects if effect.name == check.about)
    probabilities[check.about] = standing.probability
    kind, sentence = conclusion(diagnosis, done, result.explained)
    remaining_checks = remaining(diagnosis, done)
    return diagnosis.model_copy(
        update={
            "verdict": kind,
            "effects": effects,
            "rivals": rivals,
            "probabilities": probabilities,
            "sentence": sentence,
            "remedies": _remedies(diagnosis, done, standing),
            "advice": [*camera_checks(diagnosis.advice), *(check.sentences for check in recommended(remaining_checks))],
            "checks": remaining_checks,
            "checks_done": [*diagnosis.checks_done, done],
        }
    )


def remaining(diagnosis: Diagnosis, done: CheckDone) -> list[AdvisedCheck]:
    """Return the remaining checks, the best first, with updated expected information.

    The expected information of a check is assumed to be the same fraction of the entropy as before the result. For an
    ideal measurement this fraction is one.
    """
    open_checks = [_reweighed(check, done) for check in diagnosis.checks if check.id != done.check.id]
    return sorted(open_checks, key=lambda check: -check.priority)


def _reweighed(check: AdvisedCheck, done: CheckDone) -> AdvisedCheck:
    if check.about != done.check.about:
        return check
    before, after = (expected_bits(_sides(check, p), np.inf) for p in (done.before, done.after))
    return check.model_copy(update={"expected_bits": check.expected_bits * (after / before if before > 0 else 0.0)})


def _sides(check: AdvisedCheck, probabilities: Mapping[str, float]) -> tuple[float, float]:
    """Return the probabilities of the two groups of causes that a check distinguishes.

    A measurement distinguishes the causes with the measured amplitude from all others, including a cause outside the
    candidates. A recording distinguishes the named effect from the other causes of the check.
    """
    first, second = {check.about}, {*check.splits} - {check.about}
    if check.measures:
        amplitude = check.amplitudes[0].name
        first = {name for name in probabilities if name in EFFECTS and has(name, check.measures, amplitude)}
        second = {*probabilities} - first
    present, absent = (sum(probabilities.get(name, 0.0) for name in names) for names in (first, second))
    return present, absent


def _outside(diagnosis: Diagnosis, done: CheckDone) -> float:
    """Return the probability of a cause outside the library: the maximum over all named effects."""
    checked = diagnosis.outside_by_checks | {done.check.about: done.after[NONE_OF_THEM]}
    unchecked = any(effect.name not in checked for effect in diagnosis.effects)
    return max([*checked.values(), *([diagnosis.probabilities.get(NONE_OF_THEM, 0.0)] if unchecked else [])])


def _remedies(diagnosis: Diagnosis, done: CheckDone, standing: NamedEffect) -> list[str]:
    """Return the remedies after a check.

    The remedy of the checked effect is removed if this effect is no longer the most probable cause. Otherwise the
    members of the class in this remedy are replaced by those that are still possible. The remedy of a class without
    other members, or of a diagnosis that an earlier version saved, remains as it is.
    """
    about = standing.name
    before, after = to_rule_out(_named(diagnosis, about)), to_rule_out(standing)
    its_repair = f"For {about}:"
    if likeliest(done.after) != about:
        repairs = [remedy for remedy in diagnosis.remedies if not remedy.startswith((its_repair, "Add "))]
        return [*repairs, *to_simulator(effect for effect in diagnosis.effects if effect.name != about)]
    return [
        remedy.replace(f"{before}.", f"{after}.") if before and remedy.startswith(its_repair) else remedy
        for remedy in diagnosis.remedies
    ]


def _standing(
    diagnosis: Diagnosis, about: str, after: Mapping[str, float]
) -> tuple[list[NamedEffect], list[RivalEffect]]:
    """Return the named effects and the alternatives after a check.

    Members of the class that the check makes improbable become alternatives.
    """
    named = _named(diagnosis, about)
    total = sum(after[name] for name in named.members)
    members = [name for name in named.members if after[name] > CHECK.dropped * total]
    members = members if about in members else [about]
    split = [name for name in named.members if name not in members]
    probability = sum(after[name] for name in members)
    odds = {name: after[name] / probability for name in members} if probability > 0 else {}
    # the probability is now that of the check, which also tests the form
    standing = named.model_copy(
        update={"members": members, "odds": odds, "probability": probability, "untested": False}
    )
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


def likeliest(probabilities: Mapping[str, float]) -> str:
    """Return the most probable hypothesis; if several are equally probable, the first of them."""
    return max(probabilities, key=lambda name: probabilities[name])


def conclusion(diagnosis: Diagnosis, done: CheckDone, explained: bool) -> tuple[Verdict, str]:
    """Return the verdict and the sentence after a check.

    The sentence starts with the cause that is now the most probable.
    """
    about, after = done.check.about, likeliest(done.after)
    before = f"Before the checks: {diagnosis.sentence.rpartition('Before the checks: ')[2]}"
    result = f"After check {done.check.id} ({done.result}):"
    factor = f"Bayes factor {bayes_factor(done, after)}"
    if after == NONE_OF_THEM and done.log10_bayes_factor[NONE_OF_THEM] > 0:
        others = [effect for effect in diagnosis.effects if effect.name != about]
        open_verdict: Verdict = "inconclusive" if diagnosis.undecided else "partly_explained"
        outside = (
            f"{result} none of the named effects explains the measured value. Either the cause is a different"
            f" effect, or a different quantity was measured (probability {done.before[after]:.2g} ->"
            f" {done.after[after]:.2g}, {factor})."
        )
        explains = others and diagnosis.verdict != "unexplained"
        return (open_verdict if explains else "unexplained"), f"{outside} {before}"
    best = likeliest({name: p for name, p in done.after.items() if name != NONE_OF_THEM})
    change = (
        f"{result} the probability of {best} changes from {done.before[best]:.2f} to {done.after[best]:.2f} (Bayes"
        f" factor {bayes_factor(done, best)})."
    )
    if not explained:
        change += " None of the candidates predicts this value."
    if best == about:
        return diagnosis.verdict, f"{change} {before}"
    instead = f"This cause is now more probable than {about}. Diagnose again with --without {about} to fit it."
    return diagnosis.verdict, f"{change} {instead} {before}"


def bayes_factor(done: CheckDone, name: str) -> str:
    """Return the Bayes factor of a hypothesis as text, for example `25`, `0.04`, `3000` or `> 10^6`."""
    power = done.log10_bayes_factor.get(name, 0.0)
    if abs(power) > CHECK.largest_power:
        return f"{'>' if power > 0 else '<'} 10^{np.sign(power) * CHECK.largest_power:.0f}"
    return f"{float(f'{10**power:.2g}'):g}"
