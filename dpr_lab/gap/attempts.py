"""What was tried: sets of effects and their fits, each made once, with the ways out of local minima.

A fit far from the noise may end where a few segments, or long ones, hold it. So an effect is begun from several shapes,
from short segments, from the set above and from the set below, and the best of these counts.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import effect_values
from dpr_lab.effects.effect import Effect
from dpr_lab.gap.corrected import EVENTS
from dpr_lab.gap.hypothesis import Hypothesis, added, added_from_short, dropped, hypothesis, slots_of
from dpr_lab.gap.problem import FIRST_S, Problem, carried, problem
from dpr_lab.gap.score import Score, Scores, score
from dpr_lab.gap.shooting import Fit, fit, unlocked
from dpr_lab.gap.worth import closed, far

KEPT_PROMISE = 0.5  # share of the promised fall of chi2 below which a fit is tried again from shorter segments
ROUGH, FINE = 6, 15  # iterations of a fit, far from the noise and near it
STARTS = 4  # shapes from which an effect with several of them is fitted
LEADING = 0.5  # share of the best score from which several shapes are worth a fit


@dataclass(slots=True)
class Attempts:
    """Every set of effects that was fitted, every score test that was made, and the ways to make more."""

    problem: Problem
    library: Mapping[str, Effect]
    seen: dict[frozenset[str], Hypothesis]
    scored: dict[frozenset[str], Scores]
    on_step: Callable[[str], None]
    shorter: tuple[Problem, NDArray[np.float64]] | None = None

    @property
    def bare(self) -> Hypothesis:
        """The model without effects."""
        return self.seen[frozenset()]

    def scores(self, at: Hypothesis) -> Scores:
        """The score test beside a set."""
        if at.key not in self.scored:
            self.on_step(f"score test beside {', '.join(at.effects) or 'the bare model'}")
            self.scored[at.key] = score(
                self.problem, at.fit, [e for n, e in self.library.items() if n not in at.effects]
            )
        return self.scored[at.key]

    def with_one(self, at: Hypothesis, scores: Scores, item: Score) -> Hypothesis:
        """A set with one effect more, from shorter segments too where the score test promised more than came of it."""
        key = at.key | {item.effect.name}
        if key not in self.seen:
            self.on_step(f"fit {', '.join(sorted(key))}")
            fitted = self._best_shape(at, scores, item)
            if far(at) and at.fit.chi2 - fitted.fit.chi2 < KEPT_PROMISE * item.gain:
                again = added_from_short(self.problem, self.short(), at, item)
                fitted = min(fitted, again, key=lambda one: one.fit.chi2)
            self.seen[key] = fitted
        return self.seen[key]

    def short(self) -> tuple[Problem, NDArray[np.float64]]:
        """The same recordings in short segments, and start states to begin with."""
        if self.shorter is None:
            self.shorter = problem(self.problem.records, self.problem.rig, FIRST_S)
        return self.shorter

    def on_short(self) -> "Attempts":
        """A search of its own in short segments; effects bend those less."""
        cut, starts = self.short()
        point = replace(self.bare.fit.point, starts=starts)
        bare = hypothesis(cut, (), fit(cut, point, slots_of(point, (), cut), iterations=FINE))
        return Attempts(cut, self.library, {bare.key: bare}, {}, self.on_step)

    def carried_over(self, found: Hypothesis) -> Hypothesis:
        """A set that was found in short segments, fitted to these."""
        long = self._lengthened(found.fit, self.bare.fit.point.starts, iterations=2 * FINE)
        self.seen[found.key] = hypothesis(self.problem, found.effects, long)
        return self.unlocked(self.seen[found.key])

    def _lengthened(self, near: Fit, starts: NDArray[np.float64], iterations: int) -> Fit:
        """A fit in short segments carried on to these; `starts` begin where the short ones say nothing."""
        cut, _ = self.short()
        point = replace(near.point, starts=carried(cut, near.point, self.problem, starts))
        return fit(self.problem, point, near.slots, iterations=iterations)

    def _best_shape(self, at: Hypothesis, scores: Scores, item: Score) -> Hypothesis:
        """Fit from the best shape; where there are several, from the best few."""
        leading = item.gain > LEADING * scores.ranking[0].gain
        starts = scores.shaped[item.effect.name][: STARTS if leading else 1]
        if item.effect.name in EVENTS or len(starts) == 1:
            return added(self.problem, at, scores, item, iterations=ROUGH if far(at) else FINE)
        begun = [added(self.problem, at, scores, start, iterations=3) for start in starts]
        best = starts[min(range(len(begun)), key=lambda i: begun[i].fit.chi2)]
        return added(self.problem, at, scores, best, iterations=30)

    def unlocked(self, at: Hypothesis) -> Hypothesis:
        """The same set, tried once more where a few segments, or long ones, may hold it at a local minimum."""
        free = at if closed(at) else _better(self.problem, unlocked(self.problem, at.fit), at)
        if not closed(free) and at.effects:
            cut, starts = self.short()
            near = fit(cut, replace(free.fit.point, starts=starts), free.fit.slots, iterations=ROUGH)
            long = self._lengthened(near, free.fit.point.starts, iterations=FINE)
            free = _better(self.problem, unlocked(self.problem, long), free)
        self.seen[at.key] = free
        return free

    def without(self, at: Hypothesis, effect: str) -> Hypothesis:
        """The better of the fits from above and, where a score test points to the set, from below."""
        key = at.key - {effect}
        if key not in self.seen:
            self.on_step(f"fit {', '.join(sorted(key))}")
            fallen = dropped(self.problem, at, effect, self.bare)
            parents = [self.seen[key - {name}] for name in key if key - {name} in self.scored]
            if parents and not closed(fallen):
                parent = min(parents, key=lambda one: one.cost)
                (name,) = key - parent.key
                risen = self._grown(parent, name)
                fallen = min(fallen, risen, key=lambda one: one.fit.chi2) if risen.key == key else fallen
            self.seen[key] = fallen
        return self.seen[key]

    def replaced(self, at: Hypothesis, effect: str, other: str) -> Hypothesis | None:
        """The set with another effect in the place of one, begun without either and with both; None if it has no score.

        Of two related effects the one takes over what the other explains, where a fit from neither may get lost.
        """
        less = self.without(at, effect)
        item = self.scores(less).of(other)
        if item is None:
            return None
        found = self.with_one(less, self.scores(less), item)
        beside = self.scores(at).of(other) if closed(at) and not closed(found) else None
        if beside is not None:
            both = added(self.problem, at, self.scores(at), beside, iterations=0)
            found = min(found, dropped(self.problem, both, effect, self.bare), key=lambda one: one.fit.chi2)
            self.seen[found.key] = found
        return found

    def _grown(self, at: Hypothesis, effect: str) -> Hypothesis:
        scores = self.scores(at)
        item = scores.of(effect)
        return at if item is None else self._best_shape(at, scores, item)

    def again(self, at: Hypothesis, effect: str) -> Hypothesis:
        """A set fitted once more, with the shape of one of its effects looked for anew."""
        less = self.without(at, effect)
        other = self._grown(less, effect)
        if other.key == at.key and other.cost < self.seen[at.key].cost:
            self.seen[at.key] = other
        return self.seen[at.key]

    def settled(self, at: Hypothesis) -> Hypothesis:
        """A set fitted to the end where it was only fitted roughly, without effects that came out as nothing."""
        if at.effects and not at.fit.converged:
            done = fit(self.problem, at.fit.point, at.fit.slots, iterations=2 * FINE)
            self.seen[at.key] = hypothesis(self.problem, at.effects, done)
        at = self.seen[at.key]
        present = tuple(name for name in at.effects if name in effect_values(at.fit.point.vector))
        if len(present) < len(at.effects):
            point = at.fit.point
            less = fit(self.problem, point, slots_of(point, present, self.problem), iterations=FINE)
            at = hypothesis(self.problem, present, less)
            self.seen[at.key] = min(at, self.seen.get(at.key, at), key=lambda one: one.cost)
        return self.seen[at.key]


def _better(made: Problem, found: Fit, before: Hypothesis) -> Hypothesis:
    """The set of `before` with the better of the two fits."""
    return hypothesis(made, before.effects, found) if found.chi2 < before.fit.chi2 else before
