"""Profile likelihood: how far an unknown can move while everything else is fitted again.

    D(v) = min chi2(q with q_i = v) - min chi2,    90 % interval where D <= 2.7055 s

with s the reduced chi-square where the model does not reach the noise, else 1. Unlike the covariance it follows curved
valleys and ends at a bound; like every likelihood it takes residuals as independent.
"""

import numpy as np
from scipy.optimize import root_scalar

from dpr_lab.estimation.least_squares import Conditions, SegmentFit, carried, fit_segments

CHI2_90 = 2.7055  # chi-square with one degree of freedom below which 90 % lie
WIDEST = 30.0  # standard deviations to look, beyond which an unknown counts as unbounded on that side
TOLERANCE = 0.02  # of a standard deviation
ITERATIONS = 6  # the start is right to first order


def profile90(fit: SegmentFit, index: int, known: Conditions) -> tuple[float, float]:
    """90 % profile likelihood interval of one unknown; a friction ratio's lower end stops at zero.

    Args:
        fit: where the likelihood is largest
        index: which unknown
        known: as in the fit

    Returns:
        lower and upper end; infinite where the likelihood does not fall within `WIDEST` standard deviations
    """
    std = float(fit.cramer_rao_std[index]) * max(1.0, fit.chi2_per_dof) ** 0.5
    if std == 0.0:
        return 0.0, 0.0
    return _end(fit, index, known, -std), _end(fit, index, known, std)


def _end(fit: SegmentFit, index: int, known: Conditions, unit: float) -> float:
    limit = CHI2_90 * max(1.0, fit.chi2_per_dof)
    centre = float(fit.unknowns[index])
    furthest = WIDEST if unit > 0 else min(WIDEST, centre / -unit)

    def excess(units: float) -> float:
        return _chi2_at(fit, index, known, centre + units * unit) - fit.chi2 - limit

    outer = min(2.0, furthest)
    while excess(outer) < 0:
        if outer >= furthest:
            return centre + outer * unit if furthest < WIDEST else float(np.copysign(np.inf, unit))
        outer = min(2 * outer, furthest)
    return centre + float(root_scalar(excess, bracket=(0.0, outer), xtol=TOLERANCE).root) * unit


def _chi2_at(fit: SegmentFit, index: int, known: Conditions, value: float) -> float:
    """Least chi-square with one unknown held, started where the linear problem has it."""
    free = fit.unknowns > 0
    along = np.zeros(len(free))
    along[free] = np.linalg.inv(fit.information[np.ix_(free, free)])[:, np.count_nonzero(free[:index])]
    step = along / along[index] * (value - fit.unknowns[index])
    start = np.maximum(fit.unknowns + step, 0.0)
    return fit_segments(start, carried(fit, step, known), known, held=[index], max_iterations=ITERATIONS).chi2
