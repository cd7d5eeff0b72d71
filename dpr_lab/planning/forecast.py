r"""Stopping rule: whether the causes are decided, and the probability that further releases decide them.

A cause is decided if one effect of a class and of its alternatives has a probability of at least `SURE`, and if it is
validated by data that were not fitted: by another release, or by the quarters of a single release. The quarters share
the pose and all other conditions of the release. A single release therefore decides one cause only, with a margin: one
of its amplitudes has at least `margin` standard deviations, twice the size that counts as detectable. Several causes,
and the absence of a gap, are confirmed by a second release.

"No gap" is a statement about sizes: no effect of the library has its minimum detectable size in these recordings, 5 s
with s the standard deviation of an amplitude. It is decided by an equivalence test of each amplitude at the level
1 - `SURE`: the estimate a satisfies Phi(5 - |a| / s) >= `SURE`, that is |a| < 3.4 s. A larger estimate is too small to
be named and too large to be excluded, and the next release decides. The estimate of an effect of unknown shape is the
largest of some hundred frequencies or orders, and exceeds 3.4 s by chance on one rig in four. Its limit is 4 s,
which excludes 5.6 s instead of 5 s with the same confidence. Effects that occur only once are not tested, because no
further release shows them again.

If cause t is true, further releases increase its log odds against each other cause j by a normally distributed amount
of mean d^2 / 2 and variance d^2 (`dpr_lab.planning.worth.criteria`). The probability of a decision is the share of
random draws, of the true cause from its posterior and of this amount, in which one cause reaches `SURE`. A cause
outside the library keeps its probability.

A release may also reveal another effect or another alternative, which leaves the causes undecided until a further
release. `confirmed` is the share of planned releases in blind trials that decided causes which were sure by this
probability. It did not depend on the kind of the diagnosis: one cause 14 of 16, several causes 7 of 8, no gap 13 of 14,
a remainder 4 of 5. Releases from a fixed menu decide less often (24 of 40, all planned ones 26 of 36, sure or not), so
they are not counted. With n of N such releases the share is (n + 1/2) / (N + 1), the mean of the
posterior from the prior of Jeffreys. Each further release has the same share, so k releases decide with the probability

    1 - (1 - confirmed)^k.

Source: H. Jeffreys (1946), An invariant form for the prior probability in estimation problems, Proceedings of the Royal
Society A 186, 453-461.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from dpr_lab.acceptance.judge import SURE
from dpr_lab.arrays import Array
from dpr_lab.effects import EFFECTS
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.gap.hypothesis.detectable import SIGMAS
from dpr_lab.gap.result.causes import NamedEffect
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import Exclusion
from dpr_lab.planning.knowledge import Causes, causes_of
from dpr_lab.planning.worth.criteria import OpenPairs


@dataclass(frozen=True, slots=True)
class Stopping:
    """Settings of the stopping rule and of the forecast."""

    fewest: int = 2
    """Minimum number of releases for several causes, or for the decision that there is no gap."""
    margin: float = 10.0
    """Minimum amplitude of a cause that a single release decides, in standard deviations."""
    of_shapes: float = 4.0
    """Standard deviations that the largest estimate of an effect of unknown shape exceeds by chance in 2 % of cases."""
    confirmed: float = 0.875
    """Share of planned releases that decided sure causes in blind trials: 38 of 43."""
    likely: float = 0.8
    """Probability of a decision from which this number of releases is recommended."""
    draws: int = 256
    """Number of random draws for each cause."""
    separable: float = 6.0
    """d^2 from which two causes count as separable: odds of 20 to 1 on average."""
    repeats: int = 6
    """Number of further releases whose d^2 may be summed to reach this value."""


STOPPING = Stopping()


def decided(diagnosis: Diagnosis, runs: int, inseparable: Collection[str] = ()) -> bool:
    """Whether the recordings are sufficient: there is no gap, or each cause is decided and the gap is explained.

    Args:
        diagnosis: of the runs recorded so far
        runs: their number
        inseparable: causes that no release separates; they count as one, which a bench check divides
    """
    uncertain = bool(inseparable) and diagnosis.only_uncertain  # the gap is explained, but not by which of them
    if diagnosis.hints or not (uncertain or diagnosis.verdict in ("no_gap", "named")):
        return False
    if not all(_most_probable(causes, inseparable) >= SURE for causes in causes_of(diagnosis)):
        return False
    if diagnosis.verdict == "no_gap" and possible(diagnosis):
        return False
    confirmed = runs >= STOPPING.fewest or diagnosis.basis == "held-out runs"
    return confirmed or (len(diagnosis.effects) == 1 and _is_large(diagnosis.effects[0]))


def possible(diagnosis: Diagnosis) -> list[str]:
    """Effects that were not named and are not excluded: one amplitude may have its minimum detectable size."""
    tested = diagnosis.evidence.exclusions if diagnosis.evidence else []
    return list(dict.fromkeys(exclusion.effect for exclusion in tested if not _is_excluded(exclusion)))


def _is_excluded(tested: Exclusion) -> bool:
    effect = EFFECTS[tested.effect]
    if effect.shapes and not effect.event:
        return SIGMAS * abs(tested.estimate) < STOPPING.of_shapes * tested.size
    return effect.event or tested.confidence >= SURE


def _most_probable(causes: Causes, inseparable: Collection[str]) -> float:
    """Probability of the most probable candidate of one named effect, or of the inseparable ones together."""
    together = sum(p for name, p in causes.probabilities.items() if name in inseparable)
    return max(together, *causes.probabilities.values())


def _is_large(effect: NamedEffect) -> bool:
    """Whether an amplitude of a named effect is large enough for a decision from a single release."""
    sizes = [effect.parameters[p.name] for p in EFFECTS[effect.name].amplitudes if p.name in effect.parameters]
    stds = [(size.interval90[1] - size.interval90[0]) / (2 * NORMAL_Q90) for size in sizes]
    return any(abs(size.value) >= STOPPING.margin * std for size, std in zip(sizes, stds, strict=True))


def decision_probability(pairs: Sequence[OpenPairs], gained: Sequence[Array], releases: int = 1) -> float:
    """Probability that further releases decide every open cause.

    Args:
        pairs: causes of each named effect
        gained: (n, n) d^2 that the releases add, of each
        releases: number of these releases
    """
    probability = 1.0 - (1.0 - STOPPING.confirmed) ** releases
    for pair, d2 in zip(pairs, gained, strict=True):
        probability *= _decided(pair.probabilities, d2)
    return float(probability)


def _decided(p: Array, d2: Array) -> float:
    """Random draws in which the cause of one named effect is decided."""
    outside = max(1.0 - float(p.sum()), 0.0)
    normal = stats.norm.ppf(stats.qmc.Sobol(len(p), rng=np.random.default_rng(0)).random(STOPPING.draws) % 1.0)
    normal = np.clip(normal, -6.0, 6.0)
    total = 0.0
    for truth in range(len(p)):
        loss = 0.5 * d2[truth] + np.sqrt(d2[truth]) * normal
        loss[:, truth] = 0.0
        weight = p * np.exp(-np.clip(loss, -500, 500))
        best = weight.max(axis=1) * (1 - outside) / weight.sum(axis=1)
        total += p[truth] * float(np.mean(best >= SURE))
    return total / max(float(p.sum()), 1e-12)
