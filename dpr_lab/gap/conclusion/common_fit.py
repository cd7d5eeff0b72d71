"""Fit of the common effects alone, which a diagnosis shows if it claims no cause.

The common effects are those of a textbook fit: zero errors, a tilt, an error of L1 or gravity, dry friction and air
drag. With few segments or correlated noise, they may be insignificant as causes although they explain much of the
gap. Their sizes are nevertheless useful, and the share that they explain shows whether the cause can be one of them.

Starting from the bare model, the common effect that reduces chi2 most is added in each step. A step must reduce the
excess as much as the search requires of an additional effect (`most_excess`), but need not be significant.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from dpr_lab.effects import EFFECTS, named_params
from dpr_lab.effects.effect import Effect, Params
from dpr_lab.gap.conclusion.uncertainty import whole_covariance
from dpr_lab.gap.conclusion.verdict import VERDICT, DetailedVerdict, gap_is_small
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.refits import REFITS, refit_with
from dpr_lab.gap.hypothesis.score_test import score_test
from dpr_lab.gap.hypothesis.significance import most_excess
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.result.causes import CommonEffect, EffectSize
from dpr_lab.gap.state import Fitted, Transferred, half_widths90
from dpr_lab.gap.where.discrepancy import discrepancy
from dpr_lab.gap.which.sizes import rises, significantly_oversized
from dpr_lab.shown import percent


@dataclass(frozen=True, slots=True)
class CommonFitRules:
    """Effort of the fit of the common effects."""

    candidates: int = 2
    """Number of effects fitted in each step. Several are fitted, because a score is only a linear prediction."""


COMMON_FIT = CommonFitRules()

DescribeSizes = Callable[[str, Params, Mapping[tuple[str, str], float]], dict[str, EffectSize]]


class CommonSet(NamedTuple):
    """A set with one more common effect."""

    model: Hypothesis
    members: tuple[str, ...]
    """The added effect and the common effects that are indistinguishable from it."""


def common_fit(kind: DetailedVerdict, state: Transferred, described: DescribeSizes) -> list[CommonEffect] | None:
    """Return the common effects that explain the gap best, in the order of their shares.

    An effect that a later step removes is left out. The list is empty if no common effect explains enough. The result
    is None if a cause with a tested form is claimed, if the segments show no gap, or if the selected set contains the
    same effects.

    Args:
        kind: the verdict
        state: results of all stages
        described: function (effect, values, half widths) that describes the sizes of an effect
    """
    problem, selection = state.fitted.problem, state.selection
    if not _shown(kind, state):
        return None
    tested = selection.final_test.tested | selection.chosen.key
    steps = [*common_steps(state.fitted, selection.bare, tested, selection.fitted)]
    if not steps:
        return []
    model = steps[-1].model
    if model.key == selection.chosen.key:
        return None
    covariance = whole_covariance(problem, model, state.fitted.request.rig, discrepancy(problem, model))
    errors = half_widths90(model, covariance)
    values, excess = named_params(model.estimate.params), selection.bare.residuals.excess
    return [
        CommonEffect.model_validate(
            {
                "name": step.members[0],
                "class": list(step.members),
                "parameters": described(step.members[0], values[step.members[0]], errors),
                "share": float(np.clip(1 - step.model.residuals.excess / excess, 0.0, 1.0)),
            }
        )
        for step in steps
        if step.members[0] in values
    ]


def common_note(effects: Sequence[CommonEffect]) -> str:
    """State which share of the excess chi-square the common effects explain without other effects."""
    if not effects:
        least = percent(THRESHOLDS.large)
        return f"Fit of the common effects alone: no fitted effect explains more than {least} of the excess."
    (first, share), *others = [(" or ".join(effect.members), percent(effect.share)) for effect in effects]
    added = "".join(f"; with {words} added, {larger}" for words, larger in others)
    return (
        f"Fit of the common effects alone: {first} explains {share} of the excess{added}. This fit does not confirm a"
        " cause."
    )


def _shown(kind: DetailedVerdict, state: Transferred) -> bool:
    """Return whether segments show a gap, but no cause with a tested form is claimed."""
    if kind in ("no_gap", "inconclusive") or state.description.withholds or gap_is_small(state.selection.bare):
        return False
    claimed = any(cause.probability >= VERDICT.rather and not cause.untested for cause in state.posteriors)
    return kind in ("unexplained", "too_short") or not claimed


def common_steps(
    fitted: Fitted, bare: Hypothesis, tested: Set[str], known: Mapping[frozenset[str], Hypothesis]
) -> Iterator[CommonSet]:
    """Yield sets of common effects, each with one effect more than the set before.

    The sequence ends if only noise remains, if no further effect explains enough, or if there are as many effects as
    segments.

    Args:
        fitted: recordings and segments
        bare: model without effects
        tested: names of the effects that the recordings may show
        known: fitted sets of the search, which are not fitted again
    """
    model = bare
    while not model.at_noise_floor and len(model.effects) < len(fitted.problem.segments):
        library = [EFFECTS[name] for name in sorted(tested - model.key) if EFFECTS[name].common]
        best = min(_larger(fitted, model, library, known), key=lambda step: step.model.fit.chi2, default=None)
        if best is None or best.model.bounded_excess >= most_excess(bare, model):
            return
        model = best.model
        yield best


def _larger(
    fitted: Fitted, model: Hypothesis, library: Sequence[Effect], known: Mapping[frozenset[str], Hypothesis]
) -> Iterator[CommonSet]:
    """Yield the possible sets with one more effect, one set for each class of indistinguishable effects.

    The sets with the best scores are fitted (`CommonFitRules.candidates`). Any other set is yielded only if it is in
    `known`.
    """
    problem = fitted.problem
    test = score_test(problem, model.fit, library, fitted.recordings.properties)
    scores, to_fit = list(test.ranking), COMMON_FIT.candidates
    while scores:
        alike = [score for score in scores if score is scores[0] or test.indistinguishable(scores[0], score)]
        alike.sort(key=lambda score: (not score.effect.stage.startswith("encoder"), score.effect.name))
        scores = [score for score in scores if score not in alike]
        members = tuple(score.effect.name for score in alike)
        larger = known.get(model.key | {members[0]})
        if larger is None and to_fit and alike[0].gain > 0:
            larger = refit_with(problem, model, test, alike[0], REFITS.without)
        to_fit = max(to_fit - 1, 0)
        if larger is not None and not (significantly_oversized(larger, problem.limits) or rises(problem, larger)):
            yield CommonSet(larger, members)
