"""Forecast the probability that further releases decide the causes by the rule of `dpr_lab.planning.stopping`.

If cause t is true, further releases increase its log odds against each other cause j by a normally distributed amount
of mean d^2 / 2 and variance d^2 (`dpr_lab.planning.worth.criteria`). The true cause is drawn from its posterior, and
the amount is drawn from this distribution. The probability of a decision is the share of draws in which one cause
reaches `SURE`. If the cause is outside the library, no release decides it. Causes that no release separates count as
one cause, as in the stopping rule, because a bench check distinguishes them.

A release may also reveal another effect or another alternative. The causes then stay undecided until a further release.
The setting `confirmed` takes this into account. It is a fraction that was measured in blind trials. The trials contain
planned releases for which the above probability predicted a decision. The fraction states how many of these releases
decided the causes. It did not depend on the kind of the diagnosis: it was 14 of 16 for one cause, 7 of 8 for several
causes, 13 of 14 for no gap, and 4 of 5 for a remainder. Releases from a fixed menu are not counted, because they decide
less often: 24 of 40 menu releases decided the causes, and 26 of all 36 planned releases. If n of N releases decided the
causes, `confirmed` is (n + 1/2) / (N + 1), the posterior mean for the Jeffreys prior.

If the selected effects leave a remainder above the noise, its cause is not known, although the search tested every
effect of the library. A further release then decides only if it reveals this cause. `revealed` replaces `confirmed`
in this case, and was estimated in the same way.

For an individual plant, the probability of a decision differs from this mean, because the causes may stay undecided for
reasons that a forecast cannot take into account. The prior of this probability is a beta distribution with the above
mean and a weight of `weight` releases. After `failed` releases that left the causes undecided, k more releases decide
with the beta-binomial probability

    1 - product over j < k of (b + failed + j) / (weight + failed + j),    b = (1 - confirmed) weight.

If no gap is visible, a small effect may become visible with further releases. Let z be the estimate of effect i in
standard deviations, l the estimate up to which the effect is excluded, and g the factor by which the releases increase
the information about the effect. The hypotheses are that no effect is present, or that effect i alone is present, with
a flat prior of its size. Their probabilities have the ratio

    1 : exp((z^2 - l^2) / 2),

so that an effect at the limit of exclusion is as probable as no effect. If effect i is present, its next estimate has
mean z sqrt(g) and variance g - 1, in the new standard deviations. If no effect is present, the largest estimate has
mean z / sqrt(g) and variance 1 - 1/g. The releases leave the question open if the next estimate is too large to exclude
the effect and too small to decide it. The estimate that decides an effect is normally distributed (`decided`,
`spread`). Effects that are excluded now are included, because the estimate of an effect that is present grows. Earlier
releases do not count as `failed`, because the reason for the missing decision is known.

Sources: H. Jeffreys (1946), An invariant form for the prior probability in estimation problems, Proceedings of the
Royal Society A 186, 453-461. J. G. Skellam (1948), A probability distribution derived from the binomial distribution by
regarding the probability of success as variable between the sets of trials, Journal of the Royal Statistical Society B
10, 257-261.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from dpr_lab.acceptance.judge import SURE
from dpr_lab.arrays import Array, Flags
from dpr_lab.gap.hypothesis.detectable import SIGMAS
from dpr_lab.planning.worth.criteria import OpenAmplitudes, OpenPairs


@dataclass(frozen=True, slots=True)
class ForecastSettings:
    """Settings of the forecast."""

    confirmed: float = 0.875
    """Fraction of the planned releases in blind trials that decided the causes as expected: 38 of 43."""
    weight: float = 4.0
    """Weight of `confirmed` in the prior of one plant, expressed as a number of releases."""
    revealed: float = 0.1
    """The same fraction if the previous diagnosis left a remainder above the noise.

    The next release decided the causes on none of 4 own plants with one main effect and three to six small effects.
    """
    likely: float = 0.8
    """Minimum probability of a decision for which a number of releases is recommended."""
    draws: int = 256
    """Number of random draws for each true cause."""
    separable: float = 6.0
    """Minimum d^2 at which two causes count as separable; odds of 20 to 1 then result on average."""
    repeats: int = 6
    """Maximum number of further releases whose d^2 may be summed to reach this value."""
    decided: float = 7.7
    """Estimate of an effect, in standard deviations, at which several releases decide it with a probability of 1/2.

    An effect is named from 6.2 on, but its alternatives must also be improbable. In blind trials with at least two
    releases, six of twelve causes named at 6.2 to 9.3 standard deviations were decided, and all but two above.
    """
    spread: float = 1.5
    """Standard deviation of this limit between effects and recordings."""
    least: float = 1e-9
    """Minimum relative increase of the information, which keeps variances positive."""


FORECAST = ForecastSettings()


class SmallEffect(NamedTuple):
    """Most significant amplitude of an effect that is not named, in standard deviations."""

    excess: float
    """Difference of the estimate and the limit of exclusion; the largest one has the greatest influence."""
    z: float
    excluded: float
    """Largest estimate that excludes the effect."""
    gain: float
    """Factor by which further releases increase the information about the amplitude."""

    def undecided(self, present: bool) -> float:
        """Return the probability that the next estimate neither excludes nor decides the effect.

        Args:
            present: whether the effect is present in the rig
        """
        scale = self.gain**0.5
        mean, variance = (self.z * scale, self.gain - 1.0) if present else (self.z / scale, 1.0 - 1.0 / self.gain)
        not_excluded = 1.0 - NormalDist(mean, variance**0.5).cdf(self.excluded)
        decided = NormalDist(FORECAST.decided, (FORECAST.spread**2 + variance) ** 0.5).cdf(mean)
        return max(not_excluded - decided, 0.0)


def decision_probability(
    pairs: Sequence[OpenPairs],
    gained: Sequence[Array],
    releases: int = 1,
    inseparable: Collection[str] = (),
    failed: int = 0,
    confirmed: float | None = None,
) -> float:
    """Return the probability that further releases decide the cause of every named effect.

    Args:
        pairs: candidate causes of each named effect
        gained: (n, n) d^2 that the releases add, for each named effect
        releases: number of these releases
        inseparable: causes that no release separates; they count as one cause
        failed: number of recorded releases that did not decide the causes as expected
        confirmed: fraction of the releases that decide the causes as expected; None: the usual fraction
    """
    confirmed = FORECAST.confirmed if confirmed is None else confirmed
    weight = FORECAST.weight + failed + np.arange(releases)
    probability = 1.0 - np.prod(1.0 - confirmed * FORECAST.weight / weight)
    for pair, d2 in zip(pairs, gained, strict=True):
        together = np.array([name in inseparable for name in pair.names])
        probability *= _decided(pair.probabilities, d2, together)
    return float(probability)


def _decided(p: Array, d2: Array, together: Flags) -> float:
    """Return the fraction of random draws in which the cause of one named effect is decided.

    Causes for which `together` is true count as one cause.
    """
    from scipy.special import ndtri  # slow to import
    from scipy.stats.qmc import Sobol

    outside = max(1.0 - float(p.sum()), 0.0)
    normal = ndtri(Sobol(len(p), rng=np.random.default_rng(0)).random(FORECAST.draws) % 1.0)
    normal = np.clip(normal, -6.0, 6.0)
    total = 0.0
    for truth in range(len(p)):
        loss = 0.5 * d2[truth] + np.sqrt(d2[truth]) * normal
        loss[:, truth] = 0.0
        weight = p * np.exp(-np.clip(loss, -500, 500))
        most = np.maximum(weight.max(axis=1), weight[:, together].sum(axis=1))
        best = most / weight.sum(axis=1)
        total += p[truth] * float(np.mean(best >= SURE))
    return (1.0 - outside) * total / max(float(p.sum()), 1e-12)


def settled_probability(amplitudes: OpenAmplitudes) -> float:
    """Return the probability that further information decides for every small effect whether it is present.

    Args:
        amplitudes: all tested amplitudes, with the current and the additional information
    """
    effects: dict[str, SmallEffect] = {}
    gains = (amplitudes.after / amplitudes.before).tolist()
    for amplitude, gain in zip(amplitudes.tested, gains, strict=True):
        z = SIGMAS * abs(amplitude.estimate) / amplitude.size
        excluded = SIGMAS - NormalDist().inv_cdf(amplitude.sufficient)
        candidate = SmallEffect(z - excluded, z, excluded, max(gain, 1.0 + FORECAST.least))
        effects[amplitude.effect] = max(candidate, effects.get(amplitude.effect, candidate))
    if not effects:
        return 1.0
    weights = {name: math.exp(min(0.5 * (small.z**2 - small.excluded**2), 500.0)) for name, small in effects.items()}
    undecided = max(effects.values()).undecided(present=False)
    undecided += sum(weights[name] * small.undecided(present=True) for name, small in effects.items())
    return 1.0 - undecided / (1.0 + sum(weights.values()))
