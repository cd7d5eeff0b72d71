"""Moves that replace effects: by simpler or richer forms, by several others, by alternatives."""

from collections.abc import Iterator, Mapping

from dpr_lab.effects import plausibility
from dpr_lab.gap.hypothesis.hypothesis import PENALTY, Hypothesis
from dpr_lab.gap.hypothesis.refits import refit_with, refit_without
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.hypothesis.thresholds import (
    THRESHOLDS,
    at_noise_floor,
    bounded_excess,
    explains_as_much,
    follows_remainder,
    form_indifference,
    indifference,
    indistinguishable,
    significance,
)
from dpr_lab.gap.which.effort import EFFORT
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.search import Decision, Move, Proposal

REPLACEMENTS = 2
"""Number of candidates that are fitted as replacements of each effect."""


def _richer(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose sets in which a richer form replaces an effect that this form contains.

    The score test must show a contribution of the richer form.
    """
    chance = THRESHOLDS.chance * current.residuals.inflation
    test = sets.test(current)
    for score in test.ranking:
        inner = [name for name in score.effect.nested if name in current.effects]
        if inner and score.gain > chance:
            with_both = refit_with(sets.problem, current, test, score, iterations=EFFORT.fine)
            richer = sets.keep(refit_without(sets.problem, with_both, inner[0], sets.bare))
            yield Proposal(sets.escaped(richer) if current.cost - richer.cost > chance else richer)


def _better_than_chance(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    chance = THRESHOLDS.chance * current.residuals.inflation
    better = current.cost - proposal.model.cost > chance
    return Decision(better, f"the criterion falls by {'more' if better else 'less'} than {chance:.3g}")


RICHER_FORM = Move(
    "richer form", "an effect is replaced by a richer one that contains it", _richer, _better_than_chance
)


def _simpler(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose sets in which a simpler form replaces an effect that contains this form."""
    for name in current.effects:
        for simpler in sets.library[name].nested:
            if simpler in sets.library and simpler not in current.effects:
                replaced = sets.replaced(current, name, simpler)
                if replaced is not None:
                    yield Proposal(replaced)


def _as_good(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    """Accept a replacement that explains as much as the current set, within the indifference margin.

    Above the noise floor a richer form may compensate for an effect outside the set. It must then explain more.
    """
    model, margin = proposal.model, form_indifference(sets.bare, current)
    alike = (
        at_noise_floor(model)
        if at_noise_floor(current)
        else bounded_excess(model) < THRESHOLDS.slow * bounded_excess(current)
    )
    if alike and model.cost - current.cost < margin:
        return Decision(True, f"the criterion grows by less than {margin:.3g}")
    return Decision(False, "explains less")


SIMPLER_FORM = Move(
    "simpler form",
    "an effect is replaced by a simpler one that it contains and that explains as much",
    _simpler,
    _as_good,
    then="repeat",
)


def _second_cause(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose sets in which a simpler form and another effect replace an effect, without more parameters in total.

    The additional parameters of a richer form may imitate a second cause. For example, unequal friction in the two
    directions imitates a zero offset, and a zero that drifts imitates a constant zero error and an error of the scale.
    """
    for simpler in (proposal.model for proposal in _simpler(sets, current)):
        room, replaced = len(current.fit.free) - len(simpler.fit.free), current.key - simpler.key
        others = (score for score in sets.test(simpler).ranking if score.effect.name not in replaced)
        score = next((score for score in others if len(score.columns) <= room), None)
        if score is not None and score.gain > THRESHOLDS.chance * current.residuals.inflation:
            yield Proposal(sets.with_one(simpler, score))


def _several_for_one(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose sets in which effects with fewer parameters in total replace a curve, or join it.

    On a small arc a curve of many parameters imitates a tilt, friction and drag together, and is selected first.
    """
    chance = THRESHOLDS.chance * current.residuals.inflation
    for name in sets.unexpected(current):
        if name not in current.curves:
            continue
        model = sets.without(current, name)
        if current.curves[name] > PENALTY.ordinary:
            yield from _next_to(sets, model, name)
        most = len(current.fit.free) - 1
        for widest in (1, most):
            yield from _grown_to(sets, model, name, most=most, widest=widest, chance=chance)


def _grown_to(
    sets: FittedSets, model: Hypothesis, curve: str, *, most: int, widest: int, chance: float
) -> Iterator[Proposal]:
    """Propose sets that extend a set by the best further effects, one at a time.

    Each added effect has at most `widest` parameters. The extended set has at most `most` parameters.
    """
    while True:
        room = min(most - len(model.fit.free), widest)
        if room < 1:
            return
        ranking = (score for score in sets.test(model).ranking if score.effect.name != curve)
        score = next((score for score in ranking if len(score.columns) <= room), None)
        if score is None or score.gain < chance:
            return
        model = sets.with_one(model, score)
        if sets.possible(model):
            yield Proposal(model)


def _next_to(sets: FittedSets, without_curve: Hypothesis, curve: str) -> Iterator[Proposal]:
    """Propose the curve together with the simple effect that explains most of it.

    The curve then fits only the remainder.
    """
    simple = next((score for score in sets.test(without_curve).ranking if len(score.columns) == 1), None)
    if simple is not None and simple.gain > 0.0:
        model = sets.with_one(without_curve, simple)
        score = sets.score(model, curve)
        if score is not None:
            yield Proposal(sets.with_one(model, score))


def _better_with_fewer_parameters(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    model = proposal.model
    if (
        sets.possible(model)
        and not sets.possible(current)
        and bounded_excess(model) < THRESHOLDS.slow * bounded_excess(current)
    ):
        return Decision(True, "fewer parameters explain nearly as much, with sizes that a rig can have")
    better = model.cost < current.cost and at_noise_floor(model) >= at_noise_floor(current)
    return Decision(better, f"fewer parameters explain {'more' if better else 'less'}")


def _better_second_cause(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    fewer = len(proposal.model.fit.free) < len(current.fit.free)
    return (_better_with_fewer_parameters if fewer else _better_than_chance)(sets, current, proposal)


SECOND_CAUSE = Move(
    "second cause",
    "an effect is replaced by a simpler one and a second effect that explain more with fewer parameters, or"
    " significantly more with as many",
    _second_cause,
    _better_second_cause,
    then="repeat",
)


def _nearly_as_good_with_fewer_parameters(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    decision = _better_with_fewer_parameters(sets, current, proposal)
    if not decision.accepted and follows_remainder(sets.bare, current, proposal.model):
        return Decision(True, "the additional effect only fits the remainder of small unknown causes")
    return decision


SEVERAL_CAUSES = Move(
    "several causes",
    (
        "an effect with many parameters is replaced by others that explain more, or nearly as much, with fewer"
        " parameters"
    ),
    _several_for_one,
    _nearly_as_good_with_fewer_parameters,
    then="repeat",
)


def _exchanged(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose the best set in which another effect, or another shape, replaces one effect.

    Nothing is proposed if only noise remains.
    """
    if at_noise_floor(current) or not current.effects:
        return
    best = current
    for name in sets.unexpected(current):
        smaller = sets.without(current, name)
        if sets.library[name].shapes:
            best = min(best, sets.reshaped(current, name), key=_criterion)
        for score in sets.test(smaller).ranking[:REPLACEMENTS]:
            if score.effect.name != name:
                other = sets.with_one(smaller, score)
                best = min(best, other, key=_criterion) if sets.possible(other) else best
    if best is not current:
        yield Proposal(best)


def _closer(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    model = proposal.model
    if bounded_excess(current) >= THRESHOLDS.slow * bounded_excess(model):
        return Decision(True, f"the excess decreases by more than a factor of {THRESHOLDS.slow:g}")
    if model.key == current.key:
        return Decision(True, "the same effects with a better shape")
    return Decision(False, f"the excess decreases by less than a factor of {THRESHOLDS.slow:g}")


EXCHANGE = Move(
    "exchange",
    "while the residual exceeds the noise, each effect is replaced in turn by other effects and other shapes",
    _exchanged,
    _closer,
    then="repeat",
)


def _better_alternative(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Fit the alternatives of each effect, then propose the best fitted set with at most as many effects."""
    fits = fit_alternatives(sets, sets.predictive(current))
    known = current.key & sets.expected
    others = [
        model
        for model in fits.values()
        if model.effects
        and len(model.effects) <= len(current.effects)
        and known <= model.key
        and sets.as_possible(model, current)
    ]
    best = min(others, key=_criterion, default=current)
    if best.key != current.key:
        yield Proposal(best)


def _explains_more(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    best, chance = proposal.model, significance(sets.bare, current, proposal.model)
    if at_noise_floor(best) < at_noise_floor(current):
        return Decision(False, "the residual exceeds the noise")
    if explains_as_much(sets.bare, current, best):
        return Decision(False, "fewer parameters explain about as much")
    if current.cost - best.cost > chance:
        return Decision(True, f"the criterion falls by more than {chance:.3g}")
    return Decision(False, f"the criterion falls by less than {chance:.3g}, which is not significant")


BETTER_ALTERNATIVE = Move(
    "better alternative",
    "alternatives of each effect are fitted; a set of the same or smaller size that explains more replaces"
    " the current one",
    _better_alternative,
    _explains_more,
)


def _more_plausible(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose sets in which an indistinguishable effect of more plausible size replaces one effect."""
    chosen = sets.predictive(current)
    margin = indifference(sets.bare, chosen)
    for name in sets.unexpected(chosen):
        smaller = sets.without(chosen, name)
        test, plausibility_here = sets.test(smaller), plausibility(chosen.fit.estimate.params, name)
        if (score := test.of(name)) is None:
            continue
        for other in test.ranking:
            model = sets.fits.get(smaller.key | {other.effect.name})
            if model is None or model.key == chosen.key or abs(model.cost - chosen.cost) > margin:
                continue
            if indistinguishable(test, score, other):
                yield Proposal(model, plausibility(model.fit.estimate.params, other.effect.name) / plausibility_here)


def _far_more_plausible(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    return Decision(
        proposal.value > THRESHOLDS.likelier,
        f"indistinguishable; the ratio of the prior probabilities of the sizes is {proposal.value:.2g}",
    )


MORE_PLAUSIBLE = Move(
    "more plausible size",
    "of two indistinguishable effects, the one with the far more plausible size is named",
    _more_plausible,
    _far_more_plausible,
)


def fit_alternatives(sets: FittedSets, chosen: Hypothesis) -> Mapping[frozenset[str], Hypothesis]:
    """Fit the sets in which an alternative replaces an effect, and return all fitted sets.

    Alternatives are effects that the linear scores can hardly distinguish from the effect, or rank above it. If an
    indistinguishable effect fits worse, its fit ended in a local minimum and is repeated from the selected solution.
    While a residual remains, the simpler forms of each effect are also fitted.
    """
    if not at_noise_floor(chosen):
        for proposal in _simpler(sets, chosen):
            sets.keep(proposal.model)
    for name in chosen.effects:
        smaller = sets.without(chosen, name)
        test = sets.test(smaller)
        for score in _indistinguishable(test, name):
            other = sets.escaped(sets.with_one(smaller, score))
            if other.cost - chosen.cost > THRESHOLDS.chance * chosen.residuals.inflation:
                sets.imaged(chosen, name, score)
        for score in test.ranking[:REPLACEMENTS]:
            if score.effect.name != name and smaller.cost - score.gain < chosen.cost:
                sets.with_one(smaller, score)
    return sets.fits


def _indistinguishable(test: ScoreTest, name: str) -> Iterator[Score]:
    """Yield the scores of effects that have the same signature as the effect `name` and are not forms of it."""
    if (current_score := test.of(name)) is None:
        return
    for score in test.ranking:
        form = score.effect.name in {name, *current_score.effect.nested} or name in score.effect.nested
        if not form and score.gain > 0 and test.cosine(current_score, score) > THRESHOLDS.indistinguishable:
            yield score


def _criterion(model: Hypothesis) -> float:
    return model.cost
