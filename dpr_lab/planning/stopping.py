"""Stopping rule: whether the recordings decide the causes, and which question is still open.

A cause is decided under two conditions. First, one effect among the members of a class and its alternatives has a
probability of at least `SURE`. Second, data that were not fitted validate this effect. These data are another release,
or the quarters of a single release.

The quarters of a release, and the pieces of a long recording, share the pose and all other conditions. A single release
therefore decides at most one cause, and only under two further conditions. The first concerns the amplitudes a of the
cause, with covariance C: their joint significance sqrt(a^T C^-1 a) is at least `margin`, twice the value that counts as
detectable. (Amplitudes such as the stiffness and the cubic term of a spring are correlated, so each amplitude alone is
less significant.) The second condition is that every other effect is excluded as described below. If a small second
cause may be present, a second release is therefore recorded. Several causes, and the absence of a gap, are always
confirmed by a second release.

"No gap" means that the recordings exclude every recurring effect of the library at its minimum detectable size
(`Exclusion.is_excluded`). If the estimate of an effect is too large to exclude the effect and too small to name it, a
further release is needed. Effects that occur only once are not tested, because further releases do not show them again.
Causes that two releases decide remain decided even if other effects are not excluded. The plan and the report then list
these effects, and an optional release that tests them (`reservation`).
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.acceptance.judge import SURE
from dpr_lab.effects import EFFECTS
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.gap.result.causes import NamedEffect
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Exclusion
from dpr_lab.gap.screen.pieces import whole
from dpr_lab.shown import listed


@dataclass(frozen=True, slots=True)
class Stopping:
    """Settings of the stopping rule."""

    fewest: int = 2
    """Minimum number of releases for a decision on several causes, or on the absence of a gap."""
    margin: float = 10.0
    """Minimum significance of a cause that a single release decides, in standard deviations."""
    listed: int = 3
    """Maximum number of effects that a sentence lists."""


STOPPING = Stopping()


@dataclass(frozen=True, slots=True)
class Causes:
    """A named effect and its alternatives."""

    about: str
    """Name of the effect."""
    probabilities: Mapping[str, float]
    """Probability of each candidate cause, including the named effect itself."""
    outside: float
    """Probability of a cause outside the library."""


def causes_of(diagnosis: Diagnosis) -> Iterator[Causes]:
    """Yield the candidate causes of each named effect, with their probabilities.

    The candidates are the members of the class of the effect, and its alternatives. The remaining probability is that
    of a cause outside the library. With a single release, the probability of an effect may also be reduced by the test
    on the quarters of the release, or because the release does not test the form of the effect. A second release
    replaces both, so this reduction is not counted as a cause outside the library.
    """
    alone = recorded_releases(diagnosis) < STOPPING.fewest
    for effect in diagnosis.effects:
        alternatives = effect.candidates
        for rival in diagnosis.rivals:
            if rival.instead_of == effect.name and rival.name not in effect.members:
                alternatives[rival.name] = rival.probability
        missing = max(1.0 - sum(alternatives.values()), 0.0)
        outside = effect.outside if alone and effect.outside is not None else missing
        yield Causes(effect.name, alternatives, outside)


def decided(diagnosis: Diagnosis, inseparable: Collection[str] = ()) -> bool:
    """Return whether the recordings are sufficient.

    They are sufficient if there is no gap, or if each cause is decided and the gap is explained.
    """
    return not undecided(diagnosis, inseparable)


def undecided(diagnosis: Diagnosis, inseparable: Collection[str] = ()) -> str:
    """Return the open question as a clause; the text is empty if the recordings are sufficient.

    Args:
        diagnosis: diagnosis of the runs recorded so far
        inseparable: causes that no release separates; they count as one cause, and a bench check distinguishes them
    """
    untested = untested_forms(diagnosis)
    explained = diagnosis.only_uncertain and bool(inseparable or untested)  # but the cause is uncertain
    if diagnosis.hints:
        return "the description of the recordings is probably wrong"
    if diagnosis.verdict == "inconclusive":
        question = "determine the cause of the gap" if diagnosis.undecided else "show a gap"
        return f"the recordings cannot {question}"
    if not (explained or diagnosis.verdict in ("no_gap", "named")):
        return "part of the gap is unexplained"
    if untested:
        return f"a second release must test the form of {listed(untested)}"
    unsure = [causes.about for causes in causes_of(diagnosis) if _most_probable(causes, inseparable) < SURE]
    if unsure:
        return f"another effect could be the cause instead of {listed(unsure)}"
    no_gap = diagnosis.verdict == "no_gap"
    if recorded_releases(diagnosis) < STOPPING.fewest:
        if no_gap:
            return "a second release must confirm that there is no gap"
        if len(diagnosis.effects) != 1:
            return "a second release must confirm several causes"
        if significance(diagnosis, diagnosis.effects[0]) < STOPPING.margin:
            return f"a second release must confirm {diagnosis.effects[0].name}"
        if possible(diagnosis):
            return (
                f"a second release must test {_most_significant(diagnosis)}, which the first release does not exclude"
            )
    if no_gap and (names := possible(diagnosis)):
        return f"no gap is visible, but {listed(names)} may have the minimum detectable size"
    return ""


def untested_forms(diagnosis: Diagnosis) -> list[str]:
    """Return the names of the uncertain effects whose form a second release must test."""
    return [effect.name for effect in diagnosis.effects if effect.untested and effect.probability < SURE]


def reservation(diagnosis: Diagnosis) -> str:
    """Return a sentence on the effects that are not excluded although the causes are decided.

    The text is empty if all other effects are excluded, or if the causes are not decided.
    """
    if not decided(diagnosis) or not possible(diagnosis):
        return ""
    return f"Not excluded at the minimum detectable size: {_most_significant(diagnosis)}."


def by_prior(diagnosis: Diagnosis) -> str:
    """Return a sentence on the causes that only their prior probability excludes; empty if there are none."""
    classes = [effect for effect in diagnosis.effects if effect.only_by_prior]
    if not classes or not decided(diagnosis):
        return ""
    excluded = [name for effect in classes for name in effect.only_by_prior]
    them, causes = "it" if len(excluded) == 1 else "them", listed([effect.name for effect in classes])
    return (
        f"Only a small prior probability excludes {listed(excluded)}, because these recordings cannot distinguish"
        f" {them} from {causes}."
    )


def enough_sentence(diagnosis: Diagnosis, open_limits: Sequence[str], release: str) -> str:
    """Return the main sentence of a plan after recordings that decide the causes.

    Args:
        diagnosis: diagnosis of the runs recorded so far
        open_limits: quantities of the limits that the runs do not decide
        release: name of the release that tests the effects that are not excluded
    """
    causes = [effect.name for effect in diagnosis.effects]
    answer = f"the causes are decided ({listed(causes)})" if causes else "no gap of a detectable size"
    sentences = [f"Enough: {answer}.", by_prior(diagnosis)]
    if untested := reservation(diagnosis):
        sentences += [untested, f"Optional: record {release} to test this."]
    if open_limits:
        sentences.append(f"Not decided by these recordings: the limits of {listed(open_limits)}.")
    if not untested and not open_limits:
        sentences.append("Further releases only improve the accuracy of sizes and ratios.")
    return " ".join(filter(None, sentences))


def recorded_releases(diagnosis: Diagnosis) -> int:
    """Count the fitted and held-out releases; all pieces of one recording count once."""
    if diagnosis.evidence is None:  # a file of an older version
        return 1 if diagnosis.basis == "one release" else STOPPING.fewest
    return len({(whole(recording.name), recording.sha256) for recording in diagnosis.evidence.recordings})


def possible(diagnosis: Diagnosis) -> list[str]:
    """Return the recurring effects that are neither named nor excluded at the minimum detectable size."""
    return list(dict.fromkeys(amplitude.effect for amplitude in not_excluded(diagnosis)))


def _most_significant(diagnosis: Diagnosis) -> str:
    """Describe the effects that are not excluded, by decreasing estimate in standard deviations."""
    ranked = sorted(not_excluded(diagnosis), key=lambda tested: -abs(tested.estimate) / tested.size)
    names = list(dict.fromkeys(tested.effect for tested in ranked))
    unlisted = len(names) - STOPPING.listed + 1
    return listed(names if unlisted <= 1 else [*names[: STOPPING.listed - 1], f"{unlisted} others"])


def not_excluded(diagnosis: Diagnosis) -> list[Exclusion]:
    """Return the tests of recurring effects that do not exclude the minimum detectable size."""
    return [exclusion for exclusion in recurring(diagnosis) if not exclusion.is_excluded]


def recurring(diagnosis: Diagnosis) -> list[Exclusion]:
    """Return the tests of all amplitudes of effects that recur and are not named."""
    tested = diagnosis.evidence.exclusions if diagnosis.evidence else []
    return [exclusion for exclusion in tested if not EFFECTS[exclusion.effect].event]


def _most_probable(causes: Causes, inseparable: Collection[str]) -> float:
    """Return the largest probability of a candidate cause of one named effect.

    Inseparable causes count as one cause.
    """
    together = sum(p for name, p in causes.probabilities.items() if name in inseparable)
    return max(together, *causes.probabilities.values())


def significance(diagnosis: Diagnosis, effect: NamedEffect) -> float:
    """Return the joint significance of an effect's amplitudes, sqrt(a^T C^-1 a).

    Amplitudes at a bound have no variance and are left out. A file of an older version lacks the covariance C; the
    result is then the largest significance of a single amplitude.
    """
    amplitudes = {f"{effect.name}.{p.name}": p.name for p in EFFECTS[effect.name].amplitudes}
    for fitted in diagnosis.posterior[:1]:
        of_free = np.reshape(fitted.covariance, (len(fitted.free), len(fitted.free)))
        columns = [i for i, name in enumerate(fitted.free) if name in amplitudes and of_free[i, i] > 0.0]
        if columns:
            covariance = of_free[np.ix_(columns, columns)]
            std = np.sqrt(np.diag(covariance))
            values = [fitted.effects[effect.name][amplitudes[fitted.free[i]]] for i in columns]
            z, correlation = np.array(values) / std, covariance / np.outer(std, std)
            return float(np.sqrt(z @ np.linalg.lstsq(correlation, z, rcond=1e-9)[0]))
    sizes = [size for name, size in effect.parameters.items() if name in amplitudes.values()]
    intervals = [(size.value, *size.interval90) for size in sizes]
    ratios = [2 * NORMAL_Q90 * abs(value) / (high - low) for value, low, high in intervals if high > low]
    return max(ratios, default=0.0)
