"""The moves of the search besides forward selection: each adds, removes, replaces or refits effects of the set.

A move consists of a generator of proposed sets and a rule that accepts or rejects them; `MOVES`, at the end, lists
them.

The criterion is the held-out chi-square plus the penalty of the parameters (`Hypothesis.cost`). The reduction that is
not significant, and the increase of the excess from which an effect is necessary, are defined in
`dpr_lab.gap.hypothesis.thresholds`.
"""

from collections.abc import Iterator, Mapping

from dpr_lab.effects import plausibility
from dpr_lab.gap.hypothesis.hypothesis import PENALTY, Hypothesis, refit_with, refit_without
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.hypothesis.thresholds import (
    THRESHOLDS,
    at_noise_floor,
    excess,
    indifference,
    need,
    scatter,
    significance,
)
from dpr_lab.gap.which.fitted_sets import EFFORT, FittedSets
from dpr_lab.gap.which.forms import own_share
from dpr_lab.gap.which.search import Decision, Move, Proposal

REPLACEMENTS = 2
"""Number of candidates that are fitted in place of each effect."""


def _with_what_is_known(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """The bare model with the known effects of the rig that these recordings show."""
    start = sets.start()
    if start.effects:
        yield Proposal(start)


def _known(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    return Decision(True, "every rig of this kind has them")


def _smaller_adequate(sets: FittedSets, grown: Hypothesis) -> Iterator[Proposal]:
    """The smallest fitted set that explains nearly as much; it may lie on another branch of the search."""
    adequate = [
        model
        for model in sets.fits.values()
        if 0 < len(model.effects) < len(grown.effects)
        and grown.key & sets.expected <= model.key
        and excess(model) < THRESHOLDS.keeps * excess(grown)
        and excess(model) - excess(grown) < THRESHOLDS.large * excess(sets.bare)
        and (
            _as_likely(sets, model, grown) if at_noise_floor(grown) else model.cost - grown.cost < scatter(model, grown)
        )
    ]
    if adequate:
        yield Proposal(min(adequate, key=lambda model: (len(model.effects), model.cost)))


def _as_likely(sets: FittedSets, model: Hypothesis, grown: Hypothesis) -> bool:
    return at_noise_floor(model) and model.cost - grown.cost < significance(sets.bare, model, grown)


def _adequate(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    return Decision(True, "fewer effects explain nearly as much")


def _without_least_needed(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """The set without its least necessary effect; a single effect is judged by its share of the whole gap."""
    removable = sets.unexpected(current)
    if len(current.effects) > 1 and removable:
        needs = {name: need(sets.bare, current, sets.lacking(current, name)) for name in removable}
        least = min(needs, key=lambda name: needs[name])
        yield Proposal(sets.without(current, least), needs[least])


def _not_needed(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    if proposal.value < 1:
        return Decision(True, f"not necessary: {proposal.value:.2g} of the required increase")
    chance = significance(sets.bare, proposal.model, current)
    if proposal.model.cost - current.cost > chance:
        return Decision(False, f"necessary: {proposal.value:.3g} times the required increase")
    return Decision(True, f"the criterion grows by less than {chance:.3g}, which is not significant")


def _richer(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """An effect replaced by a richer one that contains it, if the score test shows a contribution of the richer one."""
    chance = THRESHOLDS.chance * current.residuals.inflation
    test = sets.test(current)
    for score in test.ranking:
        inner = [name for name in score.effect.nested if name in current.effects]
        if inner and score.gain > chance:
            both = refit_with(sets.problem, current, test, score, iterations=EFFORT.fine)
            richer = sets.keep(refit_without(sets.problem, both, inner[0], sets.bare))
            yield Proposal(sets.escaped(richer) if current.cost - richer.cost > chance else richer)


def _better_than_chance(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    chance = THRESHOLDS.chance * current.residuals.inflation
    better = current.cost - proposal.model.cost > chance
    return Decision(better, f"the criterion falls by {'more' if better else 'less'} than {chance:.3g}")


def _simpler(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """An effect replaced by a simpler one that it contains."""
    for name in current.effects:
        for simpler in sets.library[name].nested:
            if simpler in sets.library and simpler not in current.effects:
                replaced = sets.replaced(current, name, simpler)
                if replaced is not None:
                    yield Proposal(replaced)


def _as_good(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    """While a residual remains, a richer form may merely compensate for it; it must then explain more."""
    model, closed = proposal.model, at_noise_floor(current)
    margin = indifference(sets.bare, current, share=THRESHOLDS.integrator if closed else THRESHOLDS.contained)
    alike = at_noise_floor(model) if closed else excess(model) < THRESHOLDS.slow * excess(current)
    if alike and model.cost - current.cost < margin:
        return Decision(True, f"the criterion grows by less than {margin:.3g}")
    return Decision(False, "explains less")


def _second_cause(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """An effect replaced by a simpler one and another effect, which together have fewer parameters.

    The additional parameters of a richer form may imitate a second cause; unequal friction in the two directions
    imitates a zero offset.
    """
    for simpler in (proposal.model for proposal in _simpler(sets, current)):
        fewer = len(current.fit.free) - len(simpler.fit.free)
        score = next((score for score in sets.test(simpler).ranking if len(score.columns) < fewer), None)
        if score is not None and score.gain > THRESHOLDS.chance * current.residuals.inflation:
            yield Proposal(sets.with_one(simpler, score))


def _several_for_one(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """A curve replaced by others that together have fewer parameters, or joined by a simple effect that it follows.

    A curve of many parameters follows on a small arc what a tilt, friction and drag do together, and is met first.
    """
    for name in sets.unexpected(current):
        if name not in current.curves:
            continue
        model = sets.without(current, name)
        if current.curves[name] > PENALTY.ordinary:
            yield from _next_to(sets, model, name)
        while True:
            room = len(current.fit.free) - len(model.fit.free) - 1
            ranking = (score for score in sets.test(model).ranking if score.effect.name != name)
            score = next((score for score in ranking if len(score.columns) <= room), None)
            if score is None or score.gain < THRESHOLDS.chance * current.residuals.inflation:
                break
            model = sets.with_one(model, score)
            if sets.possible(model):
                yield Proposal(model)


def _next_to(sets: FittedSets, without_curve: Hypothesis, curve: str) -> Iterator[Proposal]:
    """The curve next to the simple effect that best explains the same; fitted last, it takes only what is left."""
    simple = next((score for score in sets.test(without_curve).ranking if len(score.columns) == 1), None)
    if simple is not None and simple.gain > 0.0:
        model = sets.with_one(without_curve, simple)
        score = sets.test(model).of(curve)
        if score is not None:
            yield Proposal(sets.with_one(model, score))


def _better_with_fewer_parameters(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    model = proposal.model
    better = model.cost < current.cost and at_noise_floor(model) >= at_noise_floor(current)
    return Decision(better, f"fewer parameters explain {'more' if better else 'less'}")


def _exchanged(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """While a residual remains: the best set with one effect replaced by another one or by another shape of it."""
    if at_noise_floor(current) or not current.effects:
        return
    best = current
    for name in sets.unexpected(current):
        less = sets.without(current, name)
        if sets.library[name].shapes:
            best = min(best, sets.reshaped(current, name), key=_criterion)
        for score in sets.test(less).ranking[:REPLACEMENTS]:
            if score.effect.name != name:
                other = sets.with_one(less, score)
                best = min(best, other, key=_criterion) if sets.possible(other) else best
    if best is not current:
        yield Proposal(best)


def _closer(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    model = proposal.model
    if excess(current) >= THRESHOLDS.slow * excess(model):
        return Decision(True, f"the excess shrinks by more than a factor of {THRESHOLDS.slow:g}")
    if model.key == current.key:
        return Decision(True, "the same effects in a better shape")
    return Decision(False, f"the excess shrinks by less than a factor of {THRESHOLDS.slow:g}")


def _without_each(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """The sets without one effect, for each effect in turn."""
    for name in current.effects:
        yield Proposal(sets.lacking(current, name))


def _predicts_better(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    """Cross-validation: an effect that worsens the prediction of a run from the other runs is not a cause."""
    less, tolerance = proposal.model, THRESHOLDS.chance * current.residuals.inflation
    if excess(less) > excess(sets.bare):  # its fit diverged and predicts nothing
        return Decision(False, "without it the fit does not converge")
    if (current.predictive_loss - less.predictive_loss > tolerance).any():
        return Decision(True, "without it, a run is predicted better from the other runs")
    return Decision(False, "with it, no run is predicted worse")


def _without_least_own(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """While a residual remains: the set without the effect that contributes least beyond other forms of the rest.

    An effect without which hardly any of the reduction remains is not proposed, because it compensates for nothing
    else. All removed effects together may not increase the excess far above that of the best fitted set.
    """
    if at_noise_floor(current) or len(current.effects) < 2:
        return
    closest = min(map(excess, sets.fits.values()))
    limit = min(THRESHOLDS.keeps_if_small * closest, THRESHOLDS.still_open * excess(sets.bare))
    shares: list[Proposal] = []
    for name in sets.unexpected(current):
        less = sets.without(current, name)
        score = sets.test(less).of(name) if excess(less) <= limit else None
        if score is not None:
            shares.append(Proposal(less, own_share(sets.problem, less, sets.test(less), score)))
    yield from sorted(shares, key=lambda proposal: proposal.value)[:1]


def _makes_up_for_another_form(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    share = f"{proposal.value:.0%} of its reduction is explained by no other form of the remaining effects"
    return Decision(proposal.value < THRESHOLDS.own_share, share)


def _converged(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    converged = sets.converged(current)
    if converged is not current:
        yield Proposal(converged)


def _fitted_to_the_end(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    fewer = len(proposal.model.effects) < len(current.effects)
    return Decision(
        True, "at the minimum; effects with zero amplitude are removed" if fewer else "the minimum was not reached"
    )


def _better_alternative(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """The best set of the same or smaller size among all sets that were fitted in comparisons with alternatives."""
    fits = with_alternatives(sets, predictive(sets, current))
    known = current.key & sets.expected
    others = [
        model
        for model in fits.values()
        if model.effects
        and len(model.effects) <= len(current.effects)
        and known <= model.key
        and (sets.possible(model) or not sets.possible(current))
    ]
    best = min(others, key=_criterion, default=current)
    if best.key != current.key:
        yield Proposal(best)


def _explains_more(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    best, chance = proposal.model, significance(sets.bare, current, proposal.model)
    if at_noise_floor(best) < at_noise_floor(current):
        return Decision(False, "the residual exceeds the noise")
    if current.cost - best.cost > chance:
        return Decision(True, f"the criterion falls by more than {chance:.3g}")
    return Decision(False, f"the criterion falls by less than {chance:.3g}, which is not significant")


def _more_plausible(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """The set with one effect replaced by an indistinguishable one of a far more plausible size."""
    chosen = predictive(sets, current)
    margin = indifference(sets.bare, chosen)
    for name in sets.unexpected(chosen):
        less = sets.without(chosen, name)
        test, own = sets.test(less), plausibility(chosen.fit.estimate.params, name)
        score = test.shaped[name][0]
        for other in test.ranking:
            model = sets.fits.get(less.key | {other.effect.name})
            if model is None or model.key == chosen.key or abs(model.cost - chosen.cost) > margin:
                continue
            alike = min(test.cosine(score, other), test.cosine(other, score)) > THRESHOLDS.indistinguishable
            if alike:
                yield Proposal(model, plausibility(model.fit.estimate.params, other.effect.name) / own)


def _far_more_plausible(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    return Decision(
        proposal.value > THRESHOLDS.likelier,
        f"indistinguishable; the ratio of the prior probabilities of the sizes is {proposal.value:.2g}",
    )


def _without_misleading(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    less = predictive(sets, current)
    if less is not current:
        yield Proposal(less)


def _predicts_held_out_runs(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    return Decision(True, "held-out runs are predicted better without it")


def predictive(sets: FittedSets, model: Hypothesis) -> Hypothesis:
    """The set without the effects that worsen the prediction of held-out runs, the worst first."""
    if sets.unseen_chi2 is None or len(model.effects) < 2:
        return model
    fewer = [sets.lacking(model, name) for name in model.effects]
    remaining = [sets.unseen_chi2(less) for less in fewer]
    least = remaining.index(min(remaining))
    return predictive(sets, fewer[least]) if remaining[least] < sets.unseen_chi2(model) else model


def with_alternatives(sets: FittedSets, chosen: Hypothesis) -> Mapping[frozenset[str], Hypothesis]:
    """All fitted sets, including those with an alternative in place of each effect.

    Alternatives are effects that the linear scores can hardly distinguish from the effect, or rank above it.
    """
    for name in chosen.effects:
        less = sets.without(chosen, name)
        test = sets.test(less)
        for score in _indistinguishable(test, name):
            sets.escaped(sets.with_one(less, score))
        for score in test.ranking[:REPLACEMENTS]:
            if score.effect.name != name and less.cost - score.gain < chosen.cost:
                sets.with_one(less, score)
    return sets.fits


def _indistinguishable(test: ScoreTest, name: str) -> Iterator[Score]:
    """Effects with the signature of another one that are neither a simpler nor a richer form of it."""
    own = test.shaped[name][0]
    for score in test.ranking:
        form = score.effect.name in {name, *own.effect.nested} or name in score.effect.nested
        if not form and score.gain > 0 and test.cosine(own, score) > THRESHOLDS.indistinguishable:
            yield score


def _criterion(model: Hypothesis) -> float:
    return model.cost


START = Move(
    "known effects",
    "effects that every rig of this kind has are included first, as far as the recordings show them",
    _with_what_is_known,
    _known,
)
SMALLEST_ADEQUATE = Move(
    "smallest adequate set",
    "an earlier, smaller set that explains nearly as much replaces the current one",
    _smaller_adequate,
    _adequate,
)
DROP = Move(
    "drop",
    "backward elimination: an effect is removed if the excess chi-square hardly increases without it",
    _without_least_needed,
    _not_needed,
    then="repeat",
)
RICHER_FORM = Move(
    "richer form", "an effect is replaced by a richer one that contains it", _richer, _better_than_chance
)
SIMPLER_FORM = Move(
    "simpler form",
    "an effect is replaced by a simpler one that it contains and that explains as much",
    _simpler,
    _as_good,
    then="repeat",
)
SECOND_CAUSE = Move(
    "second cause",
    "an effect is replaced by a simpler one and a second effect that explain more with fewer parameters",
    _second_cause,
    _better_with_fewer_parameters,
    then="repeat",
)
SEVERAL_CAUSES = Move(
    "several causes",
    "an effect of many parameters is replaced by others that explain more with fewer",
    _several_for_one,
    _better_with_fewer_parameters,
    then="repeat",
)
EXCHANGE = Move(
    "exchange",
    "while the residual exceeds the noise, each effect is replaced in turn by other effects and other shapes",
    _exchanged,
    _closer,
    then="repeat",
)
CROSS_VALIDATION = Move(
    "cross-validation",
    "an effect is removed if it worsens the prediction of a run from the other runs",
    _without_each,
    _predicts_better,
    then="repeat",
)
OWN_SHARE = Move(
    "own share",
    "while the residual exceeds the noise, an effect is removed if other functional forms of the remaining"
    " effects explain the same residual",
    _without_least_own,
    _makes_up_for_another_form,
    then="repeat",
)
CONVERGE = Move("converge", "the fit is continued to its minimum", _converged, _fitted_to_the_end)
BETTER_ALTERNATIVE = Move(
    "better alternative",
    "alternatives of each effect are fitted; a set of the same or smaller size that explains more replaces"
    " the current one",
    _better_alternative,
    _explains_more,
)
MORE_PLAUSIBLE = Move(
    "more plausible size",
    "of two indistinguishable effects, the one with the far more plausible size is named",
    _more_plausible,
    _far_more_plausible,
)
HELD_OUT = Move(
    "held-out runs",
    "at the end, effects that worsen the prediction of held-out runs are removed",
    _without_misleading,
    _predicts_held_out_runs,
)

REFINE = (
    SMALLEST_ADEQUATE,
    DROP,
    RICHER_FORM,
    SIMPLER_FORM,
    SECOND_CAUSE,
    SEVERAL_CAUSES,
    EXCHANGE,
    SECOND_CAUSE,
    DROP,
    CROSS_VALIDATION,
    OWN_SHARE,
    CONVERGE,
)
"""The moves after forward selection, in order."""

SHORT = (SMALLEST_ADEQUATE, DROP, SIMPLER_FORM)
"""The moves after forward selection in short segments."""

REVISIONS = ((BETTER_ALTERNATIVE, (DROP, OWN_SHARE, CONVERGE)), (MORE_PLAUSIBLE, (CONVERGE,)))
"""Revisions of the selected set, and the moves after each revision that changes the set."""

MOVES = (
    START,
    SMALLEST_ADEQUATE,
    DROP,
    RICHER_FORM,
    SIMPLER_FORM,
    SECOND_CAUSE,
    SEVERAL_CAUSES,
    EXCHANGE,
    CROSS_VALIDATION,
    OWN_SHARE,
    CONVERGE,
    BETTER_ALTERNATIVE,
    MORE_PLAUSIBLE,
    HELD_OUT,
)
"""All moves except `forward.forward_selection` and `select.short_segments`, which depend on the number of effects."""
