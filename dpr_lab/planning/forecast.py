"""Forecast of the probability that further releases decide the causes.

`dpr_lab.planning.stopping` contains the rule of this decision.

If cause t is true, further releases increase its log odds against each other cause j by a normally distributed amount
of mean d^2 / 2 and variance d^2 (`dpr_lab.planning.worth.criteria`). The true cause is drawn from the posterior, and
the increase from this normal distribution. The probability of a decision is the share of draws in which the probability
of one cause reaches `SURE`. If the cause is outside the library, no release decides it. Causes that no release
separates count as one cause, as in the stopping rule, because a bench check distinguishes them. Whether a release
separates causes is evaluated again after each planned release, with the information available then.

A release may also reveal another effect or another alternative. The causes are then undecided until a further release.
The setting `confirmed` takes this into account: it is the fraction of planned releases that decided the causes, among
those in blind trials for which the above probability predicted a decision (docs/theory.md, section 15). If n of N
releases decided the causes, `confirmed` is (n + 1/2) / (N + 1), the posterior mean for the Jeffreys prior.

If the selected effects leave a remainder above the noise, its cause is not known, although the search tested every
effect of the library. A further release then decides only if it reveals this cause. `revealed` replaces `confirmed` in
this case, and was estimated in the same way.

For an individual plant, the probability of a decision differs from this mean: the causes may remain undecided for
reasons that a forecast cannot take into account. The prior of this probability is a beta distribution with the above
mean and a weight of `weight` releases. After `failed` releases that left the causes undecided, k more releases decide
with the beta-binomial probability

    1 - product over j < k of (b + failed + j) / (weight + failed + j),    b = (1 - confirmed) weight.

If no gap is visible, a small effect may become visible with further releases. The alternatives of this effect must then
be excluded as well. Therefore the score tests after each planned release are simulated. Let G be the information about
the tested amplitudes, with the unknowns of the model fitted, and z_i the estimate of amplitude i in standard
deviations. The hypotheses are that no effect is present, or that one effect alone is present. Of this effect, only the
most significant amplitude i is present, with a flat prior. The criterion by which a diagnosis selects effects (BIC)
approximates the odds of the hypotheses, with the penalty p_i of this amplitude and of the shapes of the effect:

    1 : q exp((z_i^2 - p_i) / 2).

q is the prior odds of the effect (`Effect.prior_odds`), relative to their mean over the tested effects. A common effect
is more probable than a rare one, as in a diagnosis.

The releases add the information D. Let a be the size of the present amplitude i. The score of each amplitude j
increases by its mean response to a, and by noise:

    z_j' = (z_j sqrt(G_jj) + D_ji a + n_j) / sqrt(G_jj + D_jj),    a ~ N(z_i / sqrt(G_ii), 1 / G_ii),    n ~ N(0, D).

D depends on the start pose, and a manually placed pose differs from the planned one. If a single segment contributes
most of D, a small difference removes it. D is therefore computed for several random placement errors, not averaged.

The improvement by an effect is its largest z'^2 minus the penalty of its parameters. A draw settles the question if all
effects are excluded, or if the best effect is named and decided. The effect is named if its improvement is significant.
Its probability follows from the improvements of the best effect, of its best alternatives and of no effect, and from
the prior odds of the effects, as in a diagnosis. It is decided if this probability reaches `SURE`. An effect that
becomes visible therefore remains undecided if another effect has a similar signature, unless no release separates the
two effects. Two effects are separated by the distance between the readings under the first effect and the nearest
readings under the second one, at any of its amplitudes. The recordings end with the first release that settles the
question. Effects that are excluded now are included, because the estimate of an effect that is present grows. The
simulation contains the effects that a release may reveal. Therefore neither `confirmed` nor `failed` applies to it.

Sources: H. Jeffreys (1946), An invariant form for the prior probability in estimation problems, Proceedings of the
Royal Society A 186, 453-461. R. E. Kass & A. E. Raftery (1995), Bayes factors, Journal of the American Statistical
Association 90, 773-795. J. G. Skellam (1948), A probability distribution derived from the binomial distribution by
regarding the probability of success as variable between the sets of trials, Journal of the Royal Statistical Society B
10, 257-261.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from dpr_lab.acceptance.judge import SURE
from dpr_lab.arrays import Array, Flags
from dpr_lab.effects import EFFECTS
from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.hypothesis.detectable import SIGMAS
from dpr_lab.gap.hypothesis.hypothesis import PENALTY
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS
from dpr_lab.planning.knowledge import schur_complement
from dpr_lab.planning.worth.criteria import OpenAmplitudes, OpenPairs


@dataclass(frozen=True, slots=True)
class ForecastSettings:
    """Settings of the forecast."""

    confirmed: float = 0.875
    """Fraction of the planned releases in blind trials that decided the causes as expected: 38 of 43."""
    weight: float = 4.0
    """Weight of `confirmed` in the prior of one plant, as an equivalent number of releases."""
    revealed: float = 0.1
    """Value of `confirmed` if the previous diagnosis left a remainder above the noise.

    The next release decided the causes on none of 4 plants with one main effect and three to six small effects.
    """
    likely: float = 0.8
    """Minimum probability of a decision up to which further releases are recommended."""
    draws: int = 256
    """Number of random draws for each true cause."""
    separable: float = 6.0
    """Minimum d^2 at which two causes count as separable; odds of 20 to 1 then result on average."""
    repeats: int = 6
    """Number of repeated further releases, with whose sum of d^2 `separable` is compared."""
    placements: int = 8
    """Number of random placement errors for which each planned release is simulated."""
    tests: int = 64
    """Number of simulated score tests for each effect and each placement error."""


FORECAST = ForecastSettings()


class TestedEffects(NamedTuple):
    """Score test of the effects that are not named, after further releases."""

    z: Array
    """(n,) present estimates of the amplitudes, in standard deviations."""
    limits: Array
    """(n,) limit of the estimate of each amplitude, in standard deviations, below which the effect is excluded."""
    columns: list[list[int]]
    """Columns of the amplitudes of each effect."""
    largest: list[int]
    """Column of the most significant amplitude of each effect."""
    prices: Array
    """(effects,) penalty of the parameters of each effect, in units of chi2."""
    log_prior: Array
    """(effects,) logarithm of the prior odds of each effect, relative to their mean."""
    probabilities: Array
    """(1 + effects,) probability of no effect, and of each effect alone."""
    separation: Array
    """(effects, effects) increase of d^2 between two effects by repeated releases.

    The effect of the row has an estimated size of one standard deviation.
    """

    @classmethod
    def of(cls, amplitudes: OpenAmplitudes, releases: int) -> "TestedEffects":
        """Group the tested amplitudes by effect.

        Args:
            amplitudes: the amplitudes, with the present information and the information after the releases
            releases: number of these releases
        """
        z = np.array([SIGMAS * tested.estimate / tested.size for tested in amplitudes.tested])
        limits = np.array([SIGMAS - NormalDist().inv_cdf(tested.sufficient) for tested in amplitudes.tested])
        names = np.array([tested.effect for tested in amplitudes.tested])
        effects = [EFFECTS[name] for name in dict.fromkeys(names.tolist())]
        columns = [np.flatnonzero(names == effect.name).tolist() for effect in effects]
        largest = [max(of_effect, key=lambda i: abs(z[i]) - limits[i]) for of_effect in columns]
        prices = PENALTY.parameter * np.array([len(effect.amplitudes) + len(effect.shapes) for effect in effects])
        shapes = np.array([len(effect.shapes) for effect in effects])
        prior = np.array([effect.prior_odds for effect in effects])
        log_prior = np.log(prior / prior.mean())
        log_odds = np.append(0.0, log_prior + 0.5 * (z[largest] ** 2 - PENALTY.parameter * (1 + shapes)))
        odds = np.exp(log_odds - log_odds.max())
        repeated = amplitudes.after + FORECAST.repeats / releases * (amplitudes.after - amplitudes.before)
        D2 = _distances(repeated, largest, columns) - _distances(amplitudes.after, largest, columns)
        power = np.diag(amplitudes.after)[largest, None]
        separation = D2 / power / CALIBRATION.temperature
        return cls(z, limits, columns, largest, prices, log_prior, odds / odds.sum(), separation)

    def settled(self, z: Array) -> Flags:
        """Return the (draws,) mask of the draws that decide the causes.

        In such a draw, every effect is excluded, or one effect is significant and its alternatives are improbable.

        Args:
            z: (draws, n) estimates of the amplitudes, in standard deviations
        """
        excluded = np.all(np.abs(z) < self.limits, axis=1)
        improvement = np.stack([np.max(z[:, columns] ** 2, axis=1) for columns in self.columns], axis=1) - self.prices
        log_weights = improvement / (2 * CALIBRATION.temperature) + self.log_prior
        named, best = improvement.max(axis=1) >= THRESHOLDS.chance, log_weights.argmax(axis=1)
        of_best = improvement[range(len(z)), best]
        explained = of_best + self.prices[best]
        weights = np.exp(log_weights - log_weights.max(axis=1, keepdims=True))
        of_none = np.exp(-of_best / (2 * CALIBRATION.temperature))
        alike = explained[:, None] * self.separation[best] < FORECAST.separable
        cause, alternatives = np.sum(weights * alike, axis=1), np.sort(weights * ~alike, axis=1)
        others = alternatives[:, -CALIBRATION.alternatives :].sum(axis=1) + of_none
        sure = (1 - CALIBRATION.outside_when_closed) * cause >= SURE * (cause + others)
        return np.asarray(excluded | (named & sure), dtype=np.bool_)


def decision_probability(
    pairs: Sequence[OpenPairs],
    gained: Sequence[Array],
    releases: int = 1,
    inseparable: Sequence[Flags] = (),
    failed: int = 0,
    confirmed: float = FORECAST.confirmed,
) -> float:
    """Return the probability that further releases decide the cause of every named effect.

    Args:
        pairs: candidate causes of each named effect
        gained: (n, n) increases of the squared distance d^2 between two causes by the releases, for each named effect
        releases: number of these releases
        inseparable: (n, n) pairs of causes that no release separates, for each named effect; such causes count as one
            cause; empty: every pair is separable
        failed: number of recorded releases that did not decide the causes as expected
        confirmed: fraction of the releases that decide the causes as expected
    """
    weight = FORECAST.weight + failed + np.arange(releases)
    probability = 1.0 - np.prod(1.0 - confirmed * FORECAST.weight / weight)
    alone = [np.eye(len(pair.names), dtype=np.bool_) for pair in pairs]
    for pair, d2, alike in zip(pairs, gained, inseparable or alone, strict=True):
        probability *= (1.0 - pair.outside) * _decided(pair.probabilities, d2, alike)
    return float(probability)


def _decided(p: Array, d2: Array, alike: Flags) -> float:
    """Return the fraction of random draws that decide the cause of a named effect.

    Args:
        p: (n,) probabilities of the causes
        d2: (n, n) increases of the squared distance between two causes
        alike: (n, n) pairs of causes that count as one cause
    """
    from scipy.special import ndtri  # slow to import
    from scipy.stats.qmc import Sobol

    normal = ndtri(Sobol(len(p), rng=np.random.default_rng(0)).random(FORECAST.draws) % 1.0)
    normal = np.clip(normal, -6.0, 6.0)
    loss = 0.5 * d2[:, None] + np.sqrt(d2)[:, None] * normal
    weight = p * np.exp(-np.clip(loss, -500, 500))
    weight[range(len(p)), :, range(len(p))] = p[:, None]  # the true cause itself
    best = (weight @ alike).max(axis=2) / weight.sum(axis=2)
    return float(p @ np.mean(best >= SURE, axis=1)) / max(float(p.sum()), 1e-12)


def settled_probabilities(paths: Sequence[Sequence[OpenAmplitudes]]) -> list[float]:
    """Return the probability that further releases decide on the presence of every small effect.

    Args:
        paths: for each random placement error, the tested amplitudes with the information after one release, after two
            releases and so on

    Returns:
        one probability for each number of further releases
    """
    if not paths[0][0].tested:
        return [1.0] * len(paths[0])
    rng = np.random.default_rng(0)
    mean: list[float] = np.mean([_settled(path, rng) for path in paths], axis=0).tolist()
    return mean


def _settled(path: Sequence[OpenAmplitudes], rng: np.random.Generator) -> Array:
    """Return the (releases,) probabilities of `settled_probabilities` for one path."""
    draws, first = FORECAST.tests, path[0].before
    tests = [TestedEffects.of(amplitudes, number) for number, amplitudes in enumerate(path, 1)]
    present_test, std = tests[0], np.diag(first) ** -0.5
    largest = present_test.largest
    sizes = (present_test.z[largest] + rng.standard_normal((draws, 1))) * std[largest]
    present = np.pad(sizes, ((0, 0), (1, 0)))  # the first hypothesis is that no effect is present
    scores = np.tile(present_test.z / std, (draws, 1))
    settled, probabilities, before = np.zeros(present.shape, dtype=np.bool_), list[float](), first
    for test, amplitudes in zip(tests, path, strict=True):
        powers, directions = np.linalg.eigh(amplitudes.after - before)
        scores += (rng.standard_normal(scores.shape) * np.sqrt(np.maximum(powers, 0.0))) @ directions.T
        responses = present[:, :, None] * (amplitudes.after - first)[[0, *largest]]
        z = (scores[:, None] + responses) / np.sqrt(np.diag(amplitudes.after))
        settled |= test.settled(z.reshape(-1, z.shape[2])).reshape(settled.shape)
        probabilities.append(float(settled.mean(axis=0) @ test.probabilities))
        before = amplitudes.after
    return np.array(probabilities)


def _distances(information: Array, largest: Sequence[int], columns: Sequence[Sequence[int]]) -> Array:
    """Return the (effects, effects) squared distances D^2 between effects.

    An entry is the squared distance of the readings under an effect of unit size (row) from the nearest readings under
    another effect (column), with all amplitudes of the latter fitted.

    Args:
        information: (n, n) information about all amplitudes
        largest: column of the amplitude of unit size, for each effect
        columns: columns of all amplitudes of each effect
    """
    remaining = [np.diag(schur_complement(information, of_effect, largest)) for of_effect in columns]
    return np.maximum(np.stack(remaining, axis=1), 0.0)
