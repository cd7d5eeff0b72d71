"""Grow a set of effects from the bare model: the score test names candidates, the best are fitted, two sets go on."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.hypothesis.thresholds import (
    THRESHOLDS,
    accepted,
    at_noise_floor,
    excess,
    far_from_noise,
    significance,
)
from dpr_lab.gap.which.model_search import ModelSearch


@dataclass(frozen=True, slots=True)
class Beam:
    """How wide the search is."""

    fitted: int = 4
    """Candidates of a score test that are fitted."""
    fitted_when_far: int = 6
    """The same far from the noise, where linear scores mislead."""
    sets: int = 2
    """Sets that go on from one size to the next."""
    worse: float = 4.0
    """Factor of the best set's excess up to which another goes on."""
    exceeded: float = 2.0
    """Times that a fit far from the noise may exceed what its linear score promised; 1.7 was seen."""
    as_promising: float = 0.5
    """Share of what a set gained by reaching the noise that another effect must promise to be fitted too."""
    same_gain: float = 1e-3
    """Relative difference of gains within which effects that are hardly distinguishable are not fitted twice."""


BEAM = Beam()


def grow(search: ModelSearch, start: Hypothesis, max_effects: int, *, to_floor: bool = False) -> Hypothesis:
    """The best set on the way from `start` to `max_effects`, or as far as one effect more is worth it.

    Far from the noise one effect that does not help alone is passed: causes of one size may only help together. With
    `to_floor` growth ends where nothing but noise is left: longer segments show what else there is.
    """
    best, front, alone = start, [start], False
    for _ in range(max_effects - len(search.unexpected(start))):
        level: dict[frozenset[str], Hypothesis] = {}
        for at in front:
            for item in _one_more(search, at, level):
                level[item.key] = item
        if not level:
            break
        ranked = sorted(level.values(), key=lambda item: item.cost)
        ranked = sorted([search.escaped(ranked[0]), *ranked[1:]], key=lambda item: item.cost)
        last = ranked[0]
        if accepted(search.bare, best, last):
            best, alone = last, False
        elif alone or not far_from_noise(best):
            break
        else:
            alone = True
        if to_floor and at_noise_floor(best):
            break
        front = [last] if at_noise_floor(last) else [last, *_runners_up(search, last, ranked[1:])]
    return best


def _runners_up(search: ModelSearch, best: Hypothesis, others: list[Hypothesis]) -> list[Hypothesis]:
    """The next best sets that are no other form of the best, where they are near it."""
    apart = [item for item in others if not _contains(search, item, best)]
    return [item for item in apart[: BEAM.sets - 1] if excess(item) < BEAM.worse * excess(best)]


def _one_more(search: ModelSearch, at: Hypothesis, level: Mapping[frozenset[str], Hypothesis]) -> Iterator[Hypothesis]:
    """The set with each of the most promising effects; once nothing but noise is left, only those as promising.

    What would not even come near the best of its `level` if it kept its promise twice is not fitted.
    """
    least = 0.0
    for item in _candidates(at, search.test(at)):
        near = BEAM.worse * min(map(excess, level.values()), default=np.inf)
        if item.gain > least and not (far_from_noise(at) and excess(at) - BEAM.exceeded * item.gain > near):
            after = search.with_one(at, item)
            if at_noise_floor(after):
                least = max(least, BEAM.as_promising * (at.fit.chi2 - after.fit.chi2))
            yield after


def leanest(search: ModelSearch, grown: Hypothesis) -> Hypothesis:
    """The smallest set that was fitted and explains nearly as much: growth may have passed it by on another branch."""
    lean = [
        item
        for item in search.fitted.values()
        if 0 < len(item.effects) < len(grown.effects)
        and grown.key & search.expected <= item.key
        and excess(item) < THRESHOLDS.keeps * excess(grown)
        and excess(item) - excess(grown) < THRESHOLDS.large * excess(search.bare)
        and (not at_noise_floor(grown) or _as_likely(search, item, grown))
    ]
    return min(lean, key=lambda item: (len(item.effects), item.cost), default=grown)


def _as_likely(search: ModelSearch, item: Hypothesis, grown: Hypothesis) -> bool:
    return at_noise_floor(item) and item.cost - grown.cost < significance(search.bare, item, grown)


def _contains(search: ModelSearch, one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two sets differ only by an effect and a simpler form of it."""
    more, less = one.key - other.key, other.key - one.key
    if len(more) != 1 or len(less) != 1:
        return False
    (first,), (second,) = more, less
    return first in search.library[second].nested or second in search.library[first].nested


def _candidates(at: Hypothesis, test: ScoreTest) -> list[Score]:
    """Effects with the largest predicted reduction, one of those hardly distinguishable, and simpler forms of each."""
    inflation = min(at.residuals.inflation, max(1.0, at.residuals.chi2 / at.residuals.dof))
    promising = [
        item
        for item in test.ranking
        if item.gain > THRESHOLDS.chance * max(0.5 * inflation, 1.0) and not set(item.effect.nested) & at.key
    ]
    picked: list[Score] = []
    for item in promising:
        if len(picked) == (BEAM.fitted_when_far if far_from_noise(at) else BEAM.fitted):
            break
        if not any(_indistinguishable(item, other) for other in picked):
            picked.append(item)
    names = {item.effect.name for item in picked}
    inner = {name for item in picked for name in item.effect.nested} - names
    return picked + [item for item in promising if item.effect.name in inner]


def _indistinguishable(one: Score, other: Score) -> bool:
    same = abs(one.gain - other.gain) <= BEAM.same_gain * max(one.gain, other.gain)
    return same and len(one.columns) == len(other.columns) and other.effect.name in one.effect.twins
