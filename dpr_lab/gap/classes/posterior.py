"""Classes of effects that are indistinguishable on these recordings, alternatives, and their probabilities.

Two effects whose signatures (what they do to the readings, ratios and initial states projected out) agree to 0.999 in
cosine, and that predict the recordings equally well, are one class: no algorithm can split them on this record.

Inside a class the prior of each member's fitted size (`dpr_lab.effects.plausibility`) divides the probability: a clock
that would have to be 3 % off is no crystal's, a length that is 6 % off is a length.

The probability of a class is the softmax of the predictive costs of the sets in which it takes the place of the named
effect, times the probability that the cause is in the library at all, which falls with the share of the gap that stays
unexplained.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import effect_params, param_index, plausibility
from dpr_lab.effects.effect import Effect
from dpr_lab.gap.hypothesis.detectable import detectable
from dpr_lab.gap.hypothesis.hypothesis import PRICE, Hypothesis
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.hypothesis.thresholds import THRESHOLDS, at_noise_floor, indifference
from dpr_lab.gap.which.selected import Selection

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Calibration:
    """Conversion of costs to probabilities, calibrated on blind trials by `benchmarks/calibrate_diagnosis.py`."""

    temperature: float = 3.0
    """By which differences of log predictive density are divided."""
    half_unexplained: float = 0.07
    """Share of the gap left at which the cause is as likely outside the library as in it."""
    steepness: float = 2.0
    """Power with which that probability rises with the share left."""
    sure: float = 0.98
    """Probability of what was found, where there is either no gap or nothing that explains it."""
    outside_when_closed: float = 0.02
    """Probability of a cause outside the library when nothing but noise is left."""
    unseen: float = 0.5
    """Probability of no gap where the recordings would not show most effects: as good as none."""
    least_left: float = 1e-6
    """Share left that counts at least: the integrator's."""


CALIBRATION = Calibration()

ALTERNATIVES = 5
"""Of each named effect, at most."""

HIDDEN = 0.5
"""Share of an effect up to which what a richer form adds to it may go unseen and still be likely."""

SAME_SCORE = 1e-3
"""Relative difference that linear scores of the same thing may have."""

NEGLIGIBLE = 50.0
"""Difference of log probability beyond which another set weighs nothing."""


@dataclass(frozen=True, slots=True)
class Alternative:
    """Another effect in the place of a named one."""

    name: str
    members: tuple[str, ...]
    cosine: float
    """Of its signature with that of the named effect; the part of the named one's it can imitate."""
    cost: float
    """As of a hypothesis; from the linear score where it was not fitted."""
    probability: float = 0.0


@dataclass(frozen=True, slots=True)
class EffectPosterior:
    """A named effect, the effects indistinguishable from it, and its alternatives."""

    name: str
    members: tuple[str, ...]
    """The effect itself and those indistinguishable from it."""
    alternatives: tuple[Alternative, ...]
    probability: float
    odds: tuple[float, ...] = ()
    """Of each member, its share of the probability by the prior of its fitted size."""


def effect_posterior(selection: Selection, name: str, calibration: Calibration = CALIBRATION) -> EffectPosterior:
    """Class, alternatives and probability of one named effect.

    Args:
        selection: the chosen set and all that were fitted
        name: the effect
        calibration: of the probabilities
    """
    without, chosen, test = selection.without[name], selection.chosen, selection.tests_without[name]
    own = test.shaped[name][0]
    others = {item.effect.name: item for item in test.ranking if item is not own}
    alike = [other for other, item in others.items() if _indistinguishable(selection, without, test, own, item)]
    alike += [other for other in _hidden(selection, own.effect) if other in others and other not in alike]
    sizes = {other: _plausibility(selection, without, others[other]) for other in alike}
    alike = sorted(alike, key=lambda other: -sizes[other])
    prior = np.array([plausibility(chosen.fit.estimate.params, name), *(sizes[other] for other in alike)])
    found = [
        Alternative(other, (other,), test.cosine(own, item), _cost(selection, without, item))
        for other, item in others.items()
        if other not in alike
    ]
    found = sorted(found, key=lambda item: item.cost)[:ALTERNATIVES]
    worse = np.array([0.0, *(item.cost - chosen.cost for item in found), without.cost - chosen.cost])
    scaled = -worse / (2 * chosen.residuals.inflation * calibration.temperature)
    weights = np.exp(np.clip(scaled, -NEGLIGIBLE, NEGLIGIBLE))
    weights *= (1 - outside(selection, calibration)) / weights.sum()
    return EffectPosterior(
        name=name,
        members=(name, *alike),
        alternatives=tuple(
            Alternative(item.name, item.members, item.cosine, item.cost, float(weight))
            for item, weight in zip(found, weights[1:-1], strict=True)
        ),
        probability=float(weights[0]),
        odds=tuple((prior / prior.sum()).tolist()),
    )


def _plausibility(selection: Selection, without: Hypothesis, item: Score) -> float:
    """Prior of the size of another effect in the place of a named one: as fitted, else by its linear score."""
    fitted = selection.fitted.get(without.key | {item.effect.name})
    if fitted is not None:
        return plausibility(fitted.fit.estimate.params, item.effect.name)
    params = effect_params({})
    for name, value in item.named_amplitudes.items():
        params[param_index(item.effect.name, name)] = value
    return plausibility(params, item.effect.name)


def _indistinguishable(selection: Selection, without: Hypothesis, test: ScoreTest, own: Score, other: Score) -> bool:
    """Whether the recordings prefer neither of two effects of one signature: by fits, else by linear scores."""
    if min(test.cosine(own, other), test.cosine(other, own)) <= THRESHOLDS.indistinguishable:
        return False
    margin = indifference(selection.base, selection.chosen)
    fitted = selection.fitted.get(without.key | {other.effect.name})
    if fitted is not None:
        return fitted.cost - selection.chosen.cost < margin
    related = other.effect.name in own.effect.nested or own.effect.name in other.effect.nested
    return not related and own.gain - other.gain < max(margin, SAME_SCORE * own.gain)


def _hidden(selection: Selection, own: Effect) -> tuple[str, ...]:
    """Richer forms of an effect of which the recordings could not show what they add."""
    params = selection.chosen.fit.estimate.params
    size = max(abs(float(params[param_index(own.name, p.name)])) for p in own.amplitudes)
    least = detectable(selection.chosen, selection.final_test)
    return tuple(
        item.effect.name
        for item in selection.final_test.ranking
        if own.name in item.effect.nested
        and all(seen is None or seen > HIDDEN * size for seen in least[item.effect.name].values())
    )


def _cost(selection: Selection, without: Hypothesis, item: Score) -> float:
    fitted = selection.fitted.get(without.key | {item.effect.name})
    if fitted is not None:
        return fitted.cost
    price = PRICE * without.residuals.inflation * (len(item.columns) + len(item.effect.shapes))
    # A linear score promises too much; what was not worth a fit can at most come near.
    near = selection.chosen.cost + THRESHOLDS.chance * selection.chosen.residuals.inflation
    return max(without.cost - item.gain + price, near)


def outside(selection: Selection, calibration: Calibration = CALIBRATION) -> float:
    """Probability that the cause of the gap is not in the library."""
    if at_noise_floor(selection.chosen):
        return calibration.outside_when_closed
    left = max(1 - selection.share_explained, calibration.least_left)
    odds = (left / calibration.half_unexplained) ** calibration.steepness
    return max(odds / (1 + odds), calibration.outside_when_closed)


def probabilities(selection: Selection, posteriors: tuple[EffectPosterior, ...], kind: str) -> Mapping[str, float]:
    """Of no gap, of a cause outside the library, and of each class in the place it would take.

    Args:
        selection: the chosen set of effects
        posteriors: of the chosen effects; none where they are withheld
        kind: the verdict
    """
    if kind in ("no_gap", "inconclusive") or not posteriors:
        nothing = {"no_gap": CALIBRATION.sure, "inconclusive": CALIBRATION.unseen}.get(kind, 1 - CALIBRATION.sure)
        return {"no_gap": nothing, "unexplained": 1 - nothing}
    found = {"no_gap": 0.0, "unexplained": outside(selection)}
    for item in posteriors:
        found[item.name] = item.probability
        for other in item.alternatives:
            found[other.name] = max(found.get(other.name, 0.0), other.probability)
    return found
