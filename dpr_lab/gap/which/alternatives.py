"""Alternatives to each effect of the selected set, and the moves that replace an effect by an alternative."""

from collections.abc import Iterator, Mapping

from dpr_lab.effects import plausibility
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.hypothesis.significance import explains_as_much, indifference, significance
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.which.effort import EFFORT
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.restarts import escaped, imaged, simpler_forms
from dpr_lab.gap.which.search import Decision, Move, Proposal


def _better_alternative(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Fit the alternatives to each effect, then propose the best fitted set.

    This set has at most as many effects as the current one.
    """
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
    best = min(others, key=lambda model: model.cost, default=current)
    if best.key != current.key:
        yield Proposal(best)


def _explains_more(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    best, chance = proposal.model, significance(sets.bare, current, proposal.model)
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
    """Propose sets in which an indistinguishable effect of more plausible size replaces one."""
    chosen = sets.predictive(current)
    margin = indifference(sets.bare, chosen)
    for name in sets.unexpected(chosen):
        smaller = sets.without(chosen, name)
        test, plausibility_here = sets.test(smaller), plausibility(chosen.estimate.params, name)
        if (score := test.of(name)) is None:
            continue
        for other in test.ranking:
            model = sets.fits.get(smaller.key | {other.effect.name})
            if model is None or model.key == chosen.key or abs(model.cost - chosen.cost) > margin:
                continue
            if test.indistinguishable(score, other):
                yield Proposal(model, plausibility(model.estimate.params, other.effect.name) / plausibility_here)


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
    if not chosen.at_noise_floor:
        for simpler in simpler_forms(sets, chosen):
            sets.keep(simpler)
    for name in chosen.effects:
        smaller = sets.without(chosen, name)
        test = sets.test(smaller)
        for score in _indistinguishable(test, name):
            other = escaped(sets, sets.with_one(smaller, score))
            if other.cost - chosen.cost > chosen.chance:
                imaged(sets, chosen, name, score)
        for score in test.ranking[: EFFORT.replacements]:
            if score.effect.name != name and smaller.cost - score.gain < chosen.cost:
                sets.with_one(smaller, score)
    return sets.fits


def _indistinguishable(test: ScoreTest, name: str) -> Iterator[Score]:
    """Yield the scores of effects with the same signature as the effect `name`.

    Other forms of this effect are left out.
    """
    if (current_score := test.of(name)) is None:
        return
    for score in test.ranking:
        form = score.effect.name in {name, *current_score.effect.nested} or name in score.effect.nested
        if not form and score.gain > 0 and test.cosine(current_score, score) > THRESHOLDS.indistinguishable:
            yield score
