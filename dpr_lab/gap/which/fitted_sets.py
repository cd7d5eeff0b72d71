"""Sets of effects and their fits, each made once, with the ways out of local minima.

A fit far from the noise may end where a few or long segments hold it. So an effect is started from several shapes,
from short segments, from the set above and from the set below, and the best of these counts. A set that is fitted
again keeps the better fit. Each move fits in a copy of its own, so that no fit reaches an earlier state of the search.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

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
    free_parameters,
    hypothesis,
    refit_with,
    refit_with_from_short,
    refit_without,
    started_with,
)
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest, score_test
from dpr_lab.gap.hypothesis.steps import recorded
from dpr_lab.gap.hypothesis.thresholds import at_noise_floor, far_from_noise
from dpr_lab.gap.screen.recordings import LENGTHS, Recordings
from dpr_lab.progress import FitBegan, ScoreTestBegan

Progress = Callable[[FitBegan | ScoreTestBegan], None]


@dataclass(frozen=True, slots=True)
class Effort:
    """Number of candidates that are fitted for each set."""

    rough: int = 6
    """Iterations of a fit far from the noise."""
    fine: int = 15
    """Iterations of one near it."""
    preview: int = 3
    """Iterations from each of several shapes, of which the best goes on."""
    thorough: int = 30
    """Iterations from the best of several shapes."""
    short: int = 12
    """Iterations from short segments."""
    achieved: float = 0.5
    """Share of the predicted fall of chi2 below which a fit is tried again from shorter segments."""
    starts: int = 4
    """Shapes from which an effect with several of them is fitted."""
    leading: float = 0.5
    """Share of the best score from which several shapes are worth a fit."""


EFFORT = Effort()


@dataclass(frozen=True, slots=True)
class FittedSets:
    """The sets of effects that one move has before it, and the ways to fit more."""

    recordings: Recordings
    problem: Problem
    library: Mapping[str, Effect]
    bare: Hypothesis
    """The model without effects."""
    on_progress: Progress
    expected: frozenset[str] = frozenset()
    """Effects that the rig is known to have, large or small: no recording need show them."""
    unseen_chi2: Callable[[Hypothesis], float] | None = None
    """Sum of chi2 on runs held out; none where there are none."""
    _fits: dict[frozenset[str], Hypothesis] = field(default_factory=dict)
    _tests: dict[frozenset[str], ScoreTest] = field(default_factory=dict)
    _short: list[tuple[Problem, NDArray[np.float64]]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.keep(self.bare)

    @property
    def fits(self) -> Mapping[frozenset[str], Hypothesis]:
        """Every set that was fitted, with its best fit."""
        return MappingProxyType(self._fits)

    @property
    def tests(self) -> Mapping[frozenset[str], ScoreTest]:
        """The score tests on them."""
        return MappingProxyType(self._tests)

    def resumed(
        self, fits: Mapping[frozenset[str], Hypothesis], tests: Mapping[frozenset[str], ScoreTest]
    ) -> "FittedSets":
        """The same recordings and library with a copy of other fits and score tests."""
        return replace(self, _fits=dict(fits), _tests=dict(tests))

    def keep(self, model: Hypothesis) -> Hypothesis:
        """Store a fit if it is the best of its set; return the best."""
        best = self._fits.get(model.key)
        if best is None or model.fit.chi2 <= best.fit.chi2:
            self._fits[model.key] = best = model
        return best

    def unexpected(self, model: Hypothesis) -> list[str]:
        """Effects of a set that only the recordings speak for."""
        return [name for name in model.effects if name not in self.expected]

    def start(self) -> Hypothesis:
        """The bare model with what the rig is known to have and these recordings show, the largest score first."""
        model = self.bare
        while scores := [
            score for score in self.test(model).ranking if score.effect.name in self.expected and score.gain > 0
        ]:
            model = self.with_one(model, scores[0])
        return self.escaped(model) if model.effects else model

    def test(self, model: Hypothesis) -> ScoreTest:
        """The score test of further effects on a set."""
        if model.key not in self._tests:
            self.on_progress(ScoreTestBegan(model.effects))
            others = [effect for name, effect in self.library.items() if name not in model.effects]
            known = recorded(self.recordings.records, self.problem, model.fit)
            self._tests[model.key] = score_test(self.problem, model.fit, others, known)
        return self._tests[model.key]

    def with_one(self, model: Hypothesis, score: Score) -> Hypothesis:
        """A set with one effect more, from shorter segments too where chi2 falls far less than its score predicts."""
        key = model.key | {score.effect.name}
        if key in self._fits:
            return self._fits[key]
        self.on_progress(FitBegan(tuple(sorted(key))))
        larger = self._best_shape(model, score)
        if far_from_noise(model) and model.fit.chi2 - larger.fit.chi2 < EFFORT.achieved * score.gain:
            from_short = refit_with_from_short(self.problem, self.short(), model, score, EFFORT.short)
            larger = min(larger, from_short, key=_chi2)
        return self.keep(larger)

    def _best_shape(self, model: Hypothesis, score: Score) -> Hypothesis:
        """Fit from the best shape; where there are several, from the best few."""
        test = self.test(model)
        leading = score.gain > EFFORT.leading * test.ranking[0].gain
        starts = test.shaped[score.effect.name][: EFFORT.starts if leading else 1]
        if score.effect.event or len(starts) == 1:
            return refit_with(self.problem, model, test, score, EFFORT.rough if far_from_noise(model) else EFFORT.fine)
        previews = [started_with(self.problem, model, test, start, EFFORT.preview) for start in starts]
        best = min(previews, key=lambda preview: preview.chi2)
        return refit_with(self.problem, model, test, score, EFFORT.thorough, best)

    def short(self) -> tuple[Problem, NDArray[np.float64]]:
        """The same recordings in short segments, with their initial states."""
        if not self._short:
            self._short.append(self.recordings.cut(LENGTHS.first))
        return self._short[0]

    def on_short(self) -> "FittedSets":
        """Sets fitted to short segments, which effects bend less."""
        cut, initial = self.short()
        start = self.bare.fit.estimate.changed(initial=initial)
        bare = hypothesis(cut, (), fit(cut, start, free_parameters(start, (), cut), iterations=EFFORT.fine))
        return FittedSets(self.recordings, cut, self.library, bare, self.on_progress, self.expected)

    def carried_over(self, short: Hypothesis) -> Hypothesis:
        """A set that was fitted to short segments, fitted to these."""
        long = self._lengthened(short.fit, self.bare.fit.estimate.initial, iterations=2 * EFFORT.fine)
        return self.escaped(hypothesis(self.problem, short.effects, long))

    def _lengthened(self, near: Fit, initial: NDArray[np.float64], iterations: int) -> Fit:
        """A fit in short segments carried on to these; they begin at `initial` where the short ones say nothing."""
        cut, _ = self.short()
        initial_states = carried(cut.segments, near.estimate.initial, self.problem.segments, initial)
        return fit(self.problem, near.estimate.changed(initial=initial_states), near.free, iterations=iterations)

    def escaped(self, model: Hypothesis) -> Hypothesis:
        """The same set, tried once more where a few segments, or long ones, may hold it at a local minimum."""
        if not at_noise_floor(model):
            model = self._better(without_outstanding(self.problem, model.fit), model)
        if not at_noise_floor(model) and model.effects:
            cut, initial = self.short()
            start = model.fit.estimate.changed(initial=initial)
            near = fit(cut, start, model.fit.free, iterations=EFFORT.rough)
            long = self._lengthened(near, model.fit.estimate.initial, iterations=EFFORT.fine)
            model = self._better(without_outstanding(self.problem, long), model)
        return self.keep(model)

    def _better(self, other: Fit, model: Hypothesis) -> Hypothesis:
        """The set of `model` with the better of the two fits."""
        return hypothesis(self.problem, model.effects, other) if other.chi2 < model.fit.chi2 else model

    def without(self, model: Hypothesis, effect: str) -> Hypothesis:
        """The better of the fits from above and, where a score test leads to the set, from below."""
        key = model.key - {effect}
        if key in self._fits:
            return self._fits[key]
        self.on_progress(FitBegan(tuple(sorted(key))))
        smaller = refit_without(self.problem, model, effect, self.bare)
        parents = [self._fits[key - {name}] for name in sorted(key) if key - {name} in self._tests]
        if parents and not at_noise_floor(smaller):
            parent = min(parents, key=lambda one: one.cost)
            (name,) = key - parent.key
            smaller = min(smaller, self._grown(parent, name) or smaller, key=_chi2)
        return self.keep(smaller)

    def replaced(self, model: Hypothesis, effect: str, other: str) -> Hypothesis | None:
        """The set with another effect replacing one, started without either and with both; None if it has no score.

        Of two related effects the one takes over what the other explains, where a fit from neither may get lost.
        """
        less = self.without(model, effect)
        score = self.test(less).of(other)
        if score is None:
            return None
        replaced = self.with_one(less, score)
        if at_noise_floor(model) and not at_noise_floor(replaced):
            score = self.test(model).of(other)
            if score is not None:
                both = refit_with(self.problem, model, self.test(model), score, iterations=0)
                return self.keep(refit_without(self.problem, both, effect, self.bare))
        return replaced

    def _grown(self, model: Hypothesis, effect: str) -> Hypothesis | None:
        score = self.test(model).of(effect)
        return None if score is None else self._best_shape(model, score)

    def reshaped(self, model: Hypothesis, effect: str) -> Hypothesis:
        """A set fitted once more, after a new search for the shape of one of its effects."""
        other = self._grown(self.without(model, effect), effect)
        return self.keep(model if other is None or other.cost >= model.cost else other)

    def converged(self, model: Hypothesis) -> Hypothesis:
        """A set fitted to the end where it was only fitted roughly, without effects that came out as nothing."""
        model = self._fits[model.key]
        if model.effects and not model.fit.converged:
            done = fit(self.problem, model.fit.estimate, model.fit.free, iterations=2 * EFFORT.fine)
            model = self.keep(hypothesis(self.problem, model.effects, done))
        present = tuple(name for name in model.effects if name in named_params(model.fit.estimate.params))
        if len(present) == len(model.effects):
            return model
        free = free_parameters(model.fit.estimate, present, self.problem)
        less = fit(self.problem, model.fit.estimate, free, iterations=EFFORT.fine)
        return self.keep(hypothesis(self.problem, present, less))


def _chi2(model: Hypothesis) -> float:
    return model.fit.chi2
