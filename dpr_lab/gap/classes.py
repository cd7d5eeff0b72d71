"""What cannot be told apart on these recordings, what else it could be, and how probable each is.

Two effects whose signatures (what they do to the readings, ratios and start states projected out) agree to 0.999 in
cosine, and that predict the recordings equally well, are one class: no algorithm can split them on this record.

The probability of a class is the softmax of the predictive scores of the sets in which it takes the place of the named
effect, times the probability that the cause is in the library at all, which falls with the share of the gap that stays
unexplained.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import place
from dpr_lab.effects.effect import Effect
from dpr_lab.gap.attempts import closed
from dpr_lab.gap.hypothesis import PRICE, Hypothesis
from dpr_lab.gap.score import Score, Scores, imitation
from dpr_lab.gap.select import CONTAINED_WHEN_CLOSED, GAIN, TWIN_COSINE, Selection
from dpr_lab.gap.signatures import detectable

Array = NDArray[np.float64]

RIVALS = 5
HIDDEN = 0.5  # share of an effect up to which what a richer form adds to it may go unseen and still be likely
LINEAR = 1e-3  # relative difference that linear scores of the same thing may have


@dataclass(frozen=True, slots=True)
class Calibration:
    """How scores become probabilities; learnt on blind trials, `benchmarks/calibrate_diagnosis.py`."""

    temperature: float = 3.0
    """By which differences of log predictive density are divided."""
    half_unexplained: float = 0.07
    """Share of the gap left at which the cause is as likely outside the library as in it."""
    steepness: float = 2.0
    """Power with which that probability rises with the share left."""
    outside_when_closed: float = 0.02
    """Probability of a cause outside the library when nothing but noise is left."""


CALIBRATION = Calibration()


@dataclass(frozen=True, slots=True)
class Rival:
    """Another effect in the place of a named one."""

    name: str
    members: tuple[str, ...]
    cosine: float
    """Of its signature with that of the named effect; the part of the named one's it can imitate."""
    cost: float
    """As of a hypothesis; from the linear score where it was not fitted."""
    fitted: bool


@dataclass(frozen=True, slots=True)
class Standing:
    """A named effect among its twins and rivals."""

    name: str
    members: tuple[str, ...]
    cosines: Mapping[str, float]
    """Of its twins."""
    rivals: tuple[Rival, ...]
    probability: float
    rival_probabilities: tuple[float, ...]


def standing(selection: Selection, name: str, scores: Scores, calibration: Calibration = CALIBRATION) -> Standing:
    """Twins, rivals and probability of one named effect.

    Args:
        selection: the chosen set and all that were fitted
        name: the effect
        scores: the score test of the chosen set without it
        calibration: of the probabilities
    """
    without, chosen = selection.without[name], selection.chosen
    own = next(item for item in scores.ranking if item.effect.name == name)
    simpler = {other.effect.name for other in scores.ranking if name in other.effect.nested} | set(own.effect.nested)
    near = {item.effect.name: imitation(scores, own, item) for item in scores.ranking if item is not own}
    back = {item.effect.name: imitation(scores, item, own) for item in scores.ranking if item is not own}
    costs = {item.effect.name: _cost(selection, without, item) for item in scores.ranking}
    gains = {item.effect.name: item.gain for item in scores.ranking}
    twins = tuple(
        k
        for k in near
        if k not in simpler and min(near[k], back[k]) > TWIN_COSINE and _as_good(k, name, costs, gains, chosen)
    )
    doubt = max(
        GAIN * chosen.remainder.inflation,
        CONTAINED_WHEN_CLOSED * (selection.base.remainder.chi2 - chosen.remainder.chi2),
    )
    twins += tuple(
        k
        for k in near
        if k in simpler and min(near[k], back[k]) > TWIN_COSINE and abs(costs[k][0] - chosen.cost) < doubt
    )
    twins += tuple(k for k in _hidden(selection, own.effect, near) if k not in twins)
    rivals = [Rival(k, (k,), near[k], *costs[k]) for k in near if k not in twins]
    rivals = sorted(rivals, key=lambda rival: rival.cost)[:RIVALS]
    odds = [
        -(rival.cost - chosen.cost) / (2 * chosen.remainder.inflation * calibration.temperature) for rival in rivals
    ]
    odds.append(-(without.cost - chosen.cost) / (2 * chosen.remainder.inflation * calibration.temperature))
    weights = np.exp(np.clip([0.0, *odds], -50.0, 50.0))
    weights *= (1 - outside(selection, calibration)) / weights.sum()
    return Standing(
        name=name,
        members=(name, *twins),
        cosines={k: near[k] for k in twins},
        rivals=tuple(rivals),
        probability=float(weights[0]),
        rival_probabilities=tuple(weights[1:-1].tolist()),
    )


def _hidden(selection: Selection, own: Effect, near: Mapping[str, float]) -> tuple[str, ...]:
    """Richer forms of an effect of which the recordings could not show what they add."""
    chosen = selection.chosen
    size = max(abs(float(chosen.fit.point.vector[place(own.name, p.name)])) for p in own.amplitudes)
    told = detectable(chosen, selection.last)
    return tuple(
        item.effect.name
        for item in selection.last.ranking
        if own.name in item.effect.nested
        and item.effect.name in near
        and all(least is None or least > HIDDEN * size for least in told[item.effect.name].values())
    )


def _as_good(
    one: str, other: str, costs: Mapping[str, tuple[float, bool]], gains: Mapping[str, float], chosen: Hypothesis
) -> bool:
    """Whether the recordings do not prefer either: by their fits where there are both, else by their linear scores."""
    worth = GAIN * chosen.remainder.inflation
    (first, fitted), (second, too) = costs[one], costs[other]
    if fitted and too:
        return first - second < worth
    return gains[other] - gains[one] < max(worth, LINEAR * gains[other])


def _cost(selection: Selection, without: Hypothesis, item: Score) -> tuple[float, bool]:
    fitted = selection.seen.get(without.key | {item.effect.name})
    if fitted is not None:
        return fitted.cost, True
    price = PRICE * without.remainder.inflation * (len(item.columns) + len(item.effect.shapes))
    # A linear score promises too much; what was not worth a fit can at most come near.
    near = selection.chosen.cost + GAIN * selection.chosen.remainder.inflation
    return max(without.cost - item.gain + price, near), False


def outside(selection: Selection, calibration: Calibration = CALIBRATION) -> float:
    """Probability that the cause of the gap is not in the library."""
    left = 1 - share_explained(selection)
    if closed(selection.chosen):
        return calibration.outside_when_closed
    odds = (max(left, 1e-6) / calibration.half_unexplained) ** calibration.steepness
    return max(odds / (1 + odds), calibration.outside_when_closed)


def share_explained(selection: Selection) -> float:
    """Share of the bare model's excess chi2 that the chosen effects take away, 0 to 1."""
    before, after = selection.base.remainder, selection.chosen.remainder
    if before.excess <= 0:
        return 0.0
    return float(np.clip(1 - max(after.excess, 0.0) / before.excess, 0.0, 1.0))
