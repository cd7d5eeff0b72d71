"""Grow a set of effects from the bare model: the score test names candidates, the best are fitted, two sets go on."""

from collections.abc import Iterator

from dpr_lab.gap.attempts import Attempts
from dpr_lab.gap.hypothesis import Hypothesis
from dpr_lab.gap.score import Score, Scores
from dpr_lab.gap.worth import GAIN, KEEPS, LARGE, chance, closed, excess, far, worth

FITTED = 4
FITTED_WHEN_FAR = 6
BEAM = 2
BEAM_WORSE = 4.0  # a second set goes on only while its excess is within this factor of the best
AS_PROMISING = 0.5  # share of what a set gained by closing the gap that another effect must promise to be fitted too
TWIN_GAIN = 1e-3  # relative difference of gains within which twins are not fitted twice


def grow(search: Attempts, begun: Hypothesis, max_effects: int) -> Hypothesis:
    """The best set on the way from `begun` to `max_effects`, or as far as one effect more is worth it."""
    best, front = begun, [begun]
    for _ in range(max_effects - len(begun.effects)):
        level: dict[frozenset[str], Hypothesis] = {}
        for at in front:
            level |= {after.key: after for after in _one_more(search, at)}
        if not level:
            break
        ranked = sorted(level.values(), key=lambda item: item.cost)
        ranked = sorted([search.unlocked(ranked[0]), *ranked[1:]], key=lambda item: item.cost)
        if not worth(search.bare, best, ranked[0]):
            break
        best = ranked[0]
        others = [item for item in ranked[1:] if not _contains(search, item, best)]
        front = [best, *(item for item in others[: BEAM - 1] if excess(item) < BEAM_WORSE * excess(best))]
        if closed(best):
            front = [best]
    return best


def _one_more(search: Attempts, at: Hypothesis) -> Iterator[Hypothesis]:
    """The set with each of the most promising effects; once nothing but noise is left, only those as promising."""
    scores, least = search.scores(at), 0.0
    for item in _candidates(at, scores):
        if item.gain > least:
            after = search.with_one(at, scores, item)
            if closed(after):
                least = max(least, AS_PROMISING * (at.fit.chi2 - after.fit.chi2))
            yield after


def leanest(search: Attempts, grown: Hypothesis) -> Hypothesis:
    """The smallest set that was seen to explain nearly as much: growth may have passed it by on another branch."""
    lean = [
        item
        for item in search.seen.values()
        if 0 < len(item.effects) < len(grown.effects)
        and excess(item) < KEEPS * excess(grown)
        and excess(item) - excess(grown) < LARGE * excess(search.bare)
        and (not closed(grown) or (closed(item) and item.cost - grown.cost < chance(search.bare, item, grown)))
    ]
    return min(lean, key=lambda item: (len(item.effects), item.cost), default=grown)


def _contains(search: Attempts, one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two sets differ only by an effect and a simpler form of it."""
    more, less = one.key - other.key, other.key - one.key
    if len(more) != 1 or len(less) != 1:
        return False
    (first,), (second,) = more, less
    return first in search.library[second].nested or second in search.library[first].nested


def _candidates(at: Hypothesis, scores: Scores) -> list[Score]:
    """The most promising effects; of twins, which promise the same, one; with each also the simpler ones in it."""
    inflation = min(at.remainder.inflation, max(1.0, at.remainder.chi2 / at.remainder.dof))
    promising = [
        item
        for item in scores.ranking
        if item.gain > GAIN * max(0.5 * inflation, 1.0) and not set(item.effect.nested) & at.key
    ]
    count = FITTED_WHEN_FAR if far(at) else FITTED
    picked: list[Score] = []
    for item in promising:
        if any(_twins(item, other) for other in picked):
            continue
        picked.append(item)
        if len(picked) == count:
            break
    names = {item.effect.name for item in picked}
    inner = {name for item in picked for name in item.effect.nested} - names
    return picked + [item for item in promising if item.effect.name in inner]


def _twins(one: Score, other: Score) -> bool:
    same = abs(one.gain - other.gain) <= TWIN_GAIN * max(one.gain, other.gain)
    return same and len(one.columns) == len(other.columns) and other.effect.name in one.effect.twins
