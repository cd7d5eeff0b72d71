"""Moves that remove effects: unnecessary ones, and those that worsen held-out predictions."""

from collections.abc import Iterator

from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.significance import (
    accepted,
    evidence_ratio,
    segment_scatter,
    significance,
)
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.search import Decision, Move, Proposal


def _smaller_adequate(fitted_sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose the smallest fitted set that explains nearly as much as the current set.

    Only sets with the known effects of the rig are considered. Effects whose sizes indicate another cause must be in
    the current set with such a size as well. Impossible sizes are allowed, because later moves can correct them.
    """
    smaller_sets = [
        model
        for model in fitted_sets.fits.values()
        if 0 < len(model.effects) < len(current.effects)
        and current.key & fitted_sets.expected <= model.key
        and set(fitted_sets.imitating(model)) <= set(fitted_sets.imitating(current))
    ]
    adequate = [model for model in smaller_sets if _explains_nearly_as_much(fitted_sets, model, current)]
    if adequate:
        yield Proposal(min(adequate, key=lambda model: (len(model.effects), model.cost)))


def _explains_nearly_as_much(fitted_sets: FittedSets, model: Hypothesis, current: Hypothesis) -> bool:
    """Return whether a smaller set explains nearly as much as the current set, at no significantly higher cost."""
    lost = model.bounded_excess - current.bounded_excess
    if lost >= THRESHOLDS.large * fitted_sets.corrected_bare(current).bounded_excess:
        return False
    if model.bounded_excess >= THRESHOLDS.necessary_factor * current.bounded_excess:
        return False
    if current.at_noise_floor and not model.at_noise_floor:
        return False
    chance = (
        significance(fitted_sets.bare, model, current) if current.at_noise_floor else segment_scatter(model, current)
    )
    return model.cost - current.cost < chance


SMALLEST_ADEQUATE = Move(
    "smallest adequate set",
    "an earlier, smaller set that explains nearly as much replaces the current one",
    _smaller_adequate,
    lambda *_: Decision(True, "explains nearly as much with fewer effects"),
)


def _without_least_needed(fitted_sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose the set without its least necessary effect."""
    if len(current.effects) < 2:
        return
    removable = [
        name
        for name in fitted_sets.unexpected(current)
        if fitted_sets.as_possible(fitted_sets.without(current, name), current)
    ]
    if removable:
        bare = fitted_sets.corrected_bare(current)
        needs = {
            name: evidence_ratio(bare, current, fitted_sets.without_substitute(current, name)) for name in removable
        }
        least = min(needs, key=lambda name: needs[name])
        yield Proposal(fitted_sets.without(current, least), needs[least])


def _not_needed(fitted_sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    if proposal.value < 1:
        return Decision(True, f"not necessary: {proposal.value:.2g} of the required increase")
    chance = significance(fitted_sets.bare, proposal.model, current)
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


def _without_misleading(fitted_sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose the set without effects that worsen held-out predictions, or with better replacements."""
    smaller = fitted_sets.predictive(current)
    if smaller is current or fitted_sets.held_out_chi2 is None:
        return
    limit, misleading = fitted_sets.held_out_chi2(smaller), current.key - smaller.key
    others = [
        model
        for model in fitted_sets.fits.values()
        if smaller.key < model.key
        and not misleading & model.key
        and len(model.key) <= len(current.key)
        and fitted_sets.possible(model)
        and accepted(fitted_sets.bare, smaller, model)
        and fitted_sets.held_out_chi2(model) < limit
    ]
    yield Proposal(min(others, key=lambda model: model.cost, default=smaller))


def _predicts_held_out_runs(fitted_sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    others = proposal.model.key - current.key
    return Decision(True, "held-out runs are predicted better " + ("with the other effect" if others else "without it"))


HELD_OUT = Move(
    "held-out runs",
    "at the end, effects that worsen the prediction of held-out runs are removed, or replaced by others",
    _without_misleading,
    _predicts_held_out_runs,
)
