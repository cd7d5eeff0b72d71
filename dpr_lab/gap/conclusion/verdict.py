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
    """Share of the excess chi-square below which the verdict is "unexplained"."""
    sure: float = 0.6
    """Minimum probability of the most probable class of a set that is named."""
    rather: float = 0.5
    """Minimum probability of an effect in the sentence; the most probable effect is always stated."""
    outside: float = 10.0
    """Maximum ratio of the probability of an outside cause to that of an effect. Beyond it for all effects, none is
    named."""
    closes: float = 0.5
    """Minimum share of the gap that a cause closes on held-out recordings.

    If the interval from the quarters of one release extends below it, the sentence asks for a second release.
    """
    narrow: float = 0.02
    """Maximum width of the interval of the closed share for which the sentence states the share with one decimal."""
    nearly_all: float = 0.999
    """Lower limit of the interval above which the sentence states this limit, and not "100 %"."""
    gap_from: float = 0.5
    """Minimum ratio of the residual to the noise that counts as a gap, if no effect explains it."""
    held_out_gap: float = 1.0
    """Minimum ratio of the residual to the noise that counts as a gap, if only held-out recordings show it."""
    visible: float = 0.5
    """Minimum share of the effects that are detectable at their typical size for the verdict "no gap".

    Three releases of 4 s at 1 kHz reach 0.99; one release of 1 s at 30 Hz reaches 0.4.
    """
    candidates: int = 3
    """Maximum number of candidates in the sentence of an inconclusive verdict."""
    enough_s: float = 6.0
    """Duration of a recommended release, s. Three such releases decide the causes of most simulated rigs (decision
    74)."""
    noise: float = 6.0
    """Maximum residual of a named set, in standard deviations."""


VERDICT = VerdictRules()


DetailedVerdict = Verdict | Literal["too_short"]
"""A verdict, or `too_short`: an inconclusive verdict with candidates, because the only release is too short."""


def verdict(state: Transferred, visible_counts: tuple[int, int], budget: Budget) -> DetailedVerdict:
    """Choose the verdict of a diagnosis.

    Args:
        state: the selected set, its probabilities and its performance on held-out recordings
        visible_counts: numbers of effects that are detectable at their typical size, and at any size
        budget: errors of the free runs, and their uncertainties
    """
    if state.description.withholds:
        return "unexplained"
    kind, (detectable, effects) = _by_tests(state), visible_counts
    if kind == "no_gap" and budget.worst and budget.worst.shows_gap:
        return "unexplained"
    if kind == "partly_explained" and _too_short_to_decide(state):
        return "too_short"
    return "inconclusive" if kind == "no_gap" and detectable < VERDICT.visible * effects else kind


def _too_short_to_decide(state: Transferred) -> bool:
    """Return whether the only release is too short to test its causes, and none of them is probable.

    The result is False for a set that contains only effects that every rig of this kind has.
    """
    causes = listed_causes(state.posteriors)
    if not (state.transfer.too_short and causes) or set(state.selection.chosen.effects) <= state.selection.expected:
        return False
    return max(cause.probability for cause in causes) < VERDICT.rather


def _by_tests(state: Transferred) -> Verdict:
    """Return the verdict that follows from the sizes, the probabilities and the held-out recordings."""
    selection, posteriors, transfer = state.selection, state.posteriors, state.transfer
    chosen, share = selection.chosen, selection.share_explained
    if not chosen.effects:
        return "no_gap" if gap_is_small(chosen) and not only_held_out_gap(chosen, transfer) else "unexplained"
    complete = share >= THRESHOLDS.explained or chosen.at_noise_floor
    sure = max(posterior.probability for posterior in posteriors) >= VERDICT.sure
    if chosen.residuals.z < VERDICT.noise and complete and sure and _passes_all_tests(transfer):
        return "named"
    likely = any(cause.outside <= VERDICT.outside * cause.probability for cause in listed_causes(posteriors))
    if (complete or share >= VERDICT.partly_share) and likely and not fitted_only(posteriors, transfer):
        return "partly_explained"
    only_expected = set(chosen.effects) <= selection.expected
    return "no_gap" if gap_is_small(selection.bare) and only_expected else "unexplained"


def _passes_all_tests(transfer: Transfer) -> bool:
    """Return whether sizes, free runs and held-out recordings confirm the effects, as far as they are tested."""
    if transfer.worse_free_run or transfer.oversized:
        return False
    tested = transfer.tested and transfer.basis != "one release"
    return not tested or (not transfer.withdrawn and shows_reduction(transfer))


def gap_is_small(model: Hypothesis) -> bool:
    """Return whether the remainder is noise, or too small to count as a gap."""
    return model.at_noise_floor or model.residuals.noise_ratio < VERDICT.gap_from


def only_held_out_gap(chosen: Hypothesis, transfer: Transfer) -> bool:
    """Return whether only the held-out recordings, and not the fitted ones, show a gap."""
    on_held_out = transfer.basis == "held-out runs" and transfer.gap_ratio > VERDICT.held_out_gap
    return on_held_out and gap_is_small(chosen)


def shows_reduction(transfer: Transfer) -> bool:
    """Return whether held-out data show that the gap closes.

    If the gap is far below the noise, the upper end of the interval of the closed share must reach the minimum, not the
    share itself. If the noise hides the whole gap, the result is True.
    """
    closed = transfer.closed
    if transfer.gap_ratio == 0.0:
        return True
    far_below_noise = 0.0 < closed.value and transfer.gap_ratio < VERDICT.gap_from
    return (closed.interval90[1] if far_below_noise else closed.value) >= VERDICT.closes


def fitted_only(posteriors: Sequence[EffectPosterior], transfer: Transfer) -> bool:
    """Return whether the effects reduce the gap only on the fitted recordings."""
    if not transfer.tested:
        return False
    tested = transfer.basis != "one release"
    improbable = max(posterior.probability for posterior in posteriors) < VERDICT.rather
    no_reduction = transfer.closed.value <= 0 and not held_out_gap_invisible(transfer) and (tested or improbable)
    return no_reduction or (tested and len(transfer.withdrawn) == len(posteriors))


def held_out_gap_invisible(transfer: Transfer) -> bool:
    """Return whether the held-out data are too noisy to confirm or refute a reduction of the gap."""
    return transfer.closed.value <= 0 and transfer.closed.interval90[1] >= VERDICT.closes


def listed_causes(posteriors: Sequence[EffectPosterior]) -> tuple[EffectPosterior, ...]:
    """Return the effects whose probability is at least `PROBABLE`."""
    return tuple(posterior for posterior in posteriors if posterior.probability >= PROBABLE)


def causes_named(state: Transferred) -> Sequence[EffectPosterior]:
    """Return the causes that the verdict names, without those that do not carry over to held-out data.

    Small, expected and less probable effects are named only if there are no others.
    """
    carrying = [cause for cause in state.posteriors if cause.name not in state.transfer.withdrawn]
    unexpected = [cause for cause in carrying if cause.name not in state.selection.expected]
    likely = [cause for cause in carrying if cause.probability >= VERDICT.rather]
    little = small_effects(state.selection.bare, state.selection.path)
    large = [cause for cause in likely if cause.name not in little]
    return large or likely or listed_causes(unexpected) or listed_causes(carrying) or carrying


def small_causes(state: Transferred) -> list[EffectPosterior]:
    """Return the other probable causes that carry over to held-out data, which are small."""
    named, little = causes_named(state), small_effects(state.selection.bare, state.selection.path)
    return [
        cause
        for cause in state.posteriors
        if cause not in named and cause.name in little and cause.name not in state.transfer.withdrawn
        if cause.probability >= VERDICT.rather
    ]


def small_effects(bare: Hypothesis, path: Sequence[tuple[str, Hypothesis]]) -> frozenset[str]:
    """Return the smallest effects that together explain less than the share `THRESHOLDS.small` of the excess.

    Args:
        bare: the bare model
        path: names of the effects, largest first, each with the set of this effect and all larger effects
    """
    before = [bare, *(model for _, model in path)]
    least = THRESHOLDS.small * bare.bounded_excess + before[-1].bounded_excess
    return frozenset(name for (name, _), smaller in zip(path, before, strict=False) if smaller.bounded_excess < least)
