"""Moves that replace an effect: by a simpler form, or by several other effects."""

from collections.abc import Iterator

from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.imitation import follows_remainder
from dpr_lab.gap.hypothesis.significance import form_indifference
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.restarts import simpler_forms
from dpr_lab.gap.which.search import Decision, Move, Proposal


def _as_good(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    """Accept a replacement that explains as much as the set, within the indifference margin.

    Above the noise floor a richer form may compensate for an effect outside the set. It must then explain more.
    """
    model, margin = proposal.model, form_indifference(sets.bare, current)
    alike = (
        model.at_noise_floor
        if current.at_noise_floor
        else model.bounded_excess < THRESHOLDS.excess_factor * current.bounded_excess
    )
    if alike and model.cost - current.cost < margin:
        return Decision(True, f"the criterion grows by less than {margin:.3g}")
    return Decision(False, "explains less")


SIMPLER_FORM = Move(
    "simpler form",
    "an effect is replaced by a simpler one that it contains, if this one explains as much",
    lambda sets, current: map(Proposal, simpler_forms(sets, current)),
    _as_good,
    then="repeat",
)


def _several_for_one(sets: FittedSets, current: Hypothesis) -> Iterator[Proposal]:
    """Propose sets in which effects with one amplitude replace a curve.

    On a small arc, a curve of many parameters imitates a tilt, friction and drag together, and is selected first. The
    best effects are added one at a time, while the set has fewer parameters than the current one. An effect of one
    amplitude may have a shape, which is a further parameter.
    """
    for curve in sets.unexpected(current):
        if curve not in current.curves:
            continue
        model = sets.without(current, curve)
        while model.parameters + 1 < current.parameters:
            ranking = (score for score in sets.test(model).ranking if score.effect.name != curve)
            score = next((score for score in ranking if len(score.columns) == 1), None)
            if score is None or score.gain < current.chance:
                break
            model = sets.with_one(model, score)
            if model.parameters < current.parameters and sets.possible(model):
                yield Proposal(model)


def _nearly_as_good_with_fewer_parameters(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    model = proposal.model
    if (
        sets.possible(model)
        and not sets.possible(current)
        and model.bounded_excess < THRESHOLDS.excess_factor * current.bounded_excess
    ):
        return Decision(True, "fewer parameters explain nearly as much, with sizes that a rig can have")
    if model.cost < current.cost and model.at_noise_floor >= current.at_noise_floor:
        return Decision(True, "fewer parameters explain more")
    if follows_remainder(sets.bare, current, model):
        return Decision(True, "the additional effect only fits the remainder of small unknown causes")
    return Decision(False, "fewer parameters explain less")


SEVERAL_CAUSES = Move(
    "several causes",
    "an effect with many parameters is replaced by several effects that explain more, or nearly as much, with fewer"
    " parameters",
    _several_for_one,
    _nearly_as_good_with_fewer_parameters,
    then="repeat",
)
