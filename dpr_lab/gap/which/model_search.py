"""The search's memory: sets of effects and their fits, each made once, with the ways out of local minima.

A fit far from the noise may end where a few or long segments hold it. So an effect is started from several shapes,
from short segments, from the set above and from the set below, and the best of these counts.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects import named_params
from dpr_lab.effects.effect import Effect
from dpr_lab.fitting.cut import carried
from dpr_lab.fitting.gauss_newton import Fit, fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.robust import without_outstanding
from dpr_lab.gap.hypothesis.hypothesis import (
    Hypothesis,
    begun_with,
    free_parameters,
    hypothesis,
    refit_with,
    refit_with_from_short,
    refit_without,
)
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest, score_test
from dpr_lab.gap.hypothesis.steps import recorded
from dpr_lab.gap.hypothesis.thresholds import at_noise_floor, far_from_noise
from dpr_lab.gap.screen.recordings import LENGTHS, Recordings
from dpr_lab.progress import FitBegan, ScoreTestBegan

Progress = Callable[[FitBegan | ScoreTestBegan], None]


@dataclass(frozen=True, slots=True)
class Effort:
    """How much is tried of each set."""

    rough: int = 6
    """Iterations of a fit far from the noise."""
    fine: int = 15
    """Iterations of one near it."""
    glimpse: int = 3
    """Iterations from each of several shapes, of which the best goes on."""
    thorough: int = 30
    """Iterations from the best of several shapes."""
    short: int = 12
    """Iterations from short segments."""
    kept_promise: float = 0.5
    """Share of the promised fall of chi2 below which a fit is tried again from shorter segments."""
    starts: int = 4
    """Shapes from which an effect with several of them is fitted."""
    leading: float = 0.5
    """Share of the best score from which several shapes are worth a fit."""


EFFORT = Effort()


@dataclass(slots=True)
class ModelSearch:
    """Every set of effects that was fitted, every score test that was made, and the ways to make more."""

    recordings: Recordings
    problem: Problem
    library: Mapping[str, Effect]
    fitted: dict[frozenset[str], Hypothesis]
    tested: dict[frozenset[str], ScoreTest]
    on_progress: Progress
    expected: frozenset[str] = frozenset()
    """Effects that the rig is known to have, large or small: no recording need speak for them."""
    unseen_chi2: Callable[[Hypothesis], float] | None = None
    """Sum of chi2 on runs held out; none where there are none."""
    shorter: tuple[Problem, NDArray[np.float64]] | None = None

    @property
    def bare(self) -> Hypothesis:
        """The model without effects."""
        return self.fitted[frozenset()]

    def unexpected(self, at: Hypothesis) -> list[str]:
        """Effects of a set that nothing but the recordings speaks for."""
        return [name for name in at.effects if name not in self.expected]

    def start(self) -> Hypothesis:
        """The bare model with what the rig is known to have and these recordings show, the most telling first."""
        at = self.bare
        while scores := [item for item in self.test(at).ranking if item.effect.name in self.expected and item.gain > 0]:
            at = self.with_one(at, scores[0])
        return self.escaped(at) if at.effects else at

    def test(self, at: Hypothesis) -> ScoreTest:
        """The score test of further effects on a set."""
        if at.key not in self.tested:
            self.on_progress(ScoreTestBegan(at.effects))
            others = [effect for name, effect in self.library.items() if name not in at.effects]
            known = recorded(self.recordings.records, self.problem, at.fit)
            self.tested[at.key] = score_test(self.problem, at.fit, others, known)
        return self.tested[at.key]

    def with_one(self, at: Hypothesis, item: Score) -> Hypothesis:
        """A set with one effect more, from shorter segments too where the score test promised more than came of it."""
        key = at.key | {item.effect.name}
        if key not in self.fitted:
            self.on_progress(FitBegan(tuple(sorted(key))))
            found = self._best_shape(at, item)
            if far_from_noise(at) and at.fit.chi2 - found.fit.chi2 < EFFORT.kept_promise * item.gain:
                again = refit_with_from_short(self.problem, self.short(), at, item, EFFORT.short)
                found = min(found, again, key=_chi2)
            self.fitted[key] = found
        return self.fitted[key]

    def _best_shape(self, at: Hypothesis, item: Score) -> Hypothesis:
        """Fit from the best shape; where there are several, from the best few."""
        test = self.test(at)
        leading = item.gain > EFFORT.leading * test.ranking[0].gain
        starts = test.shaped[item.effect.name][: EFFORT.starts if leading else 1]
        if item.effect.event or len(starts) == 1:
            return refit_with(self.problem, at, test, item, EFFORT.rough if far_from_noise(at) else EFFORT.fine)
        glimpses = [begun_with(self.problem, at, test, start, EFFORT.glimpse) for start in starts]
        best = min(glimpses, key=lambda glimpse: glimpse.chi2)
        return refit_with(self.problem, at, test, item, EFFORT.thorough, best)

    def short(self) -> tuple[Problem, NDArray[np.float64]]:
        """The same recordings in short segments, and initial states to begin with."""
        if self.shorter is None:
            self.shorter = self.recordings.cut(LENGTHS.first)
        return self.shorter

    def on_short(self) -> "ModelSearch":
        """A search of its own in short segments; effects bend those less."""
        cut, initial = self.short()
        at = self.bare.fit.estimate.changed(initial=initial)
        bare = hypothesis(cut, (), fit(cut, at, free_parameters(at, (), cut), iterations=EFFORT.fine))
        return ModelSearch(self.recordings, cut, self.library, {bare.key: bare}, {}, self.on_progress, self.expected)

    def carried_over(self, found: Hypothesis) -> Hypothesis:
        """A set that was found in short segments, fitted to these."""
        long = self._lengthened(found.fit, self.bare.fit.estimate.initial, iterations=2 * EFFORT.fine)
        self.fitted[found.key] = hypothesis(self.problem, found.effects, long)
        return self.escaped(self.fitted[found.key])

    def _lengthened(self, near: Fit, initial: NDArray[np.float64], iterations: int) -> Fit:
        """A fit in short segments carried on to these; they begin at `initial` where the short ones say nothing."""
        cut, _ = self.short()
        initial_states = carried(cut.segments, near.estimate.initial, self.problem.segments, initial)
        return fit(self.problem, near.estimate.changed(initial=initial_states), near.free, iterations=iterations)

    def escaped(self, at: Hypothesis) -> Hypothesis:
        """The same set, tried once more where a few segments, or long ones, may hold it at a local minimum."""
        if not at_noise_floor(at):
            at = self._better(without_outstanding(self.problem, at.fit), at)
        if not at_noise_floor(at) and at.effects:
            cut, initial = self.short()
            near = fit(cut, at.fit.estimate.changed(initial=initial), at.fit.free, iterations=EFFORT.rough)
            long = self._lengthened(near, at.fit.estimate.initial, iterations=EFFORT.fine)
            at = self._better(without_outstanding(self.problem, long), at)
        self.fitted[at.key] = at
        return at

    def _better(self, found: Fit, before: Hypothesis) -> Hypothesis:
        """The set of `before` with the better of the two fits."""
        return hypothesis(self.problem, before.effects, found) if found.chi2 < before.fit.chi2 else before

    def without(self, at: Hypothesis, effect: str) -> Hypothesis:
        """The better of the fits from above and, where a score test points to the set, from below."""
        key = at.key - {effect}
        if key not in self.fitted:
            self.on_progress(FitBegan(tuple(sorted(key))))
            found = refit_without(self.problem, at, effect, self.bare)
            parents = [self.fitted[key - {name}] for name in key if key - {name} in self.tested]
            if parents and not at_noise_floor(found):
                parent = min(parents, key=lambda one: one.cost)
                (name,) = key - parent.key
                found = min(found, self._grown(parent, name) or found, key=_chi2)
            self.fitted[key] = found
        return self.fitted[key]

    def replaced(self, at: Hypothesis, effect: str, other: str) -> Hypothesis | None:
        """The set with another effect replacing one, started without either and with both; None if it has no score.

        Of two related effects the one takes over what the other explains, where a fit from neither may get lost.
        """
        less = self.without(at, effect)
        item = self.test(less).of(other)
        if item is None:
            return None
        found = self.with_one(less, item)
        if at_noise_floor(at) and not at_noise_floor(found):
            score = self.test(at).of(other)
            if score is not None:
                both = refit_with(self.problem, at, self.test(at), score, iterations=0)
                found = min(found, refit_without(self.problem, both, effect, self.bare), key=_chi2)
                self.fitted[found.key] = found
        return found

    def _grown(self, at: Hypothesis, effect: str) -> Hypothesis | None:
        item = self.test(at).of(effect)
        return None if item is None else self._best_shape(at, item)

    def again(self, at: Hypothesis, effect: str) -> Hypothesis:
        """A set fitted once more, after a new search for the shape of one of its effects."""
        other = self._grown(self.without(at, effect), effect)
        if other is not None and other.cost < self.fitted[at.key].cost:
            self.fitted[at.key] = other
        return self.fitted[at.key]

    def converged(self, at: Hypothesis) -> Hypothesis:
        """A set fitted to the end where it was only fitted roughly, without effects that came out as nothing."""
        if at.effects and not at.fit.converged:
            done = fit(self.problem, at.fit.estimate, at.fit.free, iterations=2 * EFFORT.fine)
            self.fitted[at.key] = hypothesis(self.problem, at.effects, done)
        at = self.fitted[at.key]
        present = tuple(name for name in at.effects if name in named_params(at.fit.estimate.params))
        if len(present) < len(at.effects):
            free = free_parameters(at.fit.estimate, present, self.problem)
            less = fit(self.problem, at.fit.estimate, free, iterations=EFFORT.fine)
            at = hypothesis(self.problem, present, less)
            self.fitted[at.key] = min(at, self.fitted.get(at.key, at), key=lambda one: one.cost)
        return self.fitted[at.key]


def _chi2(item: Hypothesis) -> float:
    return item.fit.chi2
