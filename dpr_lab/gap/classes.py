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
from dpr_lab.gap.hypothesis import PRICE, Hypothesis
from dpr_lab.gap.score import Score, Scores, imitation
from dpr_lab.gap.select import TWIN_COSINE, Selection
from dpr_lab.gap.signatures import detectable
from dpr_lab.gap.worth import GAIN, closed, doubt

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
    own = scores.shaped[name][0]
    others = {item.effect.name: item for item in scores.ranking if item is not own}
    near = {other: imitation(scores, own, item) for other, item in others.items()}
    twins = tuple(other for other, item in others.items() if _twin(selection, without, scores, own, item))
    twins += tuple(other for other in _hidden(selection, own.effect) if other in others and other not in twins)
    rivals = [Rival(k, (k,), near[k], *_cost(selection, without, others[k])) for k in others if k not in twins]
    rivals = sorted(rivals, key=lambda rival: rival.cost)[:RIVALS]
    worse = np.array([0.0, *(rival.cost - chosen.cost for rival in rivals), without.cost - chosen.cost])
    weights = np.exp(np.clip(-worse / (2 * chosen.remainder.inflation * calibration.temperature), -50.0, 50.0))
    weights *= (1 - outside(selection, calibration)) / weights.sum()
    return Standing(
        name=name,
        members=(name, *twins),
        cosines={k: near[k] for k in twins},
        rivals=tuple(rivals),
        probability=float(weights[0]),
        rival_probabilities=tuple(weights[1:-1].tolist()),
    )


def _twin(selection: Selection, without: Hypothesis, scores: Scores, own: Score, other: Score) -> bool:
    """Whether the recordings prefer neither of two effects of one signature: by fits, else by linear scores."""
    if min(imitation(scores, own, other), imitation(scores, other, own)) <= TWIN_COSINE:
        return False
    indistinct = doubt(selection.base, selection.chosen)
    fitted = selection.seen.get(without.key | {other.effect.name})
    if fitted is not None:
        return fitted.cost - selection.chosen.cost < indistinct
    related = other.effect.name in own.effect.nested or own.effect.name in other.effect.nested
    return not related and own.gain - other.gain < max(indistinct, LINEAR * own.gain)


def _hidden(selection: Selection, own: Effect) -> tuple[str, ...]:
    """Richer forms of an effect of which the recordings could not show what they add."""
    chosen = selection.chosen
    size = max(abs(float(chosen.fit.point.vector[place(own.name, p.name)])) for p in own.amplitudes)
    told = detectable(chosen, selection.last)
    return tuple(
        item.effect.name
        for item in selection.last.ranking
        if own.name in item.effect.nested
        and all(least is None or least > HIDDEN * size for least in told[item.effect.name].values())
    )


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
