"""Which effects: sets of up to `max_effects`, grown, pruned and swapped, judged by how they predict held-out runs.

Theory of operation. Forward alone is greedy and takes the plausible twin first. So two sets are carried forward, every
effect is tried as a later one too, and what was found is pruned, swapped and simplified before it is believed. Every
set is fitted once and remembered (`ModelSearch`); every step below asks for sets by what is to be in them.

    begin     a gap far above the noise is looked at in short segments first
    grow      the score test names candidates, the best are fitted, the two best sets go on
    leanest   a smaller set that was passed on the way and explains nearly as much is taken instead
    prune     an effect without which the excess hardly grows is dropped
    enrich    an effect gives way to a richer one that contains it
    simplify  an effect gives way to a simpler one that it contains and that explains as much
    exchange  while something is left, another effect is tried in the place of each
    withdraw  an effect that makes one run harder to predict from the others, or those held out, is not named
    own part  while something is left, an effect that only makes up for another form of the rest is not named
    overtake  a set no larger that turns out better while alternatives are fitted takes its place
    again     if the bare model turns out to have been held at a local minimum, all of this once more from a better one
    plausible of two effects that no recording here can distinguish, the one of the far more plausible size is named

Costs count in chi2; how much of it is one piece of independent evidence, and what falls of it mean, is in `thresholds`.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import reduce

from dpr_lab.effects import plausibility
from dpr_lab.effects.effect import Effect
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, refit_with, refit_without
from dpr_lab.gap.hypothesis.score_test import ScoreTest
from dpr_lab.gap.hypothesis.thresholds import (
    THRESHOLDS,
    at_noise_floor,
    excess,
    far_from_noise,
    indifference,
    need,
    significance,
)
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.which.forms import own_share
from dpr_lab.gap.which.grow import grow, leanest
from dpr_lab.gap.which.model_search import EFFORT, ModelSearch, Progress
from dpr_lab.gap.which.selected import Selection

REVISIONS = 3
"""Times that a choice may be taken back for what was found while it was examined."""

SWAPPED = 2
"""Candidates that are tried in the place of each effect."""


def select(
    recordings: Recordings,
    problem: Problem,
    base: Hypothesis,
    library: Mapping[str, Effect],
    *,
    max_effects: int = 4,
    expected: Iterable[str] = (),
    unseen_chi2: Callable[[Hypothesis], float] | None = None,
    on_progress: Progress = lambda event: None,
) -> Selection:
    """Find the set of effects that explains the gap.

    Args:
        recordings: the runs
        problem: their segments
        base: the bare model, fitted
        library: effects to choose from
        max_effects: at most so many at once
        expected: those of the library that the rig is known to have
        unseen_chi2: sum of chi2 on runs held out, as a set predicts them; none where there are none
        on_progress: called with each fit and score test as it begins
    """
    chosen = _selected(recordings, problem, base, library, max_effects, expected, unseen_chi2, on_progress)
    bare = _base_again(problem, chosen)
    if bare is None:
        return chosen
    return _selected(recordings, problem, bare, library, max_effects, expected, unseen_chi2, on_progress)


def _base_again(problem: Problem, found: Selection) -> Hypothesis | None:
    """The bare model fitted from where the chosen set leads, if it was held at a local minimum; else None.

    An effect that only leads the fit out of such a minimum is no cause.
    """
    if not found.chosen.effects or not far_from_noise(found.base):
        return None
    bare = reduce(lambda at, name: refit_without(problem, at, name, found.base), found.chosen.effects, found.chosen)
    escaped = bare.fit.chi2 < found.base.fit.chi2 / THRESHOLDS.escaped
    return bare if escaped or (at_noise_floor(bare) and not at_noise_floor(found.base)) else None


def _selected(
    recordings: Recordings,
    problem: Problem,
    base: Hypothesis,
    library: Mapping[str, Effect],
    max_effects: int,
    expected: Iterable[str],
    unseen_chi2: Callable[[Hypothesis], float] | None,
    on_progress: Progress,
) -> Selection:
    known = frozenset(expected) & set(library)
    search = ModelSearch(recordings, problem, library, {base.key: base}, {}, on_progress, known, unseen_chi2)
    begun = _begun_short(search, max_effects) if far_from_noise(base) else search.start()
    grown = leanest(search, grow(search, begun, max_effects))
    chosen = _simplify(search, _enrich(search, _prune(search, grown)))
    chosen = _prune(search, _exchange(search, chosen))
    chosen = search.converged(_with_own_part(search, _drop_harmful(search, chosen)))
    found = _selection(search, chosen)
    for _ in range(REVISIONS):
        better = _overtaken(search, chosen)
        likelier = _more_plausible(search, found) if better is None else None
        if better is not None:
            chosen = search.converged(_with_own_part(search, _prune(search, better)))
        elif likelier is not None:
            chosen = search.converged(likelier)
        else:
            break
        found = _selection(search, chosen)
    return found


def _begun_short(search: ModelSearch, max_effects: int) -> Hypothesis:
    """The set that short segments ask for: a gap far above the noise bends longer ones beyond what a fit can follow."""
    near = search.on_short()
    found = leanest(near, grow(near, near.start(), max_effects, to_floor=True))
    found = _simplify(near, _prune(near, found))
    carried = search.carried_over(found) if found.effects else search.bare
    return min(carried, search.bare, key=lambda item: item.cost)


def _prune(search: ModelSearch, grown: Hypothesis) -> Hypothesis:
    """Drop, one by one, effects that are hardly missed; the first one stays for its share of the whole."""
    current = grown
    while len(current.effects) > 1 and (weighed := search.unexpected(current)):
        fewer = [search.without(current, name) for name in weighed]
        needs = [need(search.bare, current, less) for less in fewer]
        less = fewer[needs.index(min(needs))]
        if min(needs) >= 1 and less.cost - current.cost > significance(search.bare, less, current):
            break
        current = less
    return current


def _enrich(search: ModelSearch, current: Hypothesis) -> Hypothesis:
    """Replace an effect by a richer one that contains it where the score test asks for what the richer one adds."""
    chance = THRESHOLDS.chance * current.residuals.inflation
    test = search.test(current)
    for item in test.ranking:
        inner = [name for name in item.effect.nested if name in current.effects]
        if inner and item.gain > chance:
            both = refit_with(search.problem, current, test, item, iterations=EFFORT.fine)
            other = refit_without(search.problem, both, inner[0], search.bare)
            search.fitted[other.key] = min(other, search.fitted.get(other.key, other), key=_cost)
            if current.cost - other.cost > chance:
                return search.escaped(other)
    return current


def _simplify(search: ModelSearch, current: Hypothesis) -> Hypothesis:
    """Replace an effect by a simpler one that it contains where that explains as much.

    While something else is left, a richer form may only be making up for that, and has to add more.
    """
    closed = at_noise_floor(current)
    margin = indifference(search.bare, current, share=THRESHOLDS.integrator if closed else THRESHOLDS.contained)
    for name in current.effects:
        for simpler in search.library[name].nested:
            if simpler not in search.library or simpler in current.effects:
                continue
            other = search.replaced(current, name, simpler)
            if other is None:
                continue
            alike = at_noise_floor(other) if closed else excess(other) < THRESHOLDS.slow * excess(current)
            if other.cost - current.cost < margin and alike:
                return _simplify(search, other)
    return current


def _exchange(search: ModelSearch, current: Hypothesis) -> Hypothesis:
    """While something is left: another in the place of each effect, or the same one in another shape."""
    if at_noise_floor(current) or not current.effects:
        return current
    best = current
    for name in search.unexpected(current):
        less = search.without(current, name)
        if search.library[name].shapes:
            best = min(best, search.again(current, name), key=_cost)
        for item in search.test(less).ranking[:SWAPPED]:
            if item.effect.name != name:
                best = min(best, search.with_one(less, item), key=_cost)
    if excess(current) < THRESHOLDS.slow * excess(best):
        return best if best.key == current.key else current
    return _exchange(search, best)


def _drop_harmful(search: ModelSearch, chosen: Hypothesis) -> Hypothesis:
    """Without effects that make a run harder to predict from the others than it was without them."""
    tolerance = THRESHOLDS.chance * chosen.residuals.inflation
    for name in chosen.effects:
        less = search.without(chosen, name)
        followed = excess(less) <= excess(search.bare)  # or its fit got lost, and predicts nothing
        if followed and (chosen.predictive_loss - less.predictive_loss > tolerance).any():
            return _drop_harmful(search, less)
    return chosen


def _without_misleading(search: ModelSearch, chosen: Hypothesis) -> Hypothesis:
    """Without effects, the worst first, that make held-out runs harder to predict."""
    if search.unseen_chi2 is None or len(chosen.effects) < 2:
        return chosen
    fewer = [search.without(chosen, name) for name in chosen.effects]
    left = [search.unseen_chi2(item) for item in fewer]
    least = left.index(min(left))
    return _without_misleading(search, fewer[least]) if left[least] < search.unseen_chi2(chosen) else chosen


def _with_own_part(search: ModelSearch, chosen: Hypothesis) -> Hypothesis:
    """While something is left: without effects that explain hardly more than another form of the rest would.

    One that leaves hardly anything of what it explains is no makeshift, and not asked; nor may all that are dropped
    leave so much more than the best set that was found.
    """
    if at_noise_floor(chosen) or len(chosen.effects) < 2:
        return chosen
    closest = min(map(excess, search.fitted.values()))
    most = min(THRESHOLDS.keeps_if_small * closest, THRESHOLDS.still_open * excess(search.bare))
    least, rest = THRESHOLDS.own_share, chosen
    for name in search.unexpected(chosen):
        less = search.without(chosen, name)
        item = search.test(less).of(name) if excess(less) <= most else None
        if item is not None:
            share = own_share(search.problem, less, search.test(less), item)
            least, rest = (share, less) if share < least else (least, rest)
    return chosen if rest is chosen else _with_own_part(search, rest)


def _overtaken(search: ModelSearch, chosen: Hypothesis) -> Hypothesis | None:
    """A set no larger that turned out to explain more, while alternatives were compared and sets taken apart."""
    kept = chosen.key & search.expected
    others = [
        item
        for item in search.fitted.values()
        if item.effects and len(item.effects) <= len(chosen.effects) and kept <= item.key
    ]
    best = min(others, key=_cost, default=chosen)
    found = chosen.cost - best.cost > significance(search.bare, chosen, best) and best.key != chosen.key
    return best if found and at_noise_floor(best) >= at_noise_floor(chosen) else None


def _more_plausible(search: ModelSearch, found: Selection) -> Hypothesis | None:
    """The chosen set with an indistinguishable effect, of a far more plausible size, in the place of one."""
    chosen = found.chosen
    margin = indifference(search.bare, chosen)
    for name in search.unexpected(chosen):
        test, own = found.around[name], plausibility(chosen.fit.estimate.params, name)
        target = test.shaped[name][0]
        for item in test.ranking:
            other = search.fitted.get(found.without[name].key | {item.effect.name})
            if other is None or other.key == chosen.key or abs(other.cost - chosen.cost) > margin:
                continue
            alike = min(test.cosine(target, item), test.cosine(item, target)) > THRESHOLDS.indistinguishable
            likelier = plausibility(other.fit.estimate.params, item.effect.name) > THRESHOLDS.likelier * own
            if alike and likelier:
                return other
    return None


def _selection(search: ModelSearch, wanted: Hypothesis) -> Selection:
    chosen = _without_misleading(search, wanted)
    without = {name: search.without(chosen, name) for name in chosen.effects}
    around = {name: search.test(item) for name, item in without.items()}
    for name, test in around.items():
        _try_alternatives(search, without[name], test, name, chosen)
    path, at = [], chosen
    while at.effects:
        less = {name: search.without(at, name) for name in at.effects}
        weakest = min(less, key=lambda name: less[name].cost)
        path.append((weakest, at))
        at = less[weakest]
    last = search.test(chosen)
    misleading = tuple(name for name in wanted.effects if name not in chosen.effects)
    return Selection(
        search.bare, chosen, search.fitted, last, without, around, tuple(reversed(path)), search.expected, misleading
    )


def _try_alternatives(search: ModelSearch, less: Hypothesis, test: ScoreTest, name: str, chosen: Hypothesis) -> None:
    """Fit what the linear scores can hardly tell from an effect, or like better: all are compared as they fit."""
    own = test.shaped[name][0]
    related = {name, *own.effect.nested}
    for item in test.ranking:
        form = item.effect.name in related or name in item.effect.nested
        if not form and item.gain > 0 and test.cosine(own, item) > THRESHOLDS.indistinguishable:
            search.escaped(search.with_one(less, item))
    for item in test.ranking[:SWAPPED]:
        if item is not own and less.cost - item.gain < chosen.cost:
            search.with_one(less, item)


def _cost(item: Hypothesis) -> float:
    return item.cost
