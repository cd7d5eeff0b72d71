"""Moves that remove effects which are unnecessary, only compensate, or do not transfer."""

from collections.abc import Iterator

import numpy as np

from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.significance import (
    accepted,
    evidence_ratio,
    explains_as_much,
    segment_scatter,
    significance,
)
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.forms import own_share
from dpr_lab.gap.which.search import Decision, Move, Proposal
from dpr_lab.shown import percent


def _smaller_adequate(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose the smallest fitted set, on any branch, that explains nearly as much as the current set.

    It keeps the known effects of the rig, and adds no size that is typical of another cause. An impossible size is
    allowed, because later moves can make it possible.
    """
    smaller_sets = [
        model
        for model in sets.fits.values()
        if 0 < len(model.effects) < len(current.effects)
        and current.key & sets.expected <= model.key
        and set(sets.imitating(model)) <= set(sets.imitating(current))
    ]
    adequate = [model for model in smaller_sets if _explains_nearly_as_much(sets, model, current)]
    if adequate:
        yield Proposal(min(adequate, key=lambda model: (len(model.effects), model.cost)))


def _explains_nearly_as_much(sets: FittedSets, model: Hypothesis, current: Hypothesis) -> bool:
    """Return whether a smaller set is as likely as the current set and lacks no large effect."""
    lost = model.bounded_excess - current.bounded_excess
    if lost >= THRESHOLDS.large * sets.corrected_bare(current).bounded_excess:
        return False
    if model.bounded_excess >= THRESHOLDS.necessary_factor * current.bounded_excess:
        return False
    if current.at_noise_floor and not model.at_noise_floor:
        return False
    chance = significance(sets.bare, model, current) if current.at_noise_floor else segment_scatter(model, current)
    return model.cost - current.cost < chance


SMALLEST_ADEQUATE = Move(
    "smallest adequate set",
    "an earlier, smaller set that explains nearly as much replaces the current one",
    _smaller_adequate,
    lambda *_: Decision(True, "fewer effects explain nearly as much"),
)


def _without_least_needed(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose the set without its least necessary effect."""
    if len(current.effects) < 2:
        return
    removable = [name for name in sets.unexpected(current) if sets.as_possible(sets.without(current, name), current)]
    if removable:
        bare = sets.corrected_bare(current)
        needs = {name: evidence_ratio(bare, current, sets.without_substitute(current, name)) for name in removable}
        least = min(needs, key=lambda name: needs[name])
        yield Proposal(sets.without(current, least), needs[least])


def _not_needed(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    if proposal.value < 1:
        return Decision(True, f"not necessary: {proposal.value:.2g} of the required increase")
    chance = significance(sets.bare, proposal.model, current)
    if proposal.model.cost - current.cost > chance:
        return Decision(False, f"necessary: {proposal.value:.3g} times the required increase")
    return Decision(True, f"the criterion grows by less than {chance:.3g}, which is not significant")


DROP = Move(
    "drop",
    "backward elimination: an effect is removed if the excess chi-square hardly increases without it",
    _without_least_needed,
    _not_needed,
    then="repeat",
)


def _without_least_own(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose the set without the effect that has the smallest own share, while a residual remains.

    The own share is the part of its reduction that no other form of the remaining effects explains. A free function
    can imitate an effect with few amplitudes even if this effect is the cause. A set that keeps it, and lacks an effect
    with more amplitudes instead, is therefore proposed first if it explains as much.
    """
    if current.at_noise_floor or len(current.effects) < 2:
        return
    smaller_sets = _without_possible_compensations(sets, current)
    shares = {
        name: own_share(sets.problem, smaller, sets.test(smaller), name) for name, smaller in smaller_sets.items()
    }
    proposals = [Proposal(smaller_sets[name], share) for name, share in shares.items() if share is not None]
    if not proposals:
        return
    least = min(proposals, key=lambda proposal: proposal.value)
    simpler = [other for other in smaller_sets.values() if explains_as_much(sets.bare, other, least.model)]
    if simpler and least.value < THRESHOLDS.own_share:
        yield Proposal(min(simpler, key=lambda model: (len(model.fit.free), model.cost)))
    yield least


def _without_possible_compensations(sets: FittedSets, current: Hypothesis) -> dict[str, Hypothesis]:
    """Return, for each effect that may only compensate for another effect's form, the set without it.

    Two kinds of effects are not included: those that every rig has, and those without which the excess is far above
    that of the best fitted set. The result is empty if a removal would lead the search to a curve that explains less.
    """
    closest = min(model.bounded_excess for model in sets.fits.values())
    limit = min(THRESHOLDS.necessary_factor_if_small * closest, THRESHOLDS.open_share * sets.bare.bounded_excess)
    removable = (name for name in sets.unexpected(current) if not sets.library[name].universal)
    smaller_sets = {name: sets.without(current, name) for name in removable}  # also fitted for the following test
    if _removal_leads_to_curve(sets, current):
        return {}
    return {
        name: smaller
        for name, smaller in smaller_sets.items()
        if smaller.bounded_excess <= limit and sets.as_possible(smaller, current)
    }


def _removal_leads_to_curve(sets: FittedSets, current: Hypothesis) -> bool:
    """Return whether the best possible smaller set costs more and has more parameters: it contains a curve.

    The search would choose this set after a removal. All smaller sets must be fitted first.
    """
    others = (
        model for model in sets.fits.values() if len(model.effects) < len(current.effects) and sets.possible(model)
    )
    best = min(others, key=lambda model: model.cost, default=current)
    return best.cost > current.cost and len(best.fit.free) > len(current.fit.free)


def _compensates_for_another_form(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    if np.isnan(proposal.value):
        return Decision(True, "of two effects that explain the same part, the one with fewer amplitudes is kept")
    share = f"{percent(proposal.value)} of its reduction is explained by no other form of the remaining effects"
    return Decision(proposal.value < THRESHOLDS.own_share, share)


OWN_SHARE = Move(
    "own share",
    "while the residual exceeds the noise, an effect is removed if other functional forms of the remaining"
    " effects explain the same residual; of two such effects the one with fewer amplitudes is kept",
    _without_least_own,
    _compensates_for_another_form,
    then="repeat",
)


def _without_misleading(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose the set without misleading effects or, if it predicts held-out runs better, with replacements."""
    smaller = sets.predictive(current)
    if smaller is current or sets.held_out_chi2 is None:
        return
    limit, misleading = sets.held_out_chi2(smaller), current.key - smaller.key
    others = [
        model
        for model in sets.fits.values()
        if smaller.key < model.key
        and not misleading & model.key
        and len(model.key) <= len(current.key)
        and sets.possible(model)
        and accepted(sets.bare, smaller, model)
        and sets.held_out_chi2(model) < limit
    ]
    yield Proposal(min(others, key=lambda model: model.cost, default=smaller))


def _predicts_held_out_runs(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    others = proposal.model.key - current.key
    return Decision(True, "held-out runs are predicted better " + ("with the other effect" if others else "without it"))


HELD_OUT = Move(
    "held-out runs",
    "at the end, effects that worsen the prediction of held-out runs are removed, or replaced by others",
    _without_misleading,
    _predicts_held_out_runs,
)
