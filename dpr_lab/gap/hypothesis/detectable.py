"""Minimum detectable size of each effect in these recordings."""

from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from statistics import NormalDist

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import EFFECTS, param_index
from dpr_lab.effects.effect import Effect, EffectParameter
from dpr_lab.fitting.covariance import shifted
from dpr_lab.fitting.prior import prior_of
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import TINY
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.hypothesis.score_test import Score, ScoreTest
from dpr_lab.gap.result.evidence import DetectableSizes, Exclusion
from dpr_lab.rig import load_rig

SIGMAS = 5.0
"""Ratio of the minimum detectable size to the standard deviation of the amplitude.

It exceeds the largest ratio that noise alone reaches among 600 shapes.
"""

SEEN = 1e-6
"""Minimum fraction of the squared norm of a column that remains after the projection if its amplitude is detectable."""


def detectable(model: Hypothesis, test: ScoreTest) -> DetectableSizes:
    """Return the minimum detectable size of each amplitude of each effect, given the fitted model.

    This size is five standard deviations,

        size = 5 sqrt(f) / | s |

    Here s is the change of the whitened readings per unit of the amplitude, with initial states and fitted parameters
    projected out, and f is the variance inflation n / n_eff. The size is None if s is zero, because the readings do not
    change or other parameters absorb the amplitude.

    Args:
        model: the fitted model
        test: score test of the model
    """
    spread = SIGMAS * model.inflation**0.5
    least: dict[str, dict[str, float | None]] = {}
    for score in test.ranking:
        remaining_shares = np.diag(test.projected(score.columns).H)
        scales = test.space.scale[list(score.columns)]
        sizes = {
            test.free[column].name: _size(spread, scale, remaining)
            for column, scale, remaining in zip(score.columns, scales, remaining_shares, strict=True)
        }
        least[score.effect.name] = {
            p.name: None if p.name in score.absorbed else sizes[p.name] for p in score.effect.amplitudes
        }
    fitted = test.space.chosen(list(test.fitted_columns))
    remaining_shares = fitted.scale**2 / np.diag(fitted.covariance())
    for name in model.effects:
        parameters = zip(test.fit.free, fitted.scale, remaining_shares, strict=True)
        least[name] = {
            p.name: _size(spread, s, remaining) for p, s, remaining in parameters if p.effect == name and p.amplitude
        }
    return {name: least[name] for name in EFFECTS if name in least}


def detectable_arm_scale(problem: Problem, model: Hypothesis, step: float = 1e-3) -> float | None:
    """Return the minimum detectable relative error of the angle of prescribed arms.

    The library contains no such error, because the prescribed angle is an input of the model. The result is None if no
    arm is prescribed, or if the fitted parameters absorb the error.

    Args:
        problem: segments and noise
        model: the fitted model
        step: relative change of the angle from which the change of the readings is computed
    """
    fit, setups = model.fit, problem.segments.setups
    if not any(setup.arm for setup in setups):
        return None
    scaled = tuple(replace(setup, arm=setup.arm.scaled(1 + step)) if setup.arm else setup for setup in setups)
    other = replace(problem, segments=replace(problem.segments, setups=scaled))
    change = np.nan_to_num((other.predict(fit.estimate) - problem.predict(fit.estimate)) / step)
    column = problem.whitened(change)
    remaining = fit.linear.projected(column[:, :, None])[:, :, 0] + fit.linear.A @ shifted(fit, column)
    visible = float(np.sum(remaining**2))
    return SIGMAS * float(model.inflation / visible) ** 0.5 if visible > SEEN * float(np.sum(column**2)) else None


def _size(spread: float, scale: float, remaining: float) -> float | None:
    """Return the minimum detectable amplitude of a column, or None if other parameters absorb it."""
    return float(spread * scale / remaining**0.5) if remaining > SEEN and scale < 1 / TINY else None


def comparable_size(params: Array, effect: Effect, amplitude: EffectParameter) -> float:
    """Convert the size of a fitted effect to the unit of an amplitude of another effect.

    If the units differ, the ratio to the typical size is kept: half the typical offset corresponds to half the typical
    drift.

    Args:
        params: (SIZE,) fitted parameters
        effect: the fitted effect
        amplitude: amplitude of the other effect
    """
    sizes = {p: abs(float(params[param_index(effect.name, p.name)])) for p in effect.amplitudes}
    return max(size if p.unit == amplitude.unit else size / p.typical * amplitude.typical for p, size in sizes.items())


def linear_exclusions(test: ScoreTest, score: Score, sizes: Mapping[str, float | None]) -> list[Exclusion]:
    """Test whether the minimum detectable size of each amplitude is excluded.

    Each amplitude is estimated with all other amplitudes equal to zero. A linear estimate a of standard deviation s
    excludes the minimum detectable size 5 s with the confidence P(|x| < 5 s) = Phi(5 - |a| / s).

    Args:
        test: score test with the named effects in the model
        score: score of the effect in this test
        sizes: minimum detectable sizes of its amplitudes, see `detectable`
    """
    space, excluded = test.projected(score.columns), list[Exclusion]()
    for i, column in enumerate(score.columns):
        parameter = test.free[column].name
        size = sizes.get(parameter)
        if not size:
            continue
        estimate = float(space.gradient[i] / space.H[i, i] * space.scale[i])
        confidence = NormalDist().cdf(SIGMAS * (1 - abs(estimate) / size))
        excluded.append(
            Exclusion(
                effect=score.effect.name, parameter=parameter, size=size, estimate=estimate, confidence=confidence
            )
        )
    return excluded


def count_detectable(least: DetectableSizes, limits: Array | None) -> tuple[int, int]:
    """Count the effects that are detectable at their typical size, and at any size.

    Effects that are undetectable at any size are not counted, unless all are undetectable: they do not act in these
    recordings, or the ratios absorb them.

    Args:
        least: minimum detectable sizes, the result of `detectable`
        limits: (SIZE,) maximum sizes on this rig; None: those of the laboratory rig
    """
    acting = {name: sizes for name, sizes in least.items() if any(size is not None for size in sizes.values())}
    considered = acting or least
    at_typical_size = 0
    for name, sizes in considered.items():
        amplitudes = ((sizes.get(p.name), _typical(name, p, limits)) for p in EFFECTS[name].amplitudes)
        at_typical_size += any(size is not None and size <= typical for size, typical in amplitudes)
    return at_typical_size, len(considered)


def _typical(effect: str, parameter: EffectParameter, limits: Array | None) -> float:
    """Return the typical size of an amplitude on this rig.

    The library states typical sizes on a laboratory rig. For larger rods, the sizes of torques and inertias are
    multiplied by the ratio of their limits, which are proportional to gravity torque and inertia about the joint. For
    example, friction of 1 mN m is typical for rods of 0.4 m, but not for rods of 1.4 m.
    """
    if limits is None or parameter.scale_power != 1:
        return parameter.typical
    index = param_index(effect, parameter.name)
    return parameter.typical * max(1.0, float(limits[index] / _laboratory_limits()[index]))


@cache
def _laboratory_limits() -> Array:
    """Return the (SIZE,) maximum sizes on the rig for which the library states typical sizes."""
    return prior_of(load_rig("paper")).limits
