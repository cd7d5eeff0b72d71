"""Classes of effects that are indistinguishable in these recordings, alternatives, and their probabilities.

The signature of an effect is the change of the readings that it causes, with ratios and initial states projected out.
Effects form one class if their signatures have a cosine of at least 0.999 and they fit equally well. The members of a
class share its probability in proportion to their odds, which depend on the criterion and on the prior of the fitted
size (`dpr_lab.gap.hypothesis.size_prior`): a clock error of 3 % is impossible for a crystal, a length error of 6 % is
possible.

A richer form counts as the simpler form that it contains under two conditions: its additional amplitudes are excluded
at their minimum detectable sizes, and the reduction of chi2 by them is smaller than their penalty.

The probability of a class is the softmax of the predictive costs of the selected set, of the fitted sets in which
another effect replaces the named one, and of the set without it. The softmax is multiplied by the probability that the
cause is in the library (`outside`), and later by the factors of the validation
(`dpr_lab.gap.transfer.transfer.judged`). No other set is more probable than the selected one: the search would have
selected a significantly better set. Common effects, such as a zero error, have larger prior odds.
"""

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.effects import EFFECTS, effect_params, param_index, plausibility
from dpr_lab.effects.effect import Effect
from dpr_lab.gap.hypothesis.calibration import CALIBRATION, odds_outside, probability_outside
from dpr_lab.gap.hypothesis.detectable import comparable_size, linear_exclusions
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.imitation import follows_decay
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.hypothesis.significance import (
    adds_less_than_remains,
    are_forms,
    form_indifference,
    indifference,
    member_odds,
)
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.which.selected import Selection


@dataclass(frozen=True, slots=True)
class Alternative:
    """An alternative to a named effect, with its probability."""

    name: str
    cosine: float
    """Cosine of the signatures of named effect and alternative."""
    cost: float
    """Predictive cost of the set with the alternative."""
    probability: float = 0.0


@dataclass(frozen=True, slots=True)
class EffectPosterior:
    """Probability of a named effect, its alternatives, and the members of its class."""

    name: str
    members: tuple[str, ...]
    """The effect itself and the effects that are indistinguishable from it."""
    alternatives: tuple[Alternative, ...]
    probability: float
    forms: tuple[str, ...] = ()
    """Richer forms that count as the member of the class that they contain."""
    odds: tuple[float, ...] = ()
    """Shares of the members in the probability; their sum is one."""
    outside: float = 0.0
    """Probability that a cause outside the library acts instead of the effect."""
    untested: bool = False
    """Whether the probability is limited because it was computed from one release of a single rod."""


def effect_posterior(selection: Selection, name: str) -> EffectPosterior:
    """Compute the class, the alternatives and the probability of one effect of the selected set."""
    replacements, chosen = _Replacements(selection, name), selection.chosen
    named_score = replacements.test.best_score(name)
    others = {score.effect.name: score for score in replacements.test.ranking if score is not named_score}
    if named_score is None:  # no signature can be compared
        plausibilities, forms, alternatives = dict[str, float](), (), list[Alternative]()
    else:
        plausibilities, forms = _class_members(replacements, named_score, others)
        remaining = {other: others[other] for other in others if other not in plausibilities and other not in forms}
        alternatives = _alternatives(replacements, named_score, remaining)
    prior = np.array([chosen.priors[name], *plausibilities.values()])
    costs = [_added_cost(replacements, alternative) for alternative in alternatives]
    without = selection.without_substitute[name].cost_at(chosen.inflation)
    added_cost = np.array([0.0, *costs, max(without - chosen.cost, 0.0)])
    scaled = -added_cost / CALIBRATION.unit(chosen.inflation)
    weights = np.exp(np.clip(scaled, -CALIBRATION.negligible, CALIBRATION.negligible))
    replaced = (selection.fitted[replacements.key_with(alternative.name)] for alternative in alternatives)
    prior_ratios = [prior_odds(selection, model, (name, *plausibilities)) for model in replaced]
    sizes = [_size_odds(replacements, alternative) for alternative in alternatives]
    weights[1:-1] = np.minimum(weights[1:-1] * prior_ratios * sizes, 1.0)
    of_outside = outside(selection, name, members=plausibilities)
    weights *= (1 - of_outside) / weights.sum()
    return EffectPosterior(
        name=name,
        members=(name, *plausibilities),
        alternatives=tuple(
            replace(alternative, probability=float(weight))
            for alternative, weight in zip(alternatives, weights[1:-1], strict=True)
            if weight >= CALIBRATION.least_listed
        ),
        probability=float(weights[0]),
        forms=forms,
        odds=tuple((prior / prior.sum()).tolist()),
        outside=of_outside,
    )


@dataclass(frozen=True, slots=True)
class _Replacements:
    """Fits in which another effect replaces one effect of the selected set."""

    selection: Selection
    name: str

    @property
    def test(self) -> ScoreTest:
        """Score test of all effects for the set without the effect."""
        return self.selection.tests_without[self.name]

    def key_with(self, other: str) -> frozenset[str]:
        """Return the names of the effects of the set in which `other` replaces the named effect."""
        return self.selection.without[self.name].key | {other}

    def with_other(self, other: str) -> Hypothesis | None:
        """Return the set with another effect in place of the named effect, or None if it was not fitted."""
        return self.selection.fitted.get(self.key_with(other))


def _class_members(
    replacements: _Replacements, named: Score, others: Mapping[str, Score]
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the other members of the class of a named effect, and its richer forms.

    The members are the keys; the values are the prior weights of their sizes. The richer forms do not improve the fit.
    """
    same = [other for other, score in others.items() if _in_one_class(replacements, named, score)]
    richer = _undetectably_richer(replacements.selection, named.effect)
    undetectable = [other for other in richer if other in others and other not in same]
    forms = tuple(
        other
        for other in others
        if other not in undetectable and {named.effect.name, *same}.intersection(EFFECTS[other].nested)
        if _adds_nothing(replacements, other)
    )
    members = [other for other in (*same, *undetectable) if other not in forms]
    sizes = {other: _plausibility(replacements, others[other]) for other in members}
    return dict(sorted(sizes.items(), key=lambda member: (-member[1], member[0]))), forms


def _in_one_class(replacements: _Replacements, score: Score, other: Score) -> bool:
    """Return whether an effect and the named effect have the same signature and fit equally well.

    In the fit without the named effect, the remaining effects may imitate it, so that equal signatures appear
    different. Signatures therefore also count as equal if the named effect absorbs the other effect in the selected
    fit. If the set with the other effect was not fitted, this is sufficient.

    A fitted simpler form is a member as well if the named effect explains less in addition to it than remains
    unexplained, because the unknown cause of the remainder can imitate the difference. For richer forms, see
    `_undetectably_richer`.
    """
    selection, fitted = replacements.selection, replacements.with_other(other.effect.name)
    is_form = other.effect.name in score.effect.nested
    if is_form and adds_less_than_remains(selection.chosen, fitted):
        return True
    absorbed = not other.absorbed and selection.final_test.absorbs(other.effect, score.effect)
    if score.effect.name in other.effect.nested or not (absorbed or replacements.test.indistinguishable(score, other)):
        return False
    margin = indifference(selection.bare, selection.chosen)
    if fitted is None:
        return not is_form and (absorbed or score.gain - other.gain < margin)
    return fitted.cost - selection.chosen.cost < margin


def _undetectably_richer(selection: Selection, effect: Effect) -> tuple[str, ...]:
    """Return the richer forms of an effect that these recordings do not distinguish from the effect.

    All additional amplitudes of such a form are undetectable at the fraction `CALIBRATION.hidden` of the effect.
    """
    params = selection.chosen.estimate.params
    return tuple(
        form.name
        for form in (score.effect for score in selection.final_test.ranking if effect.name in score.effect.nested)
        if all(
            (minimum := selection.detectable[form.name][p.name]) is None
            or minimum > CALIBRATION.hidden * comparable_size(params, effect, p)
            for p in form.amplitudes
        )
    )


def _adds_nothing(replacements: _Replacements, richer: str) -> bool:
    """Return whether all additional amplitudes of a richer form are excluded and do not reduce the cost."""
    selection, fitted = replacements.selection, replacements.with_other(richer)
    score = selection.final_test.best_score(richer)
    better = fitted is not None and fitted.cost_at(selection.chosen.inflation) < selection.chosen.cost
    if score is None or richer in selection.chosen.effects or better:
        return False
    added = linear_exclusions(selection.final_test, score, selection.detectable.get(richer, {}))
    return bool(added) and all(amplitude.is_excluded for amplitude in added)


def _plausibility(replacements: _Replacements, score: Score) -> float:
    """Return the prior weight (`member_odds`) of a replacement at its estimated size, from its fit or its score."""
    name, other, chosen = replacements.name, score.effect.name, replacements.selection.chosen
    if (fitted := replacements.with_other(other)) is None:
        params = effect_params({})
        for parameter, value in score.named_amplitudes.items():
            params[param_index(other, parameter)] = value
        return plausibility(params, other)
    return chosen.priors[name] * member_odds(fitted, chosen, name, other)


def _size_odds(replacements: _Replacements, alternative: Alternative) -> float:
    """Return the prior odds of the size of an alternative that imitates the named effect completely; otherwise 1.

    Effect and alternative do not form a class if the effect imitates only a part of the alternative.
    """
    name, other = replacements.name, alternative.name
    if alternative.cosine < THRESHOLDS.indistinguishable or are_forms(name, other):
        return 1.0
    chosen, model = replacements.selection.chosen, replacements.selection.fitted[replacements.key_with(other)]
    rarity = EFFECTS[name].prior_odds / EFFECTS[other].prior_odds
    return rarity * model.priors[other] / chosen.priors[name]


def _alternatives(replacements: _Replacements, named: Score, others: Mapping[str, Score]) -> list[Alternative]:
    """Return the best alternatives to the named effect, in ascending order of cost."""
    selection = replacements.selection
    alternatives = (
        Alternative(other, replacements.test.cosine(named, score), fitted.cost_at(selection.chosen.inflation))
        for other, score in others.items()
        if (fitted := replacements.with_other(other)) is not None
        if other not in selection.misleading and fitted.key not in selection.impossible
    )
    ranked = sorted(alternatives, key=lambda alternative: (alternative.cost, alternative.name))
    return ranked[: CALIBRATION.alternatives]


def _added_cost(replacements: _Replacements, alternative: Alternative) -> float:
    """Return the cost of the set with an alternative minus that of the selected set.

    The result is negative if the set with the alternative has the lower cost and only its prior odds are smaller.

    For a richer form of the named effect, a margin is added, because it also fits integration errors and the unmodelled
    remainder.
    """
    chosen = replacements.selection.chosen
    added = alternative.cost - chosen.cost
    if replacements.name not in EFFECTS[alternative.name].nested:
        return added
    return max(added, 0.0) + form_indifference(replacements.selection.bare, chosen) - chosen.chance


def prior_odds(selection: Selection, model: Hypothesis, members: Collection[str] = ()) -> float:
    """Return the prior odds of a set against the selected set; 1 for sets of different size.

    The odds are the product of `Effect.prior_odds` over the added effects, divided by the product over the removed
    effects. For a friction drift that may only fit the residual of a missing dissipative effect, they are
    `CALIBRATION.drifting`. Sizes are not considered (`_size_odds`).

    Args:
        selection: the selected set
        model: the other set
        members: members of the class of the named effect, which counts as common if a member is common
    """
    if follows_decay(selection.bare, model, selection.chosen):
        return CALIBRATION.drifting
    added, removed = model.key - selection.chosen.key, selection.chosen.key - model.key
    if len(added) != len(removed):
        return 1.0
    of_class = max((EFFECTS[name].prior_odds for name in members), default=1.0)
    before = math.prod(of_class if name in members else EFFECTS[name].prior_odds for name in removed)
    return math.prod(EFFECTS[name].prior_odds for name in added) / before


def outside(selection: Selection, name: str = "", *, members: Iterable[str] = ()) -> float:
    """Return the probability that a cause outside the library explains the gap, or acts in place of an effect.

    Args:
        selection: the selected set and all fitted sets
        name: the effect; empty for the gap as a whole
        members: indistinguishable effects; if every rig has one of them, the effect does not count as a compensation
    """
    remainder = 0.0 if selection.chosen.at_noise_floor else selection.chosen.residuals.noise_ratio
    unexplained = max(1 - selection.share_explained, CALIBRATION.least_left)
    unique = selection.unique_share(name) if name else math.inf
    compensates = not any(EFFECTS[member].universal for member in members)
    compensation = selection.compensation_odds.get(name, 0.0) if compensates else 0.0
    return probability_outside(odds_outside(unexplained, remainder, unique, compensation))


def probabilities(selection: Selection, posteriors: tuple[EffectPosterior, ...], kind: str) -> Mapping[str, float]:
    """Return the probabilities of no gap, of an outside cause, and of each class.

    Args:
        selection: the selected set of effects
        posteriors: probabilities of the selected effects; empty if no effects are listed
        kind: kind of the verdict, such as `no_gap` or `inconclusive`
    """
    if kind == "no_gap" or not posteriors:
        of_bare = {"no_gap": CALIBRATION.sure, "inconclusive": CALIBRATION.unseen}.get(kind, 1 - CALIBRATION.sure)
        return {"no_gap": of_bare, "unexplained": 1 - of_bare}
    by_name = {"no_gap": 0.0, "unexplained": outside(selection)}
    for posterior in posteriors:
        by_name[posterior.name] = posterior.probability
        for other in posterior.alternatives:
            by_name[other.name] = max(by_name.get(other.name, 0.0), other.probability)
    return by_name
