"""Uncertainty of the fitted values due to noise, integrator, measured constants, and discrepancy term.

Let A be the Jacobian of a fit after the initial states are projected out. The noise causes the covariance f (A^T A)^-1,
where f is the variance inflation n / n_eff (`dpr_lab.gap.hypothesis.residuals`). Any other change dr of the readings
that the fit does not model shifts the values by -(A^T A)^-1 A^T dr. The following shifts count as standard deviations:

- the shift caused by halving the integrator step
- the shift caused by each weighed mass if it changes by its standard uncertainty
- the shift caused by each free torque or reading error of the discrepancy term if it has the size of its prior

Undetermined ratios shift the other ratios in the same way, within the bounds of the rig file. Sizes of effects assume
these ratios, as they assume b.

Source: consider covariance, S. F. Schmidt (1966), Application of state-space methods to navigation problems.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS
from dpr_lab.fitting.covariance import considered, shifted
from dpr_lab.fitting.estimate import ON_ELBOW, Estimate
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.where.discrepancy import Discrepancy
from dpr_lab.identification.prior_update import prior_ratio_std
from dpr_lab.rig import MASSES, Rig


def covariance(problem: Problem, model: Hypothesis, rig: Rig, remainder: Discrepancy | None = None) -> Array:
    """Return the (free, free) covariance of the fitted values.

    The covariance is zero for values at a bound (`at_bounds`).

    Args:
        problem: segments and noise
        model: the fit
        rig: measured constants
        remainder: discrepancy term of the fit, which also shifts the values
    """
    before = problem.predict(model.estimate)
    shifts = [other.predict(model.estimate) - before for other in _otherwise(problem, rig)]
    # a segment that cannot be simulated contains no information
    changes = [problem.whitened(np.nan_to_num(shift)) for shift in shifts]
    if remainder is not None:
        changes += list(np.moveaxis(remainder.columns, 2, 0))
    return considered(model.fit, model.inflation, changes)


def by_unseen_ratios(problem: Problem, model: Hypothesis, rig: Rig) -> Array:
    """Return the (5,) variance of the ratios due to the undetermined ratios.

    Args:
        problem: segments and noise
        model: a fitted set of effects
        rig: nominal values and bounds
    """
    before = problem.predict(model.estimate)
    variance = np.array(prior_ratio_std(rig)) ** 2
    columns = {p.place: i for i, p in enumerate(model.fit.free) if p.block == "ratios" and p.place < len(RATIOS)}
    variance[list(columns)] = 0.0
    share = 1e-3  # increment of a ratio in prior standard deviations: small, so that the difference is a derivative
    for other in _other_ratios(problem, model, share):
        change = problem.whitened(np.nan_to_num((problem.predict(other) - before) / share))
        variance[list(columns)] += shifted(model.fit, change)[list(columns.values())] ** 2
    return variance


def _other_ratios(problem: Problem, model: Hypothesis, share: float) -> Iterator[Estimate]:
    """Yield one changed estimate for each undetermined direction of the ratios.

    The change along the direction is a fraction `share` of a prior standard deviation.

    The prior of the undetermined ratios is used as it is, because the fitted values contain no information about these
    ratios.
    """
    free = {parameter.place for parameter in model.fit.free if parameter.block == "ratios"}
    alone = any(setup.alone for setup in problem.segments.setups)
    fixed = [place for place in (*range(len(RATIOS)), *([ON_ELBOW] if alone else [])) if place not in free]
    if problem.prior is None:
        return
    for step in np.linalg.cholesky(problem.prior.covariance[np.ix_(fixed, fixed)]).T:
        ratios = model.estimate.ratios.copy()
        ratios[fixed] += share * step
        yield model.estimate.changed(ratios=ratios)


def _otherwise(problem: Problem, rig: Rig) -> Iterator[Problem]:
    """Yield a problem with half the integrator step, and one problem for each increased weighed mass."""
    segments, model = problem.segments, problem.model
    yield replace(problem, segments=replace(segments, step=segments.step / 2))
    for name in MASSES:
        std = rig.parameters[name].std
        if std is not None:
            heavier = model.constants._replace(**{name: getattr(model.constants, name) + std})
            yield replace(problem, model=model.with_constants(heavier))
