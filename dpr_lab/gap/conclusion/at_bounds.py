"""Uncertainty of fitted values at a bound, such as a viscous friction of zero.

The noise may have moved such a value to the bound. Its true distance u from the bound has the truncated normal density

    exp((g u - K u^2 / 2) / f),    0 <= u <= U,    K = |c|^2,    g = c^T e,

where e is the whitened residual, f the variance inflation, and c the change of the readings per unit of u. The initial
states and the other values adapt to u, so their contribution is projected out of c. U is the value of u at which
another parameter reaches its bound.

The estimate is u = 0, so the second moment of u counts as its variance. The other values that adapt to u share this
variance. For example, a slope of the friction curve and the viscous friction of a slow joint are hardly separable. A
value that the other values absorb is also at its bound of zero and is treated in the same way.

c is the difference of two simulations along the direction of the joint change. A sum of columns would not be exact: the
columns of nearly collinear parameters, each with its own error, do not cancel. Each value is treated while the others
stay at their bounds.
"""

from collections.abc import Iterator

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.gauss_newton import Fit, bounds
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace


def second_moments(problem: Problem, fit: Fit, inflation: float) -> Array:
    """Return the second moment of the errors that values at their bounds cause.

    Its shape is (free, free), for all values.

    Args:
        problem: segments and noise
        fit: the fit
        inflation: f
    """
    moments = np.zeros((len(fit.free), len(fit.free)))
    for shift in _shifts(problem, fit, inflation):
        moments += np.outer(shift, shift)
    return moments


def _shifts(problem: Problem, fit: Fit, inflation: float) -> Iterator[Array]:
    """Yield the (free,) rms errors due to each value at its bound."""
    room, inside = bounds(fit.estimate, fit.free), fit.inside
    at_bound = np.flatnonzero((room == 0.0).any(axis=0)).tolist()
    if not at_bound:
        return
    before = problem.predict(fit.estimate)
    prior = inflation**0.5 * fit.prior
    space = ColumnSpace.of(*fit.linear.flat).with_prior(prior, np.zeros(len(prior)))
    for k in at_bound:
        direction = _direction(space, inside, k, inward=1.0 if room[0, k] == 0.0 else -1.0)
        farthest = _farthest(room, direction)
        alone = space.given(inside, [k])
        step = min(farthest, inflation**0.5 * float(alone.scale[0]) / float(alone.H[0, 0]) ** 0.5)
        states = fit.linear.initial_steps(step * direction) - fit.linear.initial_steps(np.zeros(len(direction)))
        moved = Estimate(fit.estimate.vector.copy(), fit.estimate.initial + states)
        for parameter, change in zip(fit.free, direction.tolist(), strict=True):
            moved.vector[parameter.place] += step * change
        column = problem.whitened(np.nan_to_num((problem.predict(moved) - before) / step))
        A = np.append(fit.linear.A[:, :, inside], fit.linear.projected(column[:, :, None]), axis=2)
        rows = np.column_stack([prior[:, inside], prior @ direction])
        columns = ColumnSpace.of(A, fit.linear.e).with_prior(rows, np.zeros(len(rows)))
        rest = columns.given(range(len(inside)), [len(inside)])
        K, g = float(rest.H[0, 0]) / rest.scale[0] ** 2, float(rest.gradient[0]) / rest.scale[0]
        yield direction * _mean_square(g / inflation, K / inflation, farthest) ** 0.5


def _direction(space: ColumnSpace, inside: list[int], k: int, inward: float) -> Array:
    """Return the (free,) change of all values per unit of value k.

    Values inside their bounds adapt to the readings.
    """
    direction = np.zeros(len(space))
    direction[k] = inward
    across = space.H[inside][:, [k]] / space.scale[k] * inward
    direction[inside] = -space.chosen(inside).covariance() @ (across[:, 0] / space.scale[inside])
    return direction


def _farthest(room: Array, direction: Array) -> float:
    """Return the largest step along a direction that keeps all values within their bounds.

    Values that do not change along the direction are ignored.
    """
    ahead = np.where(direction > 0.0, room[1], room[0])[direction != 0.0] / direction[direction != 0.0]
    return float(ahead.min(initial=np.inf))


def _mean_square(slope: float, curvature: float, farthest: float) -> float:
    """Return the mean of u^2 for the density exp(slope u - curvature u^2 / 2).

    The density covers 0 <= u <= farthest. It is cut off at eight standard deviations, where it is negligible.
    """
    reach = 8.0
    std, falling = max(curvature, 1e-300) ** -0.5, max(-slope, 1e-300)
    beyond = max(slope, 0.0) / max(curvature, 1e-300) + reach * std
    u = np.linspace(0.0, min(farthest, beyond, reach**2 / 2 / falling), 1000)
    log = slope * u - curvature * u**2 / 2
    weight = np.exp(log - log.max())
    return float(np.sum(weight * u**2) / np.sum(weight))
