"""Collection of the fitted sets of effects, with their score tests.

The initial values of a fit come from several shapes of the last effect, from short segments, or from a set with one
effect more or fewer. The best fit of each set is stored. `restarts` repeats fits from other initial values. Each move
adds its fits and score tests to a copy of the collection, so that an earlier state of the search does not change. All
copies share the results of functions that depend only on their arguments.
"""

from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass, field, replace
from functools import reduce
from types import MappingProxyType

from dpr_lab.effects.effect import Effect
from dpr_lab.fitting.cut import carried
from dpr_lab.fitting.gauss_newton import GaussNewton, descend, fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.robust import relative_chi2
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, free_parameters, hypothesis
from dpr_lab.gap.hypothesis.imitation import substitute_curve
from dpr_lab.gap.hypothesis.refits import (
    PRELIMINARY,
    best_start,
    refit,
    refit_with,
    refit_without,
    settings_to_beat,
    shaped,
)
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest, score_test
from dpr_lab.gap.screen.recordings import LENGTHS, Recordings
from dpr_lab.gap.which.effort import EFFORT
from dpr_lab.gap.which.sizes import off_axis, rises, significantly_oversized, springs_like_scale
from dpr_lab.progress import FitBegan, ScoreTestBegan

Progress = Callable[[FitBegan | ScoreTestBegan], None]

Arguments = tuple[Hypothesis] | tuple[Hypothesis, ScoreTest, Score] | tuple[Hypothesis, str, Score]
"""Arguments of a repeated fit, of the best shape of an additional effect, or of `restarts.replaced_linearly`."""


@dataclass(frozen=True, slots=True)
class FittedSets:
    """Fitted sets from which a move can choose, with functions that fit further sets."""

    recordings: Recordings
    problem: Problem
    library: Mapping[str, Effect]
    bare: Hypothesis
    """Model without effects."""
    on_progress: Progress = lambda event: None
    expected: frozenset[str] = frozenset()
    """Effects that the rig is known to have. They stay in the model even if they are hardly detectable."""
    held_out_chi2: Callable[[Hypothesis], float] | None = None
    """Function that returns the chi2 of a model, summed over the held-out runs; None without held-out runs."""
    _fits: dict[frozenset[str], Hypothesis] = field(default_factory=dict)
    _tests: dict[frozenset[str], ScoreTest] = field(default_factory=dict)
    _refitted_from: set[tuple[frozenset[str], frozenset[str]]] = field(default_factory=set)
    """Pairs of a smaller and a larger set of which the smaller one was fitted with initial values from the larger
    one."""
    _short: list["FittedSets"] = field(default_factory=list)
    """Collection for short segments, as the only element; empty until a move needs it."""
    results: dict[Arguments, Hypothesis] = field(default_factory=dict)
    """Fits by their arguments, so that no fit is repeated."""
    is_short: bool = False
    """Whether the problem consists of the short segments."""

    def __post_init__(self) -> None:
        self.keep(self.bare)

    @property
    def fits(self) -> Mapping[frozenset[str], Hypothesis]:
        """Best fit of every set that was fitted."""
        return MappingProxyType(self._fits)

    def copied(self) -> "FittedSets":
        """Return a copy to which a move adds its fits and score tests."""
        return replace(self, _fits=dict(self._fits), _tests=dict(self._tests))

    def from_bare(self, bare: Hypothesis) -> "FittedSets":
        """Return a copy that contains only a different fit of the bare model."""
        return replace(self, bare=bare, _fits={}, _tests={}, _refitted_from=set(), _short=[], results={})

    def keep(self, model: Hypothesis) -> Hypothesis:
        """Store a fit if it is the best of its set; return the best fit."""
        best = self._fits.get(model.key)
        if best is None or model.fit.chi2 <= best.fit.chi2:
            self._fits[model.key] = best = model
        return best

    def once(self, arguments: Arguments, result: Callable[[], Hypothesis]) -> Hypothesis:
        """Return the fit for the given arguments; it is computed once and then stored."""
        if arguments not in self.results:
            self.results[arguments] = result()
        return self.results[arguments]

    def possible(self, model: Hypothesis) -> bool:
        """Return whether the sizes and the gravity torque of a set are physically feasible."""
        return not (self.oversized(model) or rises(self.problem, model))

    def oversized(self, model: Hypothesis) -> tuple[str, ...]:
        """Return the effects of a set whose sizes are impossible or indicate another cause."""
        return (*significantly_oversized(model, self.problem.limits), *self.imitating(model))

    def imitating(self, model: Hypothesis) -> tuple[str, ...]:
        """Return the effects of a set whose sizes indicate another cause."""
        return (*off_axis(self.problem, model), *springs_like_scale(self.problem, self.library, model))

    def as_possible(self, model: Hypothesis, other: Hypothesis) -> bool:
        """Return whether a set is possible, or the other set is impossible as well."""
        return self.possible(model) or not self.possible(other)

    def unexpected(self, model: Hypothesis) -> list[str]:
        """Return the effects of a set that the rig is not known to have."""
        return [name for name in model.effects if name not in self.expected]

    def corrected_bare(self, model: Hypothesis) -> Hypothesis:
        """Return the bare model plus the effects that correct the rig file or time stamps.

        The contributions of the other effects are relative to the gap that remains with this model, because an error of
        the rig file may cause a gap a thousand times as large.
        """
        corrections = [name for name in model.effects if self.library[name].corrects]
        if not corrections:
            return self.bare
        return reduce(self.without, (name for name in model.effects if name not in corrections), model)

    def best_known(self, model: Hypothesis) -> Score | None:
        """Return the known effect with the largest positive score that a set does not contain, or None."""
        missing = self.expected - model.key
        test = self._tested(model, missing) if missing else self.test(model)
        return next((score for score in test.ranking if score.effect.name in missing and score.gain > 0), None)

    def test(self, model: Hypothesis) -> ScoreTest:
        """Return the score test of all effects that are not in a set."""
        return self._tested(model, self.library.keys() - model.key)

    def score(self, model: Hypothesis, effect: str) -> Score | None:
        """Return the best score of one further effect for a given set.

        The result is None if the effect has no score. An effect with shapes is tested together with all other effects,
        because `_from_shapes` compares their scores.
        """
        shapeless = effect in self.library and not self.library[effect].shapes
        return (self._tested(model, {effect}) if shapeless else self.test(model)).best_score(effect)

    def _tested(self, model: Hypothesis, effects: Set[str]) -> ScoreTest:
        """Return the score test of a set that contains at least the given effects.

        A previous test that lacks some of these effects is repeated with all effects, for the same fit.
        """
        test = self._tests.get(model.key)
        chance = model.chance
        outdated = test is not None and test.fit.chi2 - model.fit.chi2 > chance
        if test is None or outdated or not effects <= test.tested:
            self.on_progress(ScoreTestBegan(model.effects))
            fitted = model.fit if test is None or outdated else test.fit
            tested = effects if test is None else effects | test.tested
            library = [effect for name, effect in self.library.items() if name in tested]
            self._tests[model.key] = test = score_test(self.problem, fitted, library, self.recordings.properties)
        return test

    def with_one(self, model: Hypothesis, score: Score) -> Hypothesis:
        """Fit a set with one additional effect.

        If chi2 decreases far less than predicted, the set is also fitted with initial values from short segments.
        """
        key = model.key | {score.effect.name}
        if key in self._fits:
            return self._fits[key]
        self.on_progress(FitBegan(tuple(sorted(key))))
        larger = self._best_shape(model, score)
        failed = model.far_from_noise and model.fit.chi2 - larger.fit.chi2 < EFFORT.achieved * score.gain
        if failed and not self.is_short:
            larger = min(larger, self._from_short_segments(model, score, settings_to_beat(larger)), key=_chi2)
        return self.keep(larger)

    def _from_short_segments(self, model: Hypothesis, score: Score, settings: GaussNewton) -> Hypothesis:
        """Fit one additional effect to short segments, then to full segments."""
        short_sets = self.on_short()
        start = shaped(model, score).changed(initial=short_sets.bare.estimate.initial)
        near = descend(short_sets.problem, start, score.free, iterations=EFFORT.short, settings=PRELIMINARY).estimate
        states = carried(short_sets.problem.segments, near.initial, self.problem.segments, model.estimate.initial)
        names = (*model.effects, score.effect.name)
        return refit(self.problem, near.changed(initial=states), names, EFFORT.short, settings=settings)

    def _best_shape(self, model: Hypothesis, score: Score) -> Hypothesis:
        """Fit one additional effect, from its best shape or from several of its best shapes.

        `score` belongs to the current score test of the set.
        """
        test = self._tests[model.key]
        return self.once((model, test, score), lambda: self._from_shapes(model, test, score))

    def _from_shapes(self, model: Hypothesis, test: ScoreTest, score: Score) -> Hypothesis:
        leading = score.gain > EFFORT.leading * test.ranking[0].gain
        starts = test.shaped[score.effect.name][: EFFORT.starts if leading else 1]
        if score.effect.event or len(starts) == 1:
            return refit_with(self.problem, model, test, score, EFFORT.rough if model.far_from_noise else EFFORT.fine)
        best = best_start(self.problem, model, test, starts, EFFORT.preview)
        return refit_with(self.problem, model, test, score, EFFORT.thorough, best)

    def on_short(self) -> "FittedSets":
        """Return the collection for short segments, in which the readings depend more linearly on the effects.

        At first, it contains only the bare model. Copies of `FittedSets` share one such collection.
        """
        if not self._short:
            cut, initial = self.recordings.cut(LENGTHS.first)
            start = self.bare.estimate.changed(initial=initial)
            bare = hypothesis(cut, (), fit(cut, start, free_parameters(start, (), cut), iterations=EFFORT.fine))
            self._short.append(
                FittedSets(self.recordings, cut, self.library, bare, self.on_progress, self.expected, is_short=True)
            )
        return self._short[0]

    def without_substitute(self, model: Hypothesis, effect: str) -> Hypothesis:
        """Fit a set without one effect, and without a curve that would imitate the removed effect."""
        smaller = self.without(model, effect)
        curve = substitute_curve(model, smaller)
        return smaller if curve is None else self.without(smaller, curve)

    def predictive(self, model: Hypothesis) -> Hypothesis:
        """Return the set without the effects that worsen the prediction of held-out runs.

        The worst effect is removed first.
        """
        if self.held_out_chi2 is None or len(model.effects) < 2:
            return model
        best = min((self.without_substitute(model, name) for name in model.effects), key=self.held_out_chi2)
        return self.predictive(best) if self.held_out_chi2(best) < self.held_out_chi2(model) else model

    def without(self, model: Hypothesis, effect: str) -> Hypothesis:
        """Fit a set without one effect, with initial values from a larger and from a smaller set.

        The better of the two fits is returned.
        """
        key = model.key - {effect}
        if key in self._fits and not self._stuck(self._fits[key], model):
            return self._fits[key]
        self.on_progress(FitBegan(tuple(sorted(key))))
        smaller = refit_without(self.problem, model, effect, self.bare)
        self._refitted_from.add((key, model.key))
        parents = [self._fits[key - {name}] for name in sorted(key) if key - {name} in self._tests]
        if parents and not smaller.at_noise_floor:
            parent = min(parents, key=lambda parent_model: parent_model.cost)
            (name,) = key - parent.key
            if (score := self.score(parent, name)) is not None:
                smaller = min(smaller, self._best_shape(parent, score), key=_chi2)
        return self.keep(smaller)

    def _stuck(self, smaller: Hypothesis, model: Hypothesis) -> bool:
        """Return whether a few segments keep the fit of a smaller set in a local minimum.

        This is assumed if the fit of a larger set reduces the chi2 of such a segment to less than half.
        """
        if (smaller.key, model.key) in self._refitted_from or smaller.at_noise_floor:
            return False
        previous, current = relative_chi2(smaller.fit), relative_chi2(model.fit)
        return bool(((previous > EFFORT.outstanding) & (current < 0.5 * previous)).any())


def _chi2(model: Hypothesis) -> float:
    return model.fit.chi2
