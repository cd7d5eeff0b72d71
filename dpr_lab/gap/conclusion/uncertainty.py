"""Covariance of the fitted values due to noise, integrator, measured constants, and discrepancy term.

Let A be the Jacobian of a fit after the initial states are projected out. The noise causes the covariance f (A^T A)^-1,
where f is the variance inflation n / n_eff (`dpr_lab.gap.hypothesis.residuals`). Any other change dr of the readings
that the fit does not model shifts the values by -(A^T A)^-1 A^T dr. The following shifts are used as standard
deviations:

- the shift caused by halving the integrator step
- the shift caused by each measured mass if it changes by its standard uncertainty
- the shift caused by each free torque or reading error of the discrepancy term if it has the size of its prior

Undetermined ratios shift the other ratios in the same way, within the bounds of the rig file. Sizes of effects assume
these ratios, as they assume b.

Source: consider covariance, S. F. Schmidt (1966), Application of state-space methods to navigation problems.

Values at a bound, such as a viscous friction of zero, have one more uncertainty (`second_moments`). The noise may have
moved such a value to the bound. Its true distance u from the bound has the truncated normal density

    exp((g u - K u^2 / 2) / f),    0 <= u <= U,    K = |c|^2,    g = c^T e,

where e is the whitened residual, f the variance inflation, and c the change of the readings per unit of u. The initial
states and the other values adapt to u, so their contribution is projected out of c. U is the value of u at which
another parameter reaches its bound.

The estimate is u = 0, so the second moment of u is used as its variance. The values that adapt to u receive the
corresponding variance. An example is the viscous friction of a slow joint, which is hardly separable from a slope of
the friction curve. A value that the other values absorb completely is at its bound of zero and is treated in the same
way.

c is the difference of two simulations along the direction of the joint change. A sum of columns would not be exact: the
columns of nearly collinear parameters, each with its own error, do not cancel. The values are treated one at a time,
while the others stay at their bounds.
"""

from collections.abc import Iterator

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS
from dpr_lab.fitting.covariance import considered, shifted
from dpr_lab.fitting.estimate import ON_ELBOW, Estimate
from dpr_lab.fitting.gauss_newton import Fit, bounds
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.where.discrepancy import Discrepancy
from dpr_lab.rig import MASSES, Rig


def covariance(problem: Problem, model: Hypothesis, rig: Rig, remainder: Discrepancy | None = None) -> Array:
    """Return the (free, free) covariance of the fitted values.

    The rows and columns of values at a bound are zero; `second_moments` contains their uncertainty.

    Args:
        problem: segments and noise
        model: the fitted set of effects
        rig: rig file with the measured constants
        remainder: discrepancy term of the fit, which also shifts the values
    """
    before = problem.predict(model.estimate)
    shifts = [other.predict(model.estimate) - before for other in _changed_problems(problem, rig)]
    # a segment that cannot be simulated contains no information
    changes = [problem.whitened(np.nan_to_num(shift)) for shift in shifts]
    if remainder is not None:
        changes += list(np.moveaxis(remainder.columns, 2, 0))
    return considered(model.fit, model.inflation, changes)


def whole_covariance(problem: Problem, model: Hypothesis, rig: Rig, remainder: Discrepancy | None = None) -> Array:
    """Return the (free, free) covariance of the fitted values, including those at a bound.

    The arguments are those of `covariance`.
    """
    return covariance(problem, model, rig, remainder) + second_moments(problem, model.fit, model.inflation)


def by_undetermined_ratios(problem: Problem, fit: Fit) -> Array:
    """Return the (free, free) covariance of the fitted values due to the undetermined ratios.

    Args:
        problem: segments and noise
        fit: the fit
    """
    before, covariance = problem.predict(fit.estimate), np.zeros((len(fit.free), len(fit.free)))
    share = 1e-3  # increment of a ratio in prior standard deviations: small, so that the difference is a derivative
    for other in _other_ratios(problem, fit, share):
        shift = shifted(fit, problem.whitened(np.nan_to_num((problem.predict(other) - before) / share)))
        covariance += np.outer(shift, shift)
    return covariance


def _other_ratios(problem: Problem, fit: Fit, share: float) -> Iterator[Estimate]:
    """Yield an estimate with changed undetermined ratios, for each principal direction of their prior.

    The change along a direction is the fraction `share` of a prior standard deviation. The fit contains no information
    about undetermined ratios, so their prior is not conditioned on the fit.
    """
    free = {parameter.place for parameter in fit.free if parameter.block == "ratios"}
    alone = any(setup.alone for setup in problem.segments.setups)
    fixed = [place for place in (*range(len(RATIOS)), *([ON_ELBOW] if alone else [])) if place not in free]
    if problem.prior is None:
        return
    for step in np.linalg.cholesky(problem.prior.covariance[np.ix_(fixed, fixed)]).T:
        ratios = fit.estimate.ratios.copy()
        ratios[fixed] += share * step
        yield fit.estimate.changed(ratios=ratios)


def _changed_problems(problem: Problem, rig: Rig) -> Iterator[Problem]:
    """Yield a problem with half the integrator step, and one problem for each measured mass, which is increased."""
    constants = problem.model.constants
    yield problem.with_half_steps()
    for name in MASSES:
        std = rig.parameters[name].std
        if std is not None:
            yield problem.with_constants(constants._replace(**{name: getattr(constants, name) + std}))


def second_moments(problem: Problem, fit: Fit, inflation: float) -> Array:
    """Return the (free, free) second moments of the errors that values at their bounds cause.

    Args:
        problem: segments and noise
        fit: the fit
        inflation: variance inflation f
    """
    moments = np.zeros((len(fit.free), len(fit.free)))
    for shift in _shifts(problem, fit, inflation):
        moments += np.outer(shift, shift)
    return moments


def _shifts(problem: Problem, fit: Fit, inflation: float) -> Iterator[Array]:
    """Yield the (free,) rms errors of all values due to each value at its bound."""
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
        alone = space.projected_out(inside, [k])
        step = min(farthest, inflation**0.5 * float(alone.scale[0]) / float(alone.H[0, 0]) ** 0.5)
        states = fit.linear.initial_steps(step * direction) - fit.linear.initial_steps(np.zeros(len(direction)))
        changed = Estimate(fit.estimate.vector.copy(), fit.estimate.initial + states)
        for parameter, change in zip(fit.free, direction.tolist(), strict=True):
            changed.vector[parameter.place] += step * change
        column = problem.whitened(np.nan_to_num((problem.predict(changed) - before) / step))
        A = np.append(fit.linear.A[:, :, inside], fit.linear.projected(column[:, :, None]), axis=2)
        rows = np.column_stack([prior[:, inside], prior @ direction])
        columns = ColumnSpace.of(A, fit.linear.e).with_prior(rows, np.zeros(len(rows)))
        reduced = columns.projected_out(range(len(inside)), [len(inside)])
        K, g = float(reduced.H[0, 0]) / reduced.scale[0] ** 2, float(reduced.gradient[0]) / reduced.scale[0]
        yield direction * _mean_square(g / inflation, K / inflation, farthest) ** 0.5


def _direction(space: ColumnSpace, inside: list[int], k: int, inward: float) -> Array:
    """Return the (free,) change of all fitted values if value k changes by one unit.

    The values inside their bounds are refitted; the other values stay at their bounds.
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
    steps = np.where(direction > 0.0, room[1], room[0])[direction != 0.0] / direction[direction != 0.0]
    return float(steps.min(initial=np.inf))


def _mean_square(slope: float, curvature: float, farthest: float) -> float:
    """Return the mean of u^2 for the density exp(slope u - curvature u^2 / 2).

    The density covers 0 <= u <= farthest. It is cut off at eight standard deviations, where it is negligible.
    """
    limit = 8.0
    std, falling = max(curvature, 1e-300) ** -0.5, max(-slope, 1e-300)
    beyond = max(slope, 0.0) / max(curvature, 1e-300) + limit * std
    u = np.linspace(0.0, min(farthest, beyond, limit**2 / 2 / falling), 1000)
    log = slope * u - curvature * u**2 / 2
    weight = np.exp(log - log.max())
    return float(np.sum(weight * u**2) / np.sum(weight))
