"""Classes of effects that are indistinguishable in these recordings, alternatives, and their probabilities.

The signature of an effect is its change of the readings, with ratios and initial states projected out. Two effects form
one class if their signatures have a cosine of at least 0.999 and if they predict the recordings equally well: no
algorithm can distinguish them with these recordings. Within a class, the probability is divided according to the prior
of each member's fitted size (`dpr_lab.effects.plausibility`). For example, a clock error of 3 % is impossible for a
crystal, but a length error of 6 % is possible.

A richer form of a member counts as the member under two conditions: all its additional amplitudes are excluded at their
minimum detectable sizes, and together they improve the fit by less than their penalty. Both forms then differ by less
than these sizes, and further recordings would not change their odds.

The probability of a class is the softmax of the predictive costs of the selected set, of the fitted sets in which
another effect replaces the named one, and of the selected set without it. The softmax is multiplied by the probability
that the cause is in the library, and later by the factors of the validation (`dpr_lab.gap.transfer.transfer.judged`).
No other set counts as more probable than the selected set, because the search would have selected a significantly
better set. The odds of a cause outside the library are

    (unexplained / half)^steepness * m + imitates * unexplained / unique * m / far + (compensates / own)^2,
    m = min(remainder / noise, far)

with the share `unexplained` of the excess, the share `unique` that only this effect explains, and `own`, the fraction
of `unique` that other functional forms of the other effects cannot explain.

1. First term: if a law is missing from the library, a fixed share of its gap remains; the share does not depend on the
   ratio of gap and noise. The small causes of every rig leave a remainder of about the noise, for any size of the gap,
   unless the noise is much smaller than these causes.
2. Second term: an effect that explains no more than the remainder may imitate a part of the unknown cause.
3. Third term: a smaller effect may compensate for the inexact form of a large one.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.effects import EFFECTS, effect_params, param_index, plausibility
from dpr_lab.effects.effect import Effect
from dpr_lab.gap.classes.calibration import CALIBRATION, Calibration
from dpr_lab.gap.hypothesis.detectable import comparable_size, linear_exclusions
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.imitation import follows_decay
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.hypothesis.significance import adds_less_than_remains, form_indifference, indifference
from dpr_lab.gap.which.selected import Selection


@dataclass(frozen=True, slots=True)
class Alternative:
    """An alternative to a named effect, with its probability."""

    name: str
    cosine: float
    """Cosine between the signatures of the alternative and of the named effect.

    It is the part of the named effect that the alternative can imitate.
    """
    cost: float
    """Predictive cost of the set in which this effect replaces the named one."""
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
    """Richer forms of the members whose additional amplitudes are excluded; they count as the simpler form."""
    odds: tuple[float, ...] = ()
    """Share of each member in the probability, by the prior of its fitted size."""
    outside: float = 0.0
    """Probability that a cause outside the library replaces the effect."""


def effect_posterior(selection: Selection, name: str) -> EffectPosterior:
    """Compute the class, the alternatives and the probability of one named effect.

    Args:
        selection: the selected set and all fitted sets
        name: the effect
    """
    replacements, chosen = _Replacements(selection, name), selection.chosen
    named_score = replacements.test.of(name)
    others = {score.effect.name: score for score in replacements.test.ranking if score is not named_score}
    if named_score is None:  # without a score of the named effect, no signature can be compared with that of the effect
        plausibilities, forms, alternatives = dict[str, float](), (), list[Alternative]()
    else:
        plausibilities, forms = _class_members(replacements, named_score, others)
        rest = {other: others[other] for other in others if other not in plausibilities and other not in forms}
        alternatives = _alternatives(replacements, named_score, rest)
    prior = np.array([plausibility(chosen.estimate.params, name), *plausibilities.values()])
    costs = [_added_cost(replacements, alternative) for alternative in alternatives]
    without = selection.without_substitute[name].cost_at(chosen.inflation)
    added_cost = np.array([0.0, *costs, max(without - chosen.cost, 0.0)])
    scaled = -added_cost / (2 * chosen.inflation * CALIBRATION.temperature)
    weights = np.exp(np.clip(scaled, -CALIBRATION.negligible, CALIBRATION.negligible))
    replaced = (selection.fitted[replacements.key(alternative.name)] for alternative in alternatives)
    weights[1:-1] *= [prior_odds(selection, model) for model in replaced]
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
    """One effect of the selected set, and the fits in which another effect replaces it."""

    selection: Selection
    name: str

    @property
    def test(self) -> ScoreTest:
        """Score test of all effects for the set without the effect."""
        return self.selection.tests_without[self.name]

    def key(self, other: str) -> frozenset[str]:
        """Return the key of the set in which another effect replaces the named effect."""
        return self.selection.without[self.name].key | {other}

    def with_other(self, other: str) -> Hypothesis | None:
        """Return the set in which another effect replaces the named effect, or None if it was not fitted."""
        return self.selection.fitted.get(self.key(other))


def _class_members(
    replacements: _Replacements, named: Score, others: Mapping[str, Score]
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return the members of a class, and the richer forms that count as a member.

    The members are the effects that are indistinguishable from the named one. The value of each member is the prior of
    its size. The most plausible member comes first.
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

    In the fit without the named effect, the remaining effects may imitate it. This hides that the two signatures are
    equal. The signatures therefore also count as equal if the named effect absorbs the other effect in the selected
    fit. If the other effect was not fitted, its score may then be too small for a comparison, because the score belongs
    to the fit without the named effect. The absorption is sufficient in this case.

    A simpler form is also a member if the named effect improves on it by less than the unexplained remainder. The cause
    of the remainder can then imitate the difference. A simpler form that was not fitted is no member. A richer form is
    a member only if its additional parameters are undetectable (`_undetectably_richer`).
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
    """Return the richer forms of an effect whose additional parameters are undetectable in the recordings."""
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
    """Return whether a richer form adds only amplitudes that are excluded.

    Undetectable amplitudes are ignored. If the richer form was fitted, its additional amplitudes together must also
    reduce the cost by less than their penalty.
    """
    selection, fitted = replacements.selection, replacements.with_other(richer)
    score = selection.final_test.of(richer)
    better = fitted is not None and fitted.cost_at(selection.chosen.inflation) < selection.chosen.cost
    if score is None or richer in selection.chosen.effects or better:
        return False
    added = linear_exclusions(selection.final_test, score, selection.detectable.get(richer, {}))
    return bool(added) and all(amplitude.is_excluded for amplitude in added)


def _plausibility(replacements: _Replacements, score: Score) -> float:
    """Return the prior weight of the size of an effect that replaces a named effect.

    The size comes from a fit, or from the linear score if the effect was not fitted.
    """
    fitted = replacements.with_other(score.effect.name)
    if fitted is not None:
        return plausibility(fitted.estimate.params, score.effect.name)
    params = effect_params({})
    for name, value in score.named_amplitudes.items():
        params[param_index(score.effect.name, name)] = value
    return plausibility(params, score.effect.name)


def _alternatives(replacements: _Replacements, named: Score, others: Mapping[str, Score]) -> list[Alternative]:
    """Return the best alternatives to the named effect, sorted by cost and name.

    An alternative is an effect that replaces the named effect in a fitted set whose sizes are possible. For every set,
    the residual of the selected set counts as noise.
    """
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
    """Return the additional cost of an alternative over the selected set, at least zero.

    The search has compared the alternative with the selected set. An alternative that fits better is not significantly
    better, so it is at most as probable as the named effect. The cost of a richer form of the effect is increased,
    because such a form also fits the error of the integrator or the remainder.
    """
    chosen = replacements.selection.chosen
    added = max(alternative.cost - chosen.cost, 0.0)
    if replacements.name not in EFFECTS[alternative.name].nested:
        return added
    return added + form_indifference(replacements.selection.bare, chosen) - chosen.chance


def prior_odds(selection: Selection, model: Hypothesis) -> float:
    """Return the prior odds of a fitted set against the selected set.

    The odds are below one for a drift of friction that only follows the residual of a missing loss along one decay.
    """
    return CALIBRATION.drifting if follows_decay(selection.bare, model, selection.chosen) else 1.0


def outside(selection: Selection, name: str = "", *, members: Iterable[str] = ()) -> float:
    """Return the probability that a cause outside the library explains the gap.

    If `name` is given, return the probability that such a cause acts in place of this effect.

    Args:
        selection: the selected set and all fitted sets
        name: the effect; empty for the gap as a whole
        members: effects that are indistinguishable from the effect; if every rig has one of these effects, the effect
            does not count as a compensation
    """
    remainder = 0.0 if selection.chosen.at_noise_floor else selection.chosen.residuals.noise_ratio
    unexplained = max(1 - selection.share_explained, CALIBRATION.least_left)
    unique, own_share = (selection.unique_share(name), selection.own_shares.get(name, 1.0)) if name else (math.inf, 1.0)
    if any(EFFECTS[member].universal for member in members):
        own_share = 1.0
    return probability_outside(odds_outside(unexplained, remainder, unique, own_share))


def probability_outside(odds: float, calibration: Calibration = CALIBRATION) -> float:
    """Return the probability of a cause outside the library from its odds."""
    return max(odds / (1 + odds), calibration.outside_when_closed)


def odds_outside(
    unexplained: float,
    remainder: float,
    unique: float = math.inf,
    own_share: float = 1.0,
    calibration: Calibration = CALIBRATION,
) -> float:
    """Return the odds of a cause outside the library.

    Args:
        unexplained: share of the excess that is not explained
        remainder: rms of the unexplained residual, in units of the noise; zero if only noise remains
        unique: share of the excess that only the effect explains; infinite for the gap as a whole
        own_share: fraction of `unique` that no other form of the other effects explains; 1 for a dominant effect
        calibration: calibration of the probabilities
    """
    size = min(remainder, calibration.far)
    of_gap = (unexplained / calibration.half_unexplained) ** calibration.steepness * size
    imitated = unexplained / max(unique, calibration.least_left)
    compensated = (calibration.compensates / max(own_share, calibration.least_own)) ** 2 if own_share < 1 else 0.0
    return float(of_gap + calibration.imitates * imitated * size / calibration.far + compensated)


def probabilities(selection: Selection, posteriors: tuple[EffectPosterior, ...], kind: str) -> Mapping[str, float]:
    """Return the probabilities of no gap, of an outside cause, and of each class.

    Args:
        selection: the selected set of effects
        posteriors: probabilities of the selected effects; empty if no effects are listed
        kind: the verdict
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
