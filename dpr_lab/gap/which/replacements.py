"""Moves that replace effects: by simpler forms, or by several others."""

from collections.abc import Iterator

from dpr_lab.gap.hypothesis.hypothesis import PENALTY, Hypothesis
from dpr_lab.gap.hypothesis.imitation import follows_remainder
from dpr_lab.gap.hypothesis.significance import form_indifference
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.which.fitted_sets import FittedSets
from dpr_lab.gap.which.search import Decision, Move, Proposal
from dpr_lab.gap.which.substitutes import simpler_forms


def _as_good(sets: FittedSets, current: Hypothesis, proposal: Proposal) -> Decision:
    """Accept a replacement that explains as much as the set, within the indifference margin.

    Above the noise floor a richer form may compensate for an effect outside the set. It must then explain more.
    """
    model, margin = proposal.model, form_indifference(sets.bare, current)
    alike = (
        model.at_noise_floor
        if current.at_noise_floor
        else model.bounded_excess < THRESHOLDS.slow * current.bounded_excess
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
    """Propose sets in which several simple effects replace or join a curve.

    The set must have fewer parameters in total. On a small arc a curve of many parameters imitates a tilt, friction and
    drag together, and is selected first.
    """
    for name in sets.unexpected(current):
        if name not in current.curves:
            continue
        model = sets.without(current, name)
        if current.curves[name] > PENALTY.ordinary:
            yield from _next_to(sets, model, name)
        for widest in (1, len(current.fit.free)):
            yield from _grown_to(sets, current, model, name, widest)


def _grown_to(sets: FittedSets, current: Hypothesis, model: Hypothesis, curve: str, widest: int) -> Iterator[Proposal]:
    """Extend a set without the curve by the best effects, one at a time.

    Each added effect has at most `widest` parameters. The extended set has fewer parameters than the current one.
    """
    while (room := min(len(current.fit.free) - 1 - len(model.fit.free), widest)) > 0:
        ranking = (score for score in sets.test(model).ranking if score.effect.name != curve)
        score = next((score for score in ranking if len(score.columns) <= room), None)
        if score is None or score.gain < current.chance:
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
        and model.bounded_excess < THRESHOLDS.slow * current.bounded_excess
    ):
        return Decision(True, "fewer parameters explain nearly as much, with sizes that a rig can have")
    better = model.cost < current.cost and model.at_noise_floor >= current.at_noise_floor
    return Decision(better, f"fewer parameters explain {'more' if better else 'less'}")


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
