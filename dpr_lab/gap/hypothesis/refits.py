"""Fits of a set to which one effect was added, or from which one effect was removed.

The initial values are those of a fitted set or of the linear solution of a score test.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import without_effect
from dpr_lab.fitting.estimate import SCALE, Estimate, moved, with_scale
from dpr_lab.fitting.gauss_newton import GaussNewton, Iteration, descend, fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, free_parameters, hypothesis, scale_visible
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest


@dataclass(frozen=True, slots=True)
class RefitSettings:
    """Settings of the preliminary fits that the search compares."""

    preliminary: float = 3e-3
    """Relative decrease of chi2 per iteration below which a fit far from the noise ends.

    Far from the noise, the costs of two sets differ by factors, so that a change by a few thousandths is irrelevant.
    The fit of the selected set is continued to its minimum.
    """
    without: int = 15
    """Maximum number of iterations of the fit of a set without one effect."""
    lost: float = 10.0
    """Maximum ratio of chi2 at the linear prediction to chi2 of the original set.

    At a larger ratio, the fit starts from the original set instead of the linear prediction.
    """


REFITS = RefitSettings()
PRELIMINARY = GaussNewton(preliminary=REFITS.preliminary)


def settings_to_beat(model: Hypothesis) -> GaussNewton:
    """Return the settings of a fit that stops early if it will not become better than the fit of `model`.

    Both fits have the same set of effects and different initial values.
    """
    return replace(PRELIMINARY, to_beat=model.fit.chi2, race=True)


def refit(
    problem: Problem,
    start: Estimate,
    effects: Sequence[str],
    iterations: int,
    predicted: Array | None = None,
    settings: GaussNewton = PRELIMINARY,
) -> Hypothesis:
    """Fit a set of effects; `predicted` are the readings at the initial estimate, if known."""
    free = free_parameters(start, effects, problem)
    end = fit(problem, start, free, iterations=iterations, predicted=predicted, settings=settings)
    return hypothesis(problem, effects, end)


def best_start(
    problem: Problem, before: Hypothesis, test: ScoreTest, scores: Sequence[Score], iterations: int
) -> Iteration:
    """Return the best of several short fits with one additional effect.

    Each fit starts from the shape and the linear solution of one score.
    """
    best: Iteration | None = None
    for score in scores:
        first = _started_with(problem, before, test, score)
        free = free_parameters(first.estimate, (*before.effects, score.effect.name), problem)
        race = PRELIMINARY if best is None else replace(PRELIMINARY, to_beat=best.chi2, race=True)
        end = descend(problem, first.estimate, free, iterations=iterations, predicted=first.predicted, settings=race)
        best = end if best is None else min(best, end, key=lambda fitted: fitted.chi2)
    assert best is not None
    return best


def refit_with(
    problem: Problem,
    before: Hypothesis,
    test: ScoreTest,
    score: Score,
    iterations: int,
    start: Iteration | None = None,
) -> Hypothesis:
    """Fit a set with one additional effect, from its linear score or from `start`."""
    start = start or _started_with(problem, before, test, score)
    effects = (*before.effects, score.effect.name)
    return refit(problem, start.estimate, effects, iterations=iterations, predicted=start.predicted)


def _started_with(problem: Problem, before: Hypothesis, test: ScoreTest, score: Score) -> Iteration:
    """Add one effect to a fit and perform one iteration, whose step is the linear solution of the score test."""
    linear = test.linear.chosen([*test.fitted_columns, *score.columns])
    return descend(problem, shaped(before, score), score.free, iterations=1, first=linear)


def shaped(before: Hypothesis, score: Score) -> Estimate:
    """Return the estimate of a set, with the shape parameters of a score."""
    params = before.estimate.params.copy()
    for index, value in score.shape:
        params[index] = value
    return before.estimate.changed(params=params)


def refit_without(problem: Problem, before: Hypothesis, effect: str, bare: Hypothesis) -> Hypothesis:
    """Fit a set without one of its effects, starting from the linear prediction.

    If b is not identifiable without the effect, its value is taken from the bare model.
    """
    names = tuple(name for name in before.effects if name != effect)
    free, linear, estimate = before.fit.free, before.fit.linear, before.estimate
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
    b = bare.estimate.ratios[SCALE]
    if start.ratios[SCALE] != b and not scale_visible(names, problem):
        start, predicted = start.changed(ratios=with_scale(start.ratios, b)), None
    return refit(problem, start, names, REFITS.without, predicted)
