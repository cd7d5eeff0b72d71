r"""When to stop: whether the causes are decided, and how probable it is that some more releases decide them.

A cause is decided if one effect of a class and of its alternatives has a probability of `SURE`. If cause t is the right
one, further releases raise its log odds against each other cause j by a normal amount of mean d^2 / 2 and variance d^2
(`dpr_lab.planning.worth.criteria`). The probability of a decision is the share of draws, over the posterior of the
causes and over that amount, in which one cause reaches `SURE`. A cause outside the library keeps its probability. What
is found may still change with a further release: `holds` is the share of such forecasts that came true in campaigns.
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
    """When recordings are enough, and what a forecast assumes."""

    fewest: int = 2
    """Releases without which nothing is decided: with one alone nothing was tested on another."""
    holds: float = 1.0
    """Share of forecast decisions that come true, by `trials campaign --plan`."""
    likely: float = 0.9
    """Probability of a decision from which so many releases are recommended."""
    draws: int = 256
    """Draws for each cause."""
    open: float = 0.05
    """Probability relative to the likeliest cause from which another one is open."""
    separable: float = 6.0
    """d^2 from which two causes count as separable: odds of 20 to 1 on average."""
    repeats: int = 5
    """Releases that may add up to that."""


STOPPING = Stopping()


def decided(diagnosis: Diagnosis, runs: int) -> bool:
    """Whether the recordings are enough: no gap, or each cause named surely enough and the gap explained."""
    if runs < STOPPING.fewest or diagnosis.hints:
        return False
    if diagnosis.verdict == "no_gap":
        return True
    return diagnosis.verdict == "named" and all(
        effect.probability * max(effect.odds.values(), default=1 / len(effect.members)) >= SURE
        for effect in diagnosis.effects
    )


def decision_probability(pairs: Sequence[OpenPairs], gained: Sequence[Array]) -> float:
    """Probability that further releases decide every open cause.

    Args:
        pairs: causes of each named effect
        gained: (n, n) d^2 that the releases add, of each
    """
    probability = STOPPING.holds
    for one, d2 in zip(pairs, gained, strict=True):
        probability *= _decided(one.probabilities, d2)
    return float(probability)


def _decided(p: Array, d2: Array) -> float:
    """Of the causes of one named effect."""
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
