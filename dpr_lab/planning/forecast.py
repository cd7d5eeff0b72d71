r"""Stopping rule: whether the causes are decided, and the probability that further releases decide them.

A cause is decided if one effect of a class and of its alternatives has a probability of at least `SURE`. If cause t is
true, further releases increase its log odds against each other cause j by a normally distributed amount of mean d^2 / 2
and variance d^2 (`dpr_lab.planning.worth.criteria`). The probability of a decision is the share of random draws, of the
true cause from its posterior and of this amount, in which one cause reaches `SURE`. A cause outside the library keeps
its probability.

A release may also reveal another alternative, which leaves the cause undecided until a further release. In campaigns a
share `holds` of certain decisions after one more release occurred; of n releases at least one then decides with the
probability 1 - (1 - holds)^n.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from dpr_lab.acceptance.judge import SURE
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.planning.worth.criteria import OpenPairs

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Stopping:
    """Settings of the stopping rule and of the forecast."""

    fewest: int = 2
    """Minimum number of releases for a decision: a single release is not validated by another one."""
    holds: float = 0.85
    """Share of certain decisions after one more release that occur, estimated from a small campaign of
    `trials campaign --plan`: 8 of 10 occurred. Its uncertainty is therefore about 0.1.
    """
    likely: float = 0.9
    """Probability of a decision from which this number of releases is recommended."""
    draws: int = 256
    """Number of random draws for each cause."""
    open: float = 0.05
    """Probability relative to the most probable cause from which another cause is undecided."""
    separable: float = 6.0
    """d^2 from which two causes count as separable: odds of 20 to 1 on average."""
    repeats: int = 5
    """Number of releases whose d^2 may be summed to reach this value."""


STOPPING = Stopping()


def decided(diagnosis: Diagnosis, runs: int) -> bool:
    """Whether the recordings are sufficient: there is no gap, or each cause is decided and the gap is explained."""
    if runs < STOPPING.fewest or diagnosis.hints:
        return False
    if diagnosis.verdict == "no_gap":
        return True
    return diagnosis.verdict == "named" and all(
        effect.probability * max(effect.odds.values(), default=1 / len(effect.members)) >= SURE
        for effect in diagnosis.effects
    )


def decision_probability(pairs: Sequence[OpenPairs], gained: Sequence[Array], releases: int = 1) -> float:
    """Probability that further releases decide every open cause.

    Args:
        pairs: causes of each named effect
        gained: (n, n) d^2 that the releases add, of each
        releases: number of these releases
    """
    probability = 1.0 - (1.0 - STOPPING.holds) ** releases
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
