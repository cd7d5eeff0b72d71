"""Verdict in short sentences: causes and their alternatives, reduction of the gap on held-out data, and remainder."""

from collections.abc import Sequence

import numpy as np

from dpr_lab.gap.classes.posterior import EffectPosterior
from dpr_lab.gap.conclusion.ratios import most_deviating
from dpr_lab.gap.conclusion.verdict import (
    VERDICT,
    DetailedVerdict,
    causes_named,
    fitted_only,
    gap_is_small,
    held_out_gap_invisible,
    listed_causes,
    only_held_out_gap,
    small_causes,
)
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.gap.result.causes import PROBABLE, nameable
from dpr_lab.gap.result.diagnosis import ONLY_FREE_RUN, UNCERTAIN
from dpr_lab.gap.result.evidence import FREE_RUN_TEST, Budget
from dpr_lab.gap.screen.pieces import are_pieces
from dpr_lab.gap.state import Transferred
from dpr_lab.gap.transfer.outcome import Transfer
from dpr_lab.shown import percent


def sentence(kind: DetailedVerdict, state: Transferred, visible_counts: tuple[int, int], budget: Budget) -> str:
    """Return the verdict in sentences; see `verdict` for the arguments."""
    hint = state.description.hint
    if kind == "inconclusive":
        return _inconclusive(visible_counts)
    if state.description.withholds:
        return f"Unexplained: a gap of {_in_noise(state.selection.bare.residuals.noise_ratio)}. {hint}"
    return f"{_sentence(kind, state, budget)} {hint}".rstrip()


def _inconclusive(visible_counts: tuple[int, int]) -> str:
    detectable, effects = visible_counts
    return (
        f"Inconclusive: these recordings cannot show a gap. Of {effects} effects, only {detectable} are detectable"
        " at their typical size. Record more or longer releases, with larger swings, at a higher sampling rate or with"
        " less noise."
    )


def _too_short(state: Transferred) -> str:
    """Return the verdict of a release that is too short, with the most probable causes and the next recordings."""
    t, causes = state.fitted.problem.t, listed_causes(state.posteriors)
    probable = {_class(cause): cause.probability for cause in causes}
    listed_names = {name for cause in causes for name in (cause.name, *cause.members)}
    for other in (other for cause in causes for other in cause.alternatives if other.name not in listed_names):
        if other.probability >= PROBABLE:
            probable[other.name] = max(probable.get(other.name, 0.0), other.probability)
    leading = sorted(probable.items(), key=lambda candidate: -candidate[1])[: VERDICT.candidates]
    untested = _untested([cause for cause in causes if _class(cause) in dict(leading)])
    candidates = _series([f"{words} ({percent(probability)})" for words, probability in leading])
    are = "candidates are" if len(leading) > 1 else "candidate is"
    return (
        f"Inconclusive: this release of {np.ptp(t):.2g} s is too short to determine the cause of the gap. The most"
        f" probable {are} {candidates}.{untested} Record three releases from different angles, each for at least"
        f" {VERDICT.enough_s:g} s or until the rods are at rest."
    )


def _sentence(kind: DetailedVerdict, state: Transferred, budget: Budget) -> str:
    if kind == "too_short":
        return _too_short(state)
    if kind == "no_gap":
        return f"{_no_gap(state.selection.bare)} {_free_run(budget)}"
    if kind == "unexplained":
        return _unexplained(state, budget)
    causes, reduction = causes_named(state), reduction_sentence(state.transfer)
    if kind == "named":
        explained = f"The gap is explained by {_certain(causes)}."
        return f"{explained}{_qualified(state, causes)} {reduction} Nothing above the noise floor remains."
    causes = listed_causes(causes) or listed_causes(state.posteriors)
    remains = _remainder(state.selection.chosen, state.transfer)
    explained = f"The gap is partly explained by {_classes(causes, VERDICT.rather)}."
    return f"{explained}{_qualified(state, causes)} {reduction} {remains}"


def _certain(causes: Sequence[EffectPosterior]) -> str:
    """List the named causes with their lowest probability, or with the probability of each if a form is untested."""
    if any(cause.untested for cause in causes):
        return _classes(causes, np.inf)
    least = percent(min(cause.probability for cause in causes))
    if len(causes) == 1:
        return f"{_classes(causes)} (probability {least})"
    of_class = "class " * any(len(_members(cause)) > 1 for cause in causes)
    return f"{_classes(causes)} ({of_class}probability at least {least})"


def _qualified(state: Transferred, causes: Sequence[EffectPosterior]) -> str:
    """Return sentences on indistinguishable effects, on probabilities that a test limits, and on small causes."""
    small, sentences = small_causes(state), _indistinguishable(causes) + _untested(causes)
    if small:
        explain = "explains" if len(small) == 1 else "together explain"
        share = f"{explain} less than {percent(THRESHOLDS.small)} of the gap"
        sentences += f" {_classes(small, VERDICT.sure)} {share}.{_indistinguishable(small)}{_untested(small)}"
    return sentences


def _unexplained(state: Transferred, budget: Budget) -> str:
    """Return the verdict "unexplained", with the reason why no effect is named as a cause."""
    selection, posteriors, transfer = state.selection, state.posteriors, state.transfer
    share, remainder = selection.share_explained, _in_noise(selection.chosen.residuals.noise_ratio)
    if not posteriors and only_held_out_gap(selection.chosen, transfer):
        return (
            "Unexplained: the fitted recordings show no gap, but the held-out recordings show a gap of"
            f" {_in_noise(transfer.gap_ratio)}. Fit the held-out recordings too, or check whether the rig was changed."
        )
    if set(selection.chosen.effects) <= selection.expected and gap_is_small(selection.bare):
        return (
            f"Unexplained: segments of {state.fitted.recordings.working_length:.2g} s {ONLY_FREE_RUN}."
            f" {_free_run(budget)} A fitted ratio may absorb the cause in segments{most_deviating(state)}."
        )
    if not posteriors and transfer.too_short:
        return (
            f"Unexplained: a gap of {remainder}. This release of {np.ptp(state.fitted.problem.t):.2g} s is too short to"
            " exclude the effects of the library."
        )
    if not posteriors:
        where = " in this release" if transfer.basis == "one release" else ""
        return f"Unexplained: a gap of {remainder}, and no effect of the library fits it{where}."
    closest, several = _classes(posteriors), len(posteriors) > 1
    verb = "explain" if several else "explains"
    if share >= VERDICT.partly_share:
        one_release = transfer.basis == "one release"
        doubt = "not in the quarters that were not fitted" if one_release else "not in other recordings"
        if not fitted_only(posteriors, transfer):
            doubt = f"a remainder of {remainder} makes a cause outside the library more probable"
        return (
            f"Unexplained: {closest} {verb} {percent(share)} of the excess chi-square in the fitted"
            f" recordings, but {doubt}.{_indistinguishable(posteriors)} {reduction_sentence(transfer)}"
        )
    candidate = "candidates" if several else "candidate"
    explained = f"{verb} only {percent(share)} of the excess chi-square"
    return f"Unexplained: the closest {candidate}, {closest}, {explained}.{_indistinguishable(posteriors)}"


def _in_noise(ratio: float) -> str:
    """Return a ratio to the noise as text, for example `110 times the noise`."""
    rounded = _rounded(ratio)
    return "the size of the noise" if rounded == "1" else f"{rounded} times the noise"


def _rounded(value: float) -> str:
    """Return a number with two significant digits, without an exponent up to 10^6."""
    return f"{float(f'{value:.2g}'):g}"


def _remainder(chosen: Hypothesis, transfer: Transfer) -> str:
    """Describe an increased error of the free run or, if there is none, the remainder."""
    if transfer.worse_free_run:
        errors = transfer.worse_free_run
        before, after = 1e3 * errors.before_rad, 1e3 * errors.after_rad
        compared = "held-out runs" if transfer.held_out else "recordings"
        return (
            f"But the error of the free run of the {compared} increases from {before:.3g} to {after:.3g} mrad rms in"
            f" the first {errors.until_s:.2g} s."
        )
    if chosen.at_noise_floor:
        return UNCERTAIN
    remainder = f"A remainder of {_in_noise(chosen.residuals.noise_ratio)}"
    if chosen.residuals.noise_ratio < 1.0:
        return (
            f"{remainder} is significant, but smaller than the noise: a further small cause may act, or the functional"
            " form of a named effect may differ slightly from that of the library."
        )
    return f"{remainder} stays unexplained: a further cause acts, or a named effect has another form."


def _no_gap(bare: Hypothesis) -> str:
    if bare.at_noise_floor:
        return "No gap visible at this noise. The bare model explains the recordings down to the noise floor."
    return (
        "No gap above the noise. No effect of the library explains the remainder of"
        f" {_in_noise(bare.residuals.noise_ratio)}."
    )


def _free_run(budget: Budget) -> str:
    """State the free run with the largest ratio of error to uncertainty, and whether it shows a gap."""
    if (run := budget.worst) is None:
        return "No free run is long and predictable enough for a test."
    error, uncertainty = (_rounded(1e3 * value) for value in (run.error_before_rad, run.u_before_rad))
    side = "above" if run.shows_gap else "below"
    return (
        f"The free run of {run.run} has an error of {error} mrad rms in the first {run.until_s:.2g} s, {side} the limit"
        f" of {FREE_RUN_TEST.coverage:g} times its uncertainty ({uncertainty} mrad from parameters, initial"
        " state, inputs and noise)."
    )


def reduction_sentence(transfer: Transfer) -> str:
    """State by how much the gap closes on held-out data, and which data these are."""
    if not transfer.tested:
        return "The recordings are too short to predict one part from another, so this result is not validated."
    estimate, (low, high) = transfer.closed.value, transfer.closed.interval90
    if held_out_gap_invisible(transfer):
        return f"{_tested_on(transfer)} the gap is too small to show a reduction."
    if low > VERDICT.nearly_all:
        limit = percent(VERDICT.nearly_all, 1)
        return f"{_tested_on(transfer)} the gap closes by more than {limit} (90 % interval above {limit})."
    digits = int(high - low < VERDICT.narrow)
    interval = f"90 % interval {percent(low, digits)} to {percent(high, digits)}"
    if estimate > 0 and low < VERDICT.closes and transfer.basis == "one release":
        return (
            f"The quarters of the only release do not show how far the gap closes ({percent(estimate)}, {interval}):"
            " record a second release."
        )
    if estimate > 0:
        return f"{_tested_on(transfer)} the gap closes by {percent(estimate, digits)} ({interval})."
    return f"{_tested_on(transfer)} the gap does not close ({percent(estimate)}, {interval})."


def _tested_on(transfer: Transfer) -> str:
    pieces = transfer.basis == "held-out runs" and are_pieces(transfer.held_out)
    return "On held-out pieces of the recording" if pieces else _BASIS[transfer.basis]


_BASIS = {
    "held-out runs": "On held-out runs",
    "releases left out": "In cross-validation across the releases",
    "one release": "In cross-validation across the quarters of the only release",
}
"""Beginning of the sentence on the reduction of the gap, by kind of held-out data."""


def _classes(causes: Sequence[EffectPosterior], below: float = -np.inf) -> str:
    """List the classes in words.

    The probability of a class is stated if it is less than `below`, or if it is limited by an untested form. Of several
    classes, only the first members are listed; `_indistinguishable` states the other members.
    """
    if len(causes) == 1:
        return _class(causes[0]) + _probability(causes[0], below)
    nouns = ["class probability" if len(_members(cause)) > 1 else "probability" for cause in causes]
    return _series([cause.name + _probability(cause, below, noun) for cause, noun in zip(causes, nouns, strict=True)])


def _indistinguishable(causes: Sequence[EffectPosterior]) -> str:
    """Return a sentence on the members of several classes that `_classes` omits."""
    if len(causes) == 1:
        return ""
    others = [
        f"{cause.name} from {members[1] if len(members) == 2 else f'{len(members) - 1} other effects'}"
        for cause in causes
        if len(members := _members(cause)) > 1
    ]
    return f" These recordings do not distinguish {'; or '.join(others)}." if others else ""


def _untested(causes: Sequence[EffectPosterior]) -> str:
    """Return a sentence on the causes whose probability is limited because one release does not test their form."""
    if not (names := [cause.name for cause in causes if cause.untested]):
        return ""
    its = "its probability" if len(names) == 1 else "their probabilities"
    return f" A single release tests the functional form of {_series(names)} only weakly, which limits {its}."


def _series(items: Sequence[str]) -> str:
    """Join three or more effects with semicolons, because a name such as `Coulomb friction, joint 1` has a comma."""
    return " and ".join(items) if len(items) < 3 else f"{'; '.join(items[:-1])}; and {items[-1]}"


def _members(posterior: EffectPosterior) -> list[str]:
    """Return the members of a class without those of negligible probability."""
    return nameable(posterior.members, dict(zip(posterior.members, posterior.odds, strict=False)))


def _class(posterior: EffectPosterior) -> str:
    """Return the members of a class in words; of three or more members, only the first is named."""
    members = _members(posterior)
    if len(members) > 2:
        return f"{posterior.name} or one of {len(members) - 1} effects indistinguishable from it"
    return " or ".join(members)


def _probability(cause: EffectPosterior, below: float, noun: str = "probability") -> str:
    only = "" if cause.probability >= VERDICT.rather else "only "
    return f" ({noun} {only}{percent(cause.probability)})" if cause.probability < below or cause.untested else ""
