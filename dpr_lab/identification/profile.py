"""Profile likelihood of an unknown: all other unknowns are refitted for each value of this unknown.

docs/theory.md, equation 23, for the unknown q_i:

    D(v) = min chi2(q with q_i = v) - min chi2,    90 % interval where D <= 2.7055 s

where s is the reduced chi-square if the residual exceeds the noise, otherwise 1. Unlike the covariance, the profile
accounts for curved valleys and bounds. Like every likelihood, it assumes independent residuals.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import root_scalar
from scipy.special import chdtri

from dpr_lab.identification.ratio_fit import RatioFit, fit_ratios
from dpr_lab.identification.uncertainty import RatioUncertainty


@dataclass(frozen=True, slots=True)
class ProfileSettings:
    """Settings of the search for the ends of the interval."""

    widest: float = 30.0
    """Distance from the estimate beyond which an unknown counts as unbounded on this side, in standard deviations."""
    tolerance: float = 0.02
    """Accuracy of an end of the interval, in standard deviations."""
    iterations: int = 6
    """Maximum number of iterations of a fit; its initial values are correct to first order."""


SETTINGS = ProfileSettings()


def profile90(ratio_fit: RatioFit, ratio_uncertainty: RatioUncertainty, index: int) -> tuple[float, float]:
    """Compute the 90 % profile likelihood interval of one unknown.

    The lower end of a friction ratio is at least zero. The interval of an unknown at its bound of zero is one-sided.

    Args:
        ratio_fit: maximum of the likelihood
        ratio_uncertainty: information matrix and standard deviations of the fit
        index: index of the unknown

    Returns:
        lower and upper end; infinite if the likelihood does not decrease within `widest` standard deviations
    """
    std = ratio_uncertainty.cramer_rao_with(index) * ratio_fit.noise_factor**0.5
    at_bound = ratio_uncertainty.values[index] <= 0.0
    low = 0.0 if at_bound else _end(ratio_fit, ratio_uncertainty, index, -std)
    return low, _end(ratio_fit, ratio_uncertainty, index, std)


def _end(ratio_fit: RatioFit, ratio_uncertainty: RatioUncertainty, index: int, unit: float) -> float:
    limit = float(chdtri(1, 0.1)) * ratio_fit.noise_factor
    centre, widest = float(ratio_uncertainty.values[index]), SETTINGS.widest
    furthest = widest if unit > 0 else min(widest, centre / -unit)

    def excess(units: float) -> float:
        return _chi2_at(ratio_fit, ratio_uncertainty, index, centre + units * unit) - ratio_fit.fit.chi2 - limit

    outer = min(2.0, furthest)
    while excess(outer) < 0:
        if outer >= furthest:
            return centre + outer * unit if furthest < widest else float(np.copysign(np.inf, unit))
        outer = min(2 * outer, furthest)
    return centre + float(root_scalar(excess, bracket=(0.0, outer), xtol=SETTINGS.tolerance).root) * unit


def _chi2_at(ratio_fit: RatioFit, ratio_uncertainty: RatioUncertainty, index: int, value: float) -> float:
    """Compute the minimum chi-square with one unknown fixed at a value.

    The fit starts from the solution of the linear problem.
    """
    free = (ratio_uncertainty.values > 0) | (np.arange(len(ratio_uncertainty.values)) == index)
    direction = np.zeros(len(free))
    direction[free] = np.linalg.inv(ratio_uncertainty.information[np.ix_(free, free)])[
        :, np.count_nonzero(free[:index])
    ]
    step = direction / direction[index] * (value - ratio_uncertainty.values[index])
    estimate = ratio_fit.fit.estimate
    ratios = estimate.ratios.copy()
    ratios[list(ratio_fit.visible)] = np.maximum(ratio_uncertainty.values + step, 0.0)
    # the free parameters include zeros of encoders
    of_all = np.concatenate([step, np.zeros(len(ratio_fit.fit.free) - len(step))])
    start = estimate.changed(ratios=ratios, initial=estimate.initial + ratio_fit.fit.linear.initial_steps(of_all))
    return fit_ratios(
        ratio_fit.problem, start, held=[ratio_fit.visible[index]], iterations=SETTINGS.iterations
    ).fit.chi2
