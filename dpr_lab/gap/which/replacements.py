"""Moves that replace an effect: by a simpler form, by several other effects, or by an alternative."""

import math
from collections.abc import Iterator, Mapping
from itertools import product, starmap

from dpr_lab.effects import EFFECTS
from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, log_prior_ratio
from dpr_lab.gap.hypothesis.imitation import follows_remainder
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.hypothesis.significance import (
    adds_less_than_remains,
    cost_with_prior,
    explains_as_much,
    form_indifference,
    indifference,
    member_odds,
    significance,
)
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.which.effort import EFFORT
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.restarts import escaped, replaced_linearly, simpler_forms
from dpr_lab.gap.which.search import Decision, Move, Proposal


def _as_good(fitted_sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    """Accept a simpler form that explains about as much as the current set."""
    model, margin = proposal.model, form_indifference(fitted_sets.bare, current)
    adequate = (
        model.at_noise_floor
        if current.at_noise_floor
        else model.bounded_excess < THRESHOLDS.excess_factor * current.bounded_excess
    )
    if adequate and model.cost - current.cost < margin:
        return Decision(True, f"the criterion grows by less than {margin:.3g}")
    return Decision(False, "explains less")


SIMPLER_FORM = Move(
    "simpler form",
    "an effect is replaced by a simpler one that it contains, if this one explains as much",
    lambda fitted_sets, current: map(Proposal, simpler_forms(fitted_sets, current)),
    _as_good,
    then="repeat",
)


def _several_for_one(fitted_sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose sets in which effects with one amplitude, and in total fewer parameters, replace a curve.

    On a small arc, a curve can imitate a tilt, friction and drag together, and is then selected first. Shape parameters
    are counted as parameters.
    """
    for curve in fitted_sets.unexpected(current):
        if curve not in current.curves:
            continue
        model = fitted_sets.without(current, curve)
        while model.parameters + 1 < current.parameters:
            ranking = (score for score in fitted_sets.test(model).ranking if score.effect.name != curve)
            score = next((score for score in ranking if len(score.columns) == 1), None)
            if score is None or score.gain < current.chance:
                break
            model = fitted_sets.with_one(model, score)
            if model.parameters < current.parameters and fitted_sets.possible(model):
                yield Proposal(model)


def _nearly_as_good_with_fewer_parameters(fitted_sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    model = proposal.model
    if (
        fitted_sets.possible(model)
        and not fitted_sets.possible(current)
        and model.bounded_excess < THRESHOLDS.excess_factor * current.bounded_excess
    ):
        return Decision(True, "explains nearly as much with fewer parameters, and with sizes that a rig can have")
    if model.cost < current.cost and model.at_noise_floor >= current.at_noise_floor:
        return Decision(True, "explains more with fewer parameters")
    if follows_remainder(fitted_sets.bare, current, model):
        return Decision(True, "the additional effect only fits the remainder of small unknown causes")
    return Decision(False, "explains less with fewer parameters")


SEVERAL_CAUSES = Move(
    "several causes",
    "an effect with many parameters is replaced by several effects that explain more, or nearly as much, with fewer"
    " parameters",
    _several_for_one,
    _nearly_as_good_with_fewer_parameters,
    then="repeat",
)


def _better_alternative(fitted_sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Fit alternatives to each effect; propose the set of lowest cost and the most probable set."""
    fits = fit_alternatives(fitted_sets, fitted_sets.predictive(current))
    known = current.key & fitted_sets.expected
    others = [
        model
        for model in fits.values()
        if model.effects
        and len(model.effects) <= len(current.effects)
        and known <= model.key
        and fitted_sets.as_possible(model, current)
    ]
    best = min(others, key=lambda model: model.cost, default=current)
    likeliest = min(others, key=lambda model: cost_with_prior(model, current), default=current)
    for model in {model.key: model for model in (best, likeliest) if model.key != current.key}.values():
        yield Proposal(model)


def _explains_more(fitted_sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    best, chance = proposal.model, significance(fitted_sets.bare, current, proposal.model)
    likelier = log_prior_ratio(best, current) > math.log(THRESHOLDS.likelier)
    if not likelier and explains_as_much(fitted_sets.bare, current, best):
        return Decision(False, "explains about as much with fewer parameters")
    if cost_with_prior(best, current) >= current.cost:
        return Decision(False, "the criterion does not fall by as much as the prior odds require")
    if current.cost - best.cost > chance:
        return Decision(True, f"the criterion falls by more than {chance:.3g}")
    if likelier:
        return Decision(True, "the other set has larger prior odds, and explains about as much")
    return Decision(False, f"the criterion falls by less than {chance:.3g}, which is not significant")


BETTER_ALTERNATIVE = Move(
    "better alternative",
    "alternatives of each effect are fitted; a set of the same or smaller size replaces the current one if it"
    " explains more, or if its effects are more common and explain about as much",
    _better_alternative,
    _explains_more,
)


def _larger_priors(fitted_sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose sets in which an indistinguishable effect or a simpler form replaces another.

    The value of a proposal is the ratio of the probabilities of new and replaced effect.
    """
    chosen = fitted_sets.predictive(current)
    margin = indifference(fitted_sets.bare, chosen)
    for name in fitted_sets.unexpected(chosen):
        smaller = fitted_sets.without(chosen, name)
        test = fitted_sets.test(smaller)
        if (score := test.best_score(name)) is None:
            continue
        for other in test.ranking:
            model = fitted_sets.fits.get(smaller.key | {other.effect.name})
            if model is None or model.key == chosen.key:
                continue
            if other.effect.name in EFFECTS[name].nested:
                same = adds_less_than_remains(chosen, model)
            else:
                first = _comes_first(other.effect.name, name)
                tolerance = CALIBRATION.unit(chosen.inflation) * math.log(THRESHOLDS.tie) if first else 0.0
                likely = cost_with_prior(model, chosen) < chosen.cost + tolerance
                close = likely and abs(model.cost - chosen.cost) <= margin
                absorbed = first and fitted_sets.test(chosen).absorbs(other.effect, EFFECTS[name])
                same = close and (absorbed or test.indistinguishable(score, other))
            if same and fitted_sets.as_possible(model, chosen):
                yield Proposal(model, member_odds(model, chosen, name, other.effect.name))


def _comes_first(name: str, other: str) -> bool:
    """Return whether `name` precedes `other` in the order of common effects: zero errors first, then alphabetical."""
    first, second = EFFECTS[name], EFFECTS[other]
    order = [(not effect.stage.startswith("encoder"), effect.name) for effect in (first, second)]
    return first.common and second.common and order[0] < order[1]


def _more_probable(fitted_sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    ratio = f"the ratio of the probabilities is {proposal.value:.2g}"
    accepted = proposal.value > THRESHOLDS.tie
    added, removed = proposal.model.key - current.key, current.key - proposal.model.key
    if proposal.value > 1 / THRESHOLDS.tie and added and all(starmap(_comes_first, product(added, removed))):
        return Decision(True, f"indistinguishable, and earlier in the fixed order of common effects; {ratio}")
    richer = any(not current.key.isdisjoint(EFFECTS[name].nested) for name in proposal.model.key - current.key)
    if richer and not accepted:
        return Decision(False, f"the richer form is not needed, because it explains about as much; {ratio}")
    return Decision(accepted, f"indistinguishable; {ratio}")


LARGER_PRIOR = Move(
    "larger prior probability",
    "of two indistinguishable effects, the more probable one is named, and of two common effects with similar"
    " probabilities the first of a fixed order",
    _larger_priors,
    _more_probable,
)


def fit_alternatives(fitted_sets: FittedSets, chosen: Hypothesis) -> Mapping[frozenset[str], Hypothesis]:
    """Fit the sets in which an alternative replaces an effect, and return all fitted sets.

    Alternatives are effects that are indistinguishable in the score test, effects with the largest scores and, while a
    residual remains, simpler forms. A fit can reduce the cost by much more than its linear score predicts. Effects with
    a similar signature and score are therefore fitted as well: only common effects if the selected set leaves only
    noise, otherwise all of them. If an indistinguishable effect fits worse, its fit ended in a local minimum and is
    repeated from the solution of the selected set. Its fit is also repeated from other initial values, unless its cost
    is far too high (`EFFORT.hopeless`).
    """
    if not chosen.at_noise_floor:
        for simpler in simpler_forms(fitted_sets, chosen):
            fitted_sets.keep(simpler)
    for name in chosen.effects:
        smaller = fitted_sets.without(chosen, name)
        test = fitted_sets.test(smaller)
        for score in _indistinguishable(test, name):
            other = fitted_sets.with_one(smaller, score)
            if other.cost - chosen.cost > chosen.chance:
                other = replaced_linearly(fitted_sets, chosen, name, score)
            if other.cost - chosen.cost < EFFORT.hopeless * chosen.chance:
                escaped(fitted_sets, other)
        for score in test.ranking[: EFFORT.replacements]:
            if score.effect.name != name and smaller.cost - score.gain < chosen.cost:
                fitted_sets.with_one(smaller, score)
        for score in _similar(test, name):
            if score.effect.common or not chosen.at_noise_floor:
                fitted_sets.with_one(smaller, score)
    return fitted_sets.fits


def _similar(test: ScoreTest, name: str) -> Iterator[Score]:
    """Yield the scores of other effects whose signature and score are similar to those of the effect `name`."""
    if (named := test.best_score(name)) is not None:
        for score in test.ranking:
            nearly = EFFORT.nearly_common if score.effect.common else EFFORT.nearly
            similar = score.gain > nearly * named.gain and test.cosine(named, score) > nearly
            if similar and score.effect.name != name:
                yield score


def _indistinguishable(test: ScoreTest, name: str) -> Iterator[Score]:
    """Yield the scores of effects with the same signature as `name`, without its simpler and richer forms."""
    if (current_score := test.best_score(name)) is None:
        return
    for score in test.ranking:
        form = score.effect.name in {name, *current_score.effect.nested} or name in score.effect.nested
        if not form and score.gain > 0 and test.cosine(current_score, score) > THRESHOLDS.indistinguishable:
            yield score
