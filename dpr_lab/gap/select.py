"""Which effects: sets of up to four, grown, pruned and swapped, judged by how they predict releases left out.

Forward alone is greedy and takes the plausible twin first. So two sets are carried forward, every effect is tried as a
later one too, and what was found is pruned, swapped and simplified before it is believed:

    begin     a gap far above the noise is looked at in short segments first
    grow      the score test names candidates, the best are fitted, the two best sets go on
    leanest   a smaller set that was passed on the way and explains nearly as much is taken instead
    prune     an effect without which the remainder hardly grows is dropped
    enrich    an effect gives way to a richer one that contains it
    simplify  an effect gives way to a simpler one that it contains and that explains as much
    exchange  while something is left, another effect is tried in the place of each
    withdraw  an effect that makes one release harder to predict from the others is not named
    own       while something is left, an effect that only makes up for another form of the rest is not named
    overtake  a set no larger that turns out better while rivals are fitted takes its place
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from dpr_lab.effects.effect import Effect
from dpr_lab.gap.attempts import FINE, Attempts
from dpr_lab.gap.forms import own_share
from dpr_lab.gap.grow import grow, leanest
from dpr_lab.gap.hypothesis import Hypothesis, added, dropped
from dpr_lab.gap.problem import Problem
from dpr_lab.gap.score import Scores, imitation
from dpr_lab.gap.worth import DECISIVE, GAIN, IN_DOUBT, SLOW, chance, closed, doubt, excess, far, need

REVISIONS = 3  # times that a choice may be taken back for what was found while it was examined
SWAPPED = 2  # candidates that are tried in the place of each effect
CONTAINED = 0.003  # share of the explained excess that a richer form of an effect must add while something is left
OWN = 0.15  # share of what an effect explains that no other form of the rest explains, while something is left
OPEN = 0.5  # share of the gap that the rest must not leave open then
TWIN_COSINE = 0.999
"""Of the signatures of two effects above which a recording hardly tells them apart."""


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
    begun = _begun_short(search, max_effects) if far(base) else base
    grown = leanest(search, grow(search, begun, max_effects))
    chosen = _simplify(search, _enrich(search, _prune(search, grown)))
    chosen = _prune(search, _exchange(search, chosen))
    chosen = search.settled(_with_own_part(search, _withdraw(search, chosen)))
    found = _selection(search, chosen)
    for _ in range(REVISIONS):
        better = _overtaken(search, chosen)
        if better is None:
            break
        chosen = search.settled(_with_own_part(search, _prune(search, better)))
        found = _selection(search, chosen)
    return found


def _begun_short(search: Attempts, max_effects: int) -> Hypothesis:
    """The set that short segments ask for: a gap far above the noise bends longer ones beyond what a fit can follow."""
    near = search.on_short()
    found = leanest(near, grow(near, near.bare, max_effects))
    found = _simplify(near, _prune(near, found))
    carried = search.carried_over(found) if found.effects else search.bare
    return min(carried, search.bare, key=lambda item: item.cost)


def _overtaken(search: Attempts, chosen: Hypothesis) -> Hypothesis | None:
    """A set no larger that turned out to explain more, while twins were compared and sets taken apart."""
    rivals = [item for item in search.seen.values() if item.effects and len(item.effects) <= len(chosen.effects)]
    best = min(rivals, key=lambda item: item.cost, default=chosen)
    found = chosen.cost - best.cost > chance(search.bare, chosen, best) and best.key != chosen.key
    return best if found and closed(best) >= closed(chosen) else None


def _withdraw(search: Attempts, chosen: Hypothesis) -> Hypothesis:
    """Without effects that make a release harder to predict from the others than it was without them."""
    tolerance = GAIN * chosen.remainder.inflation
    for name in chosen.effects:
        less = search.without(chosen, name)
        followed = excess(less) <= excess(search.bare)  # or its fit got lost, and foretells nothing
        if followed and (chosen.surprise - less.surprise > tolerance).any():
            return _withdraw(search, less)
    return chosen


def _with_own_part(search: Attempts, chosen: Hypothesis) -> Hypothesis:
    """While something is left: without effects that explain hardly more than another form of the rest would.

    One that leaves hardly anything of what it explains is no makeshift, and not asked.
    """
    if closed(chosen) or len(chosen.effects) < 2:
        return chosen
    least, rest = OWN, chosen
    for name in chosen.effects:
        less = search.without(chosen, name)
        if excess(less) > min(DECISIVE * excess(chosen), OPEN * excess(search.bare)):
            continue
        scores = search.scores(less)
        item = scores.of(name)
        if item is not None:
            share = own_share(search.problem, less, scores, item)
            least, rest = (share, less) if share < least else (least, rest)
    return chosen if rest is chosen else _with_own_part(search, rest)


def _selection(search: Attempts, chosen: Hypothesis) -> Selection:
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
    return Selection(search.bare, chosen, search.seen, search.scores(chosen), without, around, tuple(reversed(path)))


def _try_rivals(search: Attempts, less: Hypothesis, scores: Scores, name: str, chosen: Hypothesis) -> None:
    """Fit what the linear scores can hardly tell from an effect, or like better: all are compared as they fit."""
    own = scores.shaped[name][0]
    related = {name, *own.effect.nested}
    for item in scores.ranking:
        form = item.effect.name in related or name in item.effect.nested
        if not form and item.gain > 0 and imitation(scores, own, item) > TWIN_COSINE:
            search.unlocked(search.with_one(less, scores, item))
    for item in scores.ranking[:SWAPPED]:
        if item is not own and less.cost - item.gain < chosen.cost:
            search.with_one(less, scores, item)


def _exchange(search: Attempts, current: Hypothesis) -> Hypothesis:
    """While something is left: another in the place of each effect, or the same one in another shape."""
    if closed(current) or not current.effects:
        return current
    best = current
    for name in current.effects:
        less = search.without(current, name)
        scores = search.scores(less)
        if search.library[name].shapes:
            best = min(best, search.again(current, name), key=lambda item: item.cost)
        for item in scores.ranking[:SWAPPED]:
            if item.effect.name != name:
                best = min(best, search.with_one(less, scores, item), key=lambda one: one.cost)
    if excess(current) < SLOW * excess(best):
        return best if best.key == current.key else current
    return _exchange(search, best)


def _prune(search: Attempts, grown: Hypothesis) -> Hypothesis:
    """Drop, one by one, effects that the remainder hardly misses; the first one stays for its share of the whole."""
    current = grown
    while len(current.effects) > 1:
        fewer = [search.without(current, name) for name in current.effects]
        needs = [need(search.bare, current, less) for less in fewer]
        less = fewer[needs.index(min(needs))]
        if min(needs) >= 1 and less.cost - current.cost > chance(search.bare, less, current):
            break
        current = less
    return current


def _enrich(search: Attempts, current: Hypothesis) -> Hypothesis:
    """Replace an effect by a richer one that contains it where the score test asks for what the richer one adds."""
    chance = GAIN * current.remainder.inflation
    for item in search.scores(current).ranking:
        inner = [name for name in item.effect.nested if name in current.effects]
        if inner and item.gain > chance:
            both = added(search.problem, current, search.scores(current), item, iterations=FINE)
            other = dropped(search.problem, both, inner[0], search.bare)
            search.seen[other.key] = min(other, search.seen.get(other.key, other), key=lambda one: one.cost)
            if current.cost - other.cost > chance:
                return search.unlocked(other)
    return current


def _simplify(search: Attempts, current: Hypothesis) -> Hypothesis:
    """Replace an effect by a simpler one that it contains where that explains as much.

    While something else is left, a richer form may only be making up for that, and has to add more.
    """
    indistinct = doubt(search.bare, current, share=IN_DOUBT if closed(current) else CONTAINED)
    for name in current.effects:
        for simpler in search.library[name].nested:
            if simpler not in search.library or simpler in current.effects:
                continue
            other = search.replaced(current, name, simpler)
            if other is None:
                continue
            alike = closed(other) if closed(current) else excess(other) < SLOW * excess(current)
            if other.cost - current.cost < indistinct and alike:
                return _simplify(search, other)
    return current
