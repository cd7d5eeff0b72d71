"""Verdict of a diagnosis; `dpr_lab.gap.conclusion.sentence` describes it in words."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from dpr_lab.gap.classes.posterior import EffectPosterior
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.result.causes import PROBABLE
from dpr_lab.gap.result.diagnosis import Verdict
from dpr_lab.gap.result.evidence import Budget
from dpr_lab.gap.state import Transferred
from dpr_lab.gap.transfer.outcome import Transfer


@dataclass(frozen=True, slots=True)
class VerdictRules:
    """Limits of the verdicts; they were set on blind trials whose library lacks the cause."""

    partly_share: float = 0.5
    """Minimum share of the excess chi-square that effects must explain; below it the verdict is "unexplained"."""
    sure: float = 0.6
    """Minimum probability of the most probable class of a set that is named."""
    rather: float = 0.5
    """Probability below which an effect is omitted from the sentence of the verdict.

    If no other effect is more probable, the sentence names the effect with its probability.
    """
    outside: float = 10.0
    """Maximum ratio of the probability of a cause outside the library to the probability of an effect.

    If the ratio is larger for every effect, the verdict is "unexplained".
    """
    closes: float = 0.5
    """Minimum share of the gap that a set must close on held-out recordings to be the cause.

    If the interval from the quarters of one release extends below the minimum, the sentence asks for a second release.
    """
    narrow: float = 0.02
    """Width of the interval of the closed share below which the sentence states the share with one decimal."""
    nearly_all: float = 0.999
    """Lower limit of the interval of the closed share above which the sentence states only this limit, and not "100
    %"."""
    gap_from: float = 0.5
    """Minimum ratio of a remainder to the noise for which the remainder is a gap that no effect explains."""
    held_out_gap: float = 1.0
    """Minimum size of a gap that only the held-out recordings show, relative to the noise."""
    visible: float = 0.5
    """Minimum share of the effects that must be detectable at their typical size for the verdict "no gap".

    Three releases of 4 s at 1 kHz reach 0.99; one release of 1 s at 30 Hz reaches 0.4.
    """
    candidates: int = 3
    """Maximum number of candidates in the sentence of an inconclusive verdict; the result contains all of them."""
    enough_s: float = 6.0
    """Duration of the releases that an inconclusive verdict recommends, s.

    Three such releases decide the causes of most simulated rigs (decision 74).
    """
    noise: float = 6.0
    """Maximum residual of a named set that counts as complete, in standard deviations."""


VERDICT = VerdictRules()


DetailedVerdict = Verdict | Literal["too_short"]
"""A verdict, or `too_short`: an inconclusive verdict with candidates, because the only release is too short."""


def verdict(state: Transferred, visible_counts: tuple[int, int], budget: Budget) -> DetailedVerdict:
    """Choose the verdict of a diagnosis.

    If there are several releases, the verdict depends on the reduction of the gap in held-out recordings.

    Args:
        state: the selected set, its probabilities and its performance on held-out recordings
        visible_counts: number of effects that are detectable at their typical size, and number of those detectable at
            any size
        budget: errors of the free runs, and their uncertainties
    """
    if state.description.withholds:
        return "unexplained"
    kind, (detectable, effects) = _verdict(state), visible_counts
    if kind == "no_gap" and budget.worst and budget.worst.shows_gap:
        return "unexplained"
    if kind == "partly_explained" and _too_short_to_decide(state):
        return "too_short"
    return "inconclusive" if kind == "no_gap" and detectable < VERDICT.visible * effects else kind


def _too_short_to_decide(state: Transferred) -> bool:
    """Return whether the only release is too short to decide between its causes.

    This is the case if the release is too short for the signed-rank test of the effects, and no effect reaches a
    probability of one half. A set that contains only effects of every rig of this kind counts as decided.
    """
    causes = listed_causes(state.posteriors)
    if not (state.transfer.too_short and causes) or set(state.selection.chosen.effects) <= state.selection.expected:
        return False
    return max(cause.probability for cause in causes) < VERDICT.rather


def _verdict(state: Transferred) -> Verdict:
    selection, posteriors, transferred = state.selection, state.posteriors, state.transfer
    chosen, share = selection.chosen, selection.share_explained
    if not chosen.effects:
        return "no_gap" if gap_is_small(chosen) and not only_held_out_gap(chosen, transferred) else "unexplained"
    complete = share >= THRESHOLDS.explained or chosen.at_noise_floor
    sure = max(posterior.probability for posterior in posteriors) >= VERDICT.sure
    if chosen.residuals.z < VERDICT.noise and complete and sure and _passes_all_tests(transferred):
        return "named"
    likely = any(cause.outside <= VERDICT.outside * cause.probability for cause in listed_causes(posteriors))
    if (complete or share >= VERDICT.partly_share) and likely and not fitted_only(posteriors, transferred):
        return "partly_explained"
    only_expected = set(chosen.effects) <= selection.expected
    return "no_gap" if gap_is_small(selection.bare) and only_expected else "unexplained"


def _passes_all_tests(transferred: Transfer) -> bool:
    """Return whether sizes, free runs and other recordings are all consistent with the effects.

    Other recordings without a gap do not contradict them.
    """
    if transferred.worse_free_run or transferred.oversized:
        return False
    tested = transferred.tested and transferred.basis != "one release"
    return not tested or (not transferred.withdrawn and shows_reduction(transferred))


def gap_is_small(model: Hypothesis) -> bool:
    """Return whether the remainder is noise, or too small to count as a gap."""
    return model.at_noise_floor or model.residuals.noise_ratio < VERDICT.gap_from


def only_held_out_gap(chosen: Hypothesis, transferred: Transfer) -> bool:
    """Return whether the held-out recordings show a gap, but not the fitted recordings."""
    on_held_out = transferred.basis == "held-out runs" and transferred.gap_ratio > VERDICT.held_out_gap
    return on_held_out and gap_is_small(chosen)


def shows_reduction(transferred: Transfer) -> bool:
    """Return whether held-out data show that the gap closes.

    If the gap is far below the noise, the noise in the excess limits the share. It is then sufficient that the interval
    of the share reaches the minimum. If the noise hides the whole gap, there is no share. The tests of the effects then
    decide alone.
    """
    closed = transferred.closed
    if transferred.gap_ratio == 0.0:
        return True
    far_below_noise = 0.0 < closed.value and transferred.gap_ratio < VERDICT.gap_from
    return (closed.interval90[1] if far_below_noise else closed.value) >= VERDICT.closes


def fitted_only(posteriors: Sequence[EffectPosterior], transferred: Transfer) -> bool:
    """Return whether the effects reduce the gap only on the fitted recordings."""
    if not transferred.tested:
        return False
    tested = transferred.basis != "one release"
    improbable = max(posterior.probability for posterior in posteriors) < VERDICT.rather
    no_reduction = transferred.closed.value <= 0 and not held_out_gap_invisible(transferred) and (tested or improbable)
    return no_reduction or (tested and len(transferred.withdrawn) == len(posteriors))


def held_out_gap_invisible(transferred: Transfer) -> bool:
    """Return whether held-out data show no gap, so that they neither confirm nor refute the effects."""
    return transferred.closed.value <= 0 and transferred.closed.interval90[1] >= VERDICT.closes


def listed_causes(posteriors: Sequence[EffectPosterior]) -> tuple[EffectPosterior, ...]:
    """Return the effects whose probability is at least `PROBABLE`."""
    return tuple(posterior for posterior in posteriors if posterior.probability >= PROBABLE)


def causes_named(state: Transferred) -> Sequence[EffectPosterior]:
    """Return the causes that the verdict sentence names.

    These effects carry over to held-out data and are not merely expected. Less probable effects are named only if no
    other effect is named. The table of the causes also lists these effects and the small effects.
    """
    carrying = [cause for cause in state.posteriors if cause.name not in state.transfer.withdrawn]
    unexpected = [cause for cause in carrying if cause.name not in state.selection.expected]
    likely = [cause for cause in carrying if cause.probability >= VERDICT.rather]
    little = small_effects(state.selection.bare, state.selection.path)
    large = [cause for cause in likely if cause.name not in little]
    return large or likely or listed_causes(unexpected) or listed_causes(carrying) or carrying


def small_effects(bare: Hypothesis, path: Sequence[tuple[str, Hypothesis]]) -> frozenset[str]:
    """Return the small effects of a set.

    The small effects together explain less than `THRESHOLDS.small` of the gap in addition to the larger effects.

    Args:
        bare: the bare model
        path: names of the effects, largest first, each with the set of this effect and all larger effects
    """
    before = [bare, *(model for _, model in path)]
    least = THRESHOLDS.small * bare.bounded_excess + before[-1].bounded_excess
    return frozenset(name for (name, _), smaller in zip(path, before, strict=False) if smaller.bounded_excess < least)
