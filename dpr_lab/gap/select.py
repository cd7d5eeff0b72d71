"""Which effects: sets of up to four, grown, pruned and swapped, judged by how they predict releases left out.

Forward alone is greedy and takes the plausible twin first. So two sets are carried forward, every effect is tried as a
later one too, and what was found is pruned, swapped and simplified before it is believed:

    grow      the score test names candidates, the best are fitted, the two best sets go on
    leanest   a smaller set that was passed on the way and explains nearly as much is taken instead
    prune     an effect without which the remainder hardly grows is dropped
    enrich    an effect gives way to a richer one that contains it
    simplify  an effect gives way to a simpler one that it contains and that explains as much
    exchange  while something is left, another effect is tried in the place of each
    withdraw  an effect that makes one release harder to predict from the others is not named
    overtake  a set no larger that turns out better while rivals are fitted takes its place
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import Effect
from dpr_lab.gap.attempts import FAR, FINE, Attempts, closed, excess
from dpr_lab.gap.hypothesis import Hypothesis, added, dropped
from dpr_lab.gap.problem import Problem
from dpr_lab.gap.score import Score, Scores, imitation

FITTED = 4
FITTED_WHEN_FAR = 6
BEAM = 2
BEAM_WORSE = 4.0  # a second set goes on only while its excess is within this factor of the best
GAIN = 30.0
"""Fall of chi2, in units of independent evidence, below which an effect is chance: the best of some 600 shapes."""
EXTRA = 90.0  # the same for one effect more where nothing but noise is left
REVISIONS = 3  # times that a choice may be taken back for what was found while it was examined
SWAPPED = 2  # candidates that are tried in the place of each effect
SLOW = 1.3  # factor by which one effect more must at least shrink the excess, unless it is large
KEEPS = 3.0  # factor by which the remainder must grow without an effect, for the effect to stay
KEEPS_IF_LARGE = 1.3  # the same for an effect that explains at least `LARGE` of the whole gap
LARGE = 0.04  # above what another form of an effect named already could make up for
SMALL = 0.01  # share of the gap below which an effect only makes up for another's form, while something is left
CONTAINED = 0.003  # share of the explained excess that a richer form of an effect must add
CONTAINED_WHEN_CLOSED = 5e-4  # the same share where nothing else is left: what the integrator's steps leave in doubt
TWIN_COSINE = 0.999
"""Of the signatures of two effects above which a recording hardly tells them apart."""
TWIN_GAIN = 1e-3  # relative difference of gains within which twins are not fitted twice


@dataclass(frozen=True, slots=True)
class Selection:
    """The chosen set of effects, and what it was chosen from."""

    base: Hypothesis
    chosen: Hypothesis
    seen: Mapping[frozenset[str], Hypothesis]
    """Every set that was fitted."""
    last: Scores
    """The score test beside the chosen set."""
    without: Mapping[str, Hypothesis]
    """The chosen set without each of its effects."""
    around: Mapping[str, Scores]
    """The score test beside each of those."""
    path: tuple[tuple[str, Hypothesis], ...]
    """From the bare model to the chosen set, one effect at a time, the most telling first."""


def select(
    made: Problem,
    base: Hypothesis,
    library: Mapping[str, Effect],
    *,
    max_effects: int = 4,
    on_step: Callable[[str], None] = lambda text: None,
) -> Selection:
    """Find the set of effects that explains the gap.

    Args:
        made: the segments
        base: the bare model, fitted
        library: effects to choose from
        max_effects: at most so many at once
        on_step: told what is being done
    """
    search = Attempts(made, library, {base.key: base}, {}, on_step)
    grown = _leanest(search, base, _grow(search, base, max_effects))
    chosen = _simplify(search, base, _enrich(search, _prune(search, base, grown)))
    chosen = _prune(search, base, _exchange(search, chosen))
    chosen = search.settled(_withdraw(search, chosen))
    found = _selection(search, base, chosen)
    for _ in range(REVISIONS):
        better = _overtaken(search, base, chosen)
        if better is None:
            break
        chosen = search.settled(_prune(search, base, better))
        found = _selection(search, base, chosen)
    return found


def _overtaken(search: Attempts, base: Hypothesis, chosen: Hypothesis) -> Hypothesis | None:
    """A set no larger that turned out to explain more, while twins were compared and sets taken apart."""
    rivals = [item for item in search.seen.values() if item.effects and len(item.effects) <= len(chosen.effects)]
    best = min(rivals, key=lambda item: item.cost, default=chosen)
    found = chosen.cost - best.cost > _chance(base, chosen, best) and best.key != chosen.key
    return best if found and closed(best) >= closed(chosen) else None


def _withdraw(search: Attempts, chosen: Hypothesis) -> Hypothesis:
    """Without effects that make a release harder to predict from the others than it was without them."""
    tolerance = GAIN * chosen.remainder.inflation
    for name in chosen.effects:
        less = search.without(chosen, name)
        if (chosen.surprise - less.surprise > tolerance).any():
            return _withdraw(search, less)
    return chosen


def _selection(search: Attempts, base: Hypothesis, chosen: Hypothesis) -> Selection:
    without = {name: search.without(chosen, name) for name in chosen.effects}
    around = {name: search.scores(item) for name, item in without.items()}
    for name, scores in around.items():
        _try_rivals(search, without[name], scores, name, chosen)
    path, at = [], chosen
    while at.effects:
        less = {name: search.without(at, name) for name in at.effects}
        weakest = min(less, key=lambda name: less[name].cost)
        path.append((weakest, at))
        at = less[weakest]
    return Selection(base, chosen, search.seen, search.scores(chosen), without, around, tuple(reversed(path)))


def _try_rivals(search: Attempts, less: Hypothesis, scores: Scores, name: str, chosen: Hypothesis) -> None:
    """Fit what the linear scores can hardly tell from an effect, or like better: all are compared as they fit."""
    own = next(item for item in scores.ranking if item.effect.name == name)
    related = {name, *own.effect.nested}
    for item in scores.ranking:
        form = item.effect.name in related or name in item.effect.nested
        if not form and item.gain > 0 and imitation(scores, own, item) > TWIN_COSINE:
            search.unlocked(search.with_one(less, scores, item))
    for item in scores.ranking[:SWAPPED]:
        if item is not own and less.cost - item.gain < chosen.cost:
            search.with_one(less, scores, item)


def _grow(search: Attempts, base: Hypothesis, max_effects: int) -> Hypothesis:
    best, front = base, [base]
    for _ in range(max_effects):
        level: dict[frozenset[str], Hypothesis] = {}
        for at in front:
            scores = search.scores(at)
            for item in _candidates(at, scores):
                after = search.with_one(at, scores, item)
                level[after.key] = after
        if not level:
            break
        ranked = sorted(level.values(), key=lambda item: item.cost)
        ranked = sorted([search.unlocked(ranked[0]), *ranked[1:]], key=lambda item: item.cost)
        if not _worth(base, best, ranked[0]):
            break
        best = ranked[0]
        others = [item for item in ranked[1:] if not _contains(search, item, best)]
        front = [best, *(item for item in others[: BEAM - 1] if excess(item) < BEAM_WORSE * excess(best))]
        if closed(best):
            front = [best]
    return best


def _worth(base: Hypothesis, before: Hypothesis, after: Hypothesis) -> bool:
    """Whether one effect more explains more than chance, and more than a form that is not quite right leaves open."""
    if before.cost - after.cost < _chance(base, before, after):
        return False
    return (
        closed(before) or excess(before) > SLOW * excess(after) or excess(before) - excess(after) > LARGE * excess(base)
    )


def _chance(base: Hypothesis, before: Hypothesis, after: Hypothesis) -> float:
    """Fall of cost from one set to a larger one that means nothing."""
    if not before.effects:
        return GAIN * after.remainder.inflation
    explained = base.remainder.chi2 - after.remainder.chi2
    independent = EXTRA if closed(before) else GAIN
    return max(independent * after.remainder.inflation, CONTAINED_WHEN_CLOSED * explained)


def _leanest(search: Attempts, base: Hypothesis, grown: Hypothesis) -> Hypothesis:
    """The smallest set that was seen to explain nearly as much: growth may have passed it by on another branch."""
    enough = max(KEEPS * excess(grown), 0.0)
    lean = [item for item in search.seen.values() if 0 < len(item.effects) < len(grown.effects)]
    lean = [
        item
        for item in lean
        if excess(item) < enough
        and excess(item) - excess(grown) < LARGE * excess(base)
        and (not closed(grown) or (closed(item) and item.cost - grown.cost < _chance(base, item, grown)))
    ]
    return min(lean, key=lambda item: (len(item.effects), item.cost)) if lean else grown


def _exchange(search: Attempts, current: Hypothesis) -> Hypothesis:
    """While something is left: another in the place of each effect, or the same one in another shape."""
    if closed(current) or not current.effects:
        return current
    best = current
    for name in current.effects:
        less = search.without(current, name)
        scores = search.scores(less)
        if EFFECTS[name].shapes:
            best = min(best, search.again(current, name), key=lambda item: item.cost)
        for item in scores.ranking[:SWAPPED]:
            if item.effect.name != name:
                best = min(best, search.with_one(less, scores, item), key=lambda one: one.cost)
    if excess(current) < SLOW * excess(best):
        return best if best.key == current.key else current
    return _exchange(search, best)


def _contains(search: Attempts, one: Hypothesis, other: Hypothesis) -> bool:
    """Whether two sets differ only by an effect and a simpler form of it."""
    more, less = one.key - other.key, other.key - one.key
    if len(more) != 1 or len(less) != 1:
        return False
    (first,), (second,) = more, less
    return first in search.library[second].nested or second in search.library[first].nested


def _candidates(at: Hypothesis, scores: Scores) -> list[Score]:
    """The most promising effects; of twins, which promise the same, one; with each also the simpler ones in it."""
    chance = GAIN * min(at.remainder.inflation, max(1.0, at.remainder.chi2 / at.remainder.dof))
    promising = [
        item for item in scores.ranking if item.gain > max(chance * 0.5, GAIN) and not set(item.effect.nested) & at.key
    ]
    count = FITTED_WHEN_FAR if at.remainder.chi2 > FAR * at.remainder.dof else FITTED
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


def _prune(search: Attempts, base: Hypothesis, grown: Hypothesis) -> Hypothesis:
    """Drop, one by one, effects that the remainder hardly misses; the first one stays for its share of the whole."""
    current = grown
    while len(current.effects) > 1:
        losses = {name: _loss(search, base, current, name) for name in current.effects}
        weakest = min(losses, key=lambda name: losses[name])
        less = search.without(current, weakest)
        if losses[weakest] >= KEEPS and less.cost - current.cost > _chance(base, less, current):
            break
        current = less
    return current


def _loss(search: Attempts, base: Hypothesis, at: Hypothesis, effect: str) -> float:
    """Factor by which the excess grows without an effect, `KEEPS` being enough; for a closed gap against chance."""
    less = search.without(at, effect)
    if closed(at):
        return KEEPS + _gain(search, at, effect) / (GAIN * at.remainder.inflation) - 1
    growth = less.remainder.excess - excess(at)
    if growth < SMALL * excess(base):
        return 0.0
    factor = less.remainder.excess / excess(at)
    large = growth > LARGE * excess(base)
    return factor * KEEPS / KEEPS_IF_LARGE if large else factor


def _gain(search: Attempts, at: Hypothesis, effect: str) -> float:
    return search.without(at, effect).cost - at.cost


def _enrich(search: Attempts, current: Hypothesis) -> Hypothesis:
    """Replace an effect by a richer one that contains it where the score test asks for what the richer one adds."""
    chance = GAIN * current.remainder.inflation
    for item in search.scores(current).ranking:
        inner = [name for name in item.effect.nested if name in current.effects]
        if inner and item.gain > chance:
            both = added(search.problem, current, search.scores(current), item, iterations=FINE)
            other = dropped(search.problem, both, inner[0])
            search.seen[other.key] = min(other, search.seen.get(other.key, other), key=lambda one: one.cost)
            if current.cost - other.cost > chance:
                return other
    return current


def _simplify(search: Attempts, base: Hypothesis, current: Hypothesis) -> Hypothesis:
    """Replace an effect by a simpler one that it contains where that explains as much.

    While something else is left, a richer form may only be making up for that, and has to add more.
    """
    explained = base.remainder.chi2 - current.remainder.chi2
    for name in current.effects:
        for simpler in search.library[name].nested:
            if simpler not in search.library or simpler in current.effects:
                continue
            less = search.without(current, name)
            item = next((s for s in search.scores(less).ranking if s.effect.name == simpler), None)
            if item is None:
                continue
            other = search.with_one(less, search.scores(less), item)
            share = CONTAINED_WHEN_CLOSED if closed(current) else CONTAINED
            worth = max(GAIN * current.remainder.inflation, share * explained)
            alike = closed(other) if closed(current) else excess(other) < SLOW * excess(current)
            if other.cost - current.cost < worth and alike:
                return _simplify(search, base, other)
    return current
