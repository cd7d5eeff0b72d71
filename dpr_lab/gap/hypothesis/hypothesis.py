"""One explanation of the gap: a set of effects, fitted with ratios and initial states, and its residual."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import EFFECTS, without_effect
from dpr_lab.effects.friction_drift import FRICTION_DRIFT
from dpr_lab.effects.limits import relative_size
from dpr_lab.fitting.cut import carried
from dpr_lab.fitting.estimate import (
    SCALE,
    Estimate,
    FreeParameter,
    effect_parameters,
    moved,
    ratio_parameters,
    visible_ratios,
    with_scale,
)
from dpr_lab.fitting.gauss_newton import Fit, GaussNewton, Iteration, descend, fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.cross_validation import folds, predictive_loss
from dpr_lab.gap.hypothesis.residuals import ResidualStatistics, residual_statistics
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.hypothesis.swing_lines import on_swing_line


@dataclass(frozen=True, slots=True)
class Penalty:
    """Penalty of the parameters of a set of effects, in chi2 units."""

    parameter: float = 9.0
    """Penalty of one parameter: the logarithm of about 1e4 samples (BIC)."""
    curve: int = 3
    """Minimum number of amplitudes of an effect that counts as a curve.

    A curve can imitate a sum of other effects on a small arc.
    """
    ordinary: float = 0.1
    """Maximum size of a curve without an additional penalty, relative to the limits of its amplitudes: a typical
    eccentricity."""


PENALTY = Penalty()


@dataclass(frozen=True, slots=True)
class Refits:
    """Settings of the preliminary fits that the search compares."""

    preliminary: float = 3e-3
    """Relative reduction of the cost at which a fit far from the noise ends.

    Far from the noise, the residual is an error of the model, and the costs of two sets differ by factors. A change of
    a thousandth is then irrelevant. The fit of the selected set is continued to its minimum.
    """
    lost: float = 10.0
    """Maximum ratio of chi2 at the linear prediction to chi2 of the original set.

    At a larger ratio the linear prediction is a worse initial value than the original set.
    """


REFITS = Refits()
PRELIMINARY = GaussNewton(preliminary=REFITS.preliminary)

preliminary_fit = partial(fit, settings=PRELIMINARY)


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A set of effects with its fit and its residuals."""

    effects: tuple[str, ...]
    fit: Fit
    residuals: ResidualStatistics
    predictive_loss: Array
    """(folds,) loss of the prediction of each run, or quarter, from the others, in units of chi2."""
    curves: Mapping[str, float]
    """Size s of each curve in the set, by effect: the rms of its amplitudes relative to their limits."""
    on_line: frozenset[str] = frozenset()
    """Vibrations in the set whose frequency is a multiple of the frequency of the swing."""
    of_decay: frozenset[str] = frozenset()
    """Friction drifts in the set, if the recordings are one decay, in which amplitude and time are inseparable."""

    @property
    def cost(self) -> float:
        """Cost of the set: predictive loss plus the penalty of the parameters times the variance inflation."""
        return self.cost_at(self.residuals.inflation)

    def cost_at(self, inflation: float) -> float:
        """Cost of the set with the variance inflation of another set, whose residual then counts as noise."""
        return float(self.predictive_loss.sum()) + inflation * self.penalty

    @property
    def penalty(self) -> float:
        """Penalty of the parameters, in chi2 of independent readings.

        A curve of n amplitudes that exceeds the ordinary size s0 has the additional penalty 2 n ln(s / s0), because a
        prior of unknown common scale has the density s^-n. The penalty applies to curves that imitate other effects by
        amplitudes that cancel each other.
        """
        scanned = sum(len(EFFECTS[name].shapes) for name in self.effects)
        penalty = PENALTY.parameter * (len(self.fit.free) + scanned)
        for name, size in self.curves.items():
            penalty += 2 * len(EFFECTS[name].amplitudes) * float(np.log(max(size / PENALTY.ordinary, 1.0)))
        return penalty

    @property
    def key(self) -> frozenset[str]:
        """Names of the effects, as a set."""
        return frozenset(self.effects)


def beating(model: Hypothesis) -> GaussNewton:
    """Settings of a preliminary fit that is used only if it becomes better than a previous fit of the same set."""
    return replace(PRELIMINARY, to_beat=model.fit.chi2)


def hypothesis(problem: Problem, effects: Iterable[str], fitted: Fit) -> Hypothesis:
    """Hypothesis of a fit, with its residual statistics and cost."""
    residuals = residual_statistics(problem, fitted)
    names, loss = tuple(effects), predictive_loss(fitted, folds(problem), residuals.inflation)
    curves = [name for name in names if len(EFFECTS[name].amplitudes) >= PENALTY.curve]
    params, limits = fitted.estimate.params, problem.limits
    sizes = {} if limits is None else {name: relative_size(params, limits, name) for name in curves}
    on_line = frozenset(name for name in names if on_swing_line(problem, name, fitted.estimate))
    drifts = frozenset(names) & {effect.name for effect in FRICTION_DRIFT} if _one_decay(problem) else frozenset[str]()
    return Hypothesis(names, fitted, residuals, loss, sizes, on_line, drifts)


def _one_decay(problem: Problem) -> bool:
    """Whether the amplitude is a single function of time, so that amplitude and time are inseparable.

    This is the case for a single undriven swing (one release or its pieces) and for equal releases of one rod.
    """
    segments = problem.segments
    if not all(setup.free for setup in segments.setups):
        return False
    first, last = segments.t[segments.offsets[:-1]], segments.t[segments.offsets[1:] - 1]
    order = np.argsort(first)
    return bool((last[order][:-1] <= first[order][1:]).all()) or _equal_releases(problem)


def _equal_releases(problem: Problem, tolerance: float = 0.1) -> bool:
    """Whether one rod swings from the same angle in all runs, within a relative tolerance."""
    segments = problem.segments
    if not all(setup.alone for setup in segments.setups):
        return False
    from_hanging = np.abs(problem.measured[:, 0] - np.pi)
    of_segment = np.maximum.reduceat(from_hanging, segments.offsets[:-1])
    widest = [of_segment[segments.run == run].max() for run in np.unique(segments.run)]
    return min(widest) > (1 - tolerance) * max(widest)


def scale_visible(effects: Iterable[str], problem: Problem) -> bool:
    """Whether b is identifiable: a mass or torque is known, or friction depends on the force on a joint."""
    weighs = problem.masses_weighed and any(EFFECTS[name].stage == "load" for name in effects)
    return weighs or any(setup.weighs for setup in problem.segments.setups)


def free_parameters(estimate: Estimate, effects: Sequence[str], problem: Problem) -> tuple[FreeParameter, ...]:
    """Free parameters of a set: ratios, b if identifiable, uncertain rig constants, and parameters of the effects."""
    names = dict.fromkeys((*problem.always, *effects))
    visible = visible_ratios(problem.segments.setups, scale_visible(effects, problem))
    limits = problem.limits
    of_effects = (p for name in names for p in effect_parameters(EFFECTS[name], refined=True, limits=limits))
    return (*ratio_parameters(estimate, visible), *of_effects)


def refit(
    problem: Problem,
    start: Estimate,
    effects: Sequence[str],
    iterations: int,
    predicted: Array | None = None,
    settings: GaussNewton = PRELIMINARY,
) -> Hypothesis:
    """Fit a set of effects from an initial estimate; `predicted` are the readings at this estimate, if known."""
    free = free_parameters(start, effects, problem)
    end = fit(problem, start, free, iterations=iterations, predicted=predicted, settings=settings)
    return hypothesis(problem, effects, end)


def started_with(
    problem: Problem,
    before: Hypothesis,
    test: ScoreTest,
    score: Score,
    iterations: int = 0,
    settings: GaussNewton = PRELIMINARY,
) -> Iteration:
    """Add one effect at the linear solution of its score test; continue with some Gauss-Newton iterations."""
    linear = test.linear.chosen([*test.fitted_columns, *score.columns])
    first = descend(problem, shaped(before, score), score.free, iterations=1, first=linear)
    if not iterations:
        return first
    free = free_parameters(first.estimate, (*before.effects, score.effect.name), problem)
    return descend(problem, first.estimate, free, iterations=iterations, predicted=first.predicted, settings=settings)


def best_start(
    problem: Problem, before: Hypothesis, test: ScoreTest, scores: Sequence[Score], iterations: int
) -> Iteration:
    """Best of several initial fits with one additional effect, each from another shape of the effect."""
    best = started_with(problem, before, test, scores[0], iterations)
    for score in scores[1:]:
        race = replace(PRELIMINARY, to_beat=best.chi2)
        best = min(best, started_with(problem, before, test, score, iterations, race), key=lambda end: end.chi2)
    return best


def refit_with(
    problem: Problem,
    before: Hypothesis,
    test: ScoreTest,
    score: Score,
    iterations: int,
    start: Iteration | None = None,
) -> Hypothesis:
    """Fit a set with one additional effect, from the linear solution of its score test or from `start`."""
    start = start or started_with(problem, before, test, score)
    effects = (*before.effects, score.effect.name)
    return refit(problem, start.estimate, effects, iterations=iterations, predicted=start.predicted)


def refit_with_from_short(
    problem: Problem,
    short: tuple[Problem, Array],
    before: Hypothesis,
    score: Score,
    iterations: int,
    settings: GaussNewton = PRELIMINARY,
) -> Hypothesis:
    """Fit a set with one additional effect, first to short segments.

    This procedure is slower, but converges even if the effect is large.

    Args:
        problem: the segments
        short: shorter segments of the same runs, with their initial states
        before: fit without the effect
        score: score of the effect in its initial shape
        iterations: maximum number of iterations of each of the two fits
        settings: settings of the second fit
    """
    short_problem, initial = short
    short_start = replace(shaped(before, score), initial=initial)
    short_fit = descend(short_problem, short_start, score.free, iterations=iterations, settings=PRELIMINARY)
    initial_states = carried(
        short_problem.segments, short_fit.estimate.initial, problem.segments, before.fit.estimate.initial
    )
    start = short_fit.estimate.changed(initial=initial_states)
    return refit(problem, start, (*before.effects, score.effect.name), iterations, settings=settings)


def shaped(before: Hypothesis, score: Score) -> Estimate:
    """Estimate of a fit, with the shape parameters of an effect set to the values of its score."""
    params = before.fit.estimate.params.copy()
    for index, value in score.shape:
        params[index] = value
    return before.fit.estimate.changed(params=params)


def refit_without(
    problem: Problem, before: Hypothesis, effect: str, bare: Hypothesis, iterations: int = 15
) -> Hypothesis:
    """Refit a set without one effect, starting from the linearised solution.

    If b is not identifiable without the effect, its value is taken from the bare model.
    """
    names = tuple(name for name in before.effects if name != effect)
    free, linear, estimate = before.fit.free, before.fit.linear, before.fit.estimate
    removed = np.array([-p.read(estimate) if p.effect == effect and p.amplitude else 0.0 for p in free])
    remaining = [i for i, parameter in enumerate(free) if parameter.effect != effect]
    A, e = linear.flat
    step = removed.copy()
    step[remaining] = np.linalg.lstsq(A[:, remaining], e - A @ removed, rcond=1e-10)[0]
    without = estimate.changed(params=without_effect(estimate.params, effect))
    start = moved(without, [free[i] for i in remaining], step[remaining], linear.initial_steps(step))
    predicted, of_without = problem.predict(start), problem.predict(without)
    if not problem.chi2_by_segment(predicted).sum() < REFITS.lost * problem.chi2_by_segment(of_without).sum():
        start, predicted = without, of_without
    b = bare.fit.estimate.ratios[SCALE]
    if start.ratios[SCALE] != b and not scale_visible(names, problem):
        return refit(problem, start.changed(ratios=with_scale(start.ratios, b)), names, iterations=iterations)
    return refit(problem, start, names, iterations, predicted)
