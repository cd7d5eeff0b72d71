"""Fits that a few readings or segments would lead astray."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.fitting.gauss_newton import Fit, descend, fit
from dpr_lab.fitting.problem import Problem

Array = NDArray[np.float64]

NORMAL_MAD = 1.482602218505602
"""Standard deviation of a normal variable over the median of its absolute value."""


def without_outstanding(problem: Problem, found: Fit, *, iterations: int = 12, outstanding: float = 9.0) -> Fit:
    """A fit once more, from where it leads while the few segments that it fits worst hardly count.

    One swing that passes near the upright can hold all parameters at a local minimum.

    Args:
        problem: what was measured
        found: the fit
        iterations: at most, of each of two fits
        outstanding: chi2 of a segment over the median of all from which it counts as such

    Returns:
        the better of the two fits
    """
    chi2 = np.minimum(found.linear.chi2_by_segment, np.finfo(np.float64).max)
    worst = chi2 / max(float(np.median(chi2)), float(np.finfo(np.float64).tiny))
    if not (worst > outstanding).any():
        return found
    lighter = 1 / np.sqrt(np.maximum(worst, 1.0))
    eased = problem.weighted(lighter[problem.owner, None])
    there = descend(eased, found.estimate, found.free, iterations=iterations)
    again = fit(problem, there.estimate, found.free, iterations=iterations, predicted=there.predicted)
    return min(found, again, key=lambda one: one.chi2)


def begun_again(problem: Problem, found: Fit, initial: Array, *, iterations: int = 20, lost: float = 9.0) -> Fit:
    """A fit once more, from better initial states of the few segments that it left at a wrong minimum.

    Args:
        problem: what was measured
        found: the fit
        initial: (segments, 4) other initial states
        iterations: at most, of each of two fits
        lost: chi2 of a segment over the median of all from which it may be lost, and must fall by half that

    Returns:
        the better of the two fits
    """
    chi2 = np.nan_to_num(found.linear.chi2_by_segment, nan=np.inf)
    if not (chi2 > lost * np.median(chi2)).any():
        return found
    there = fit(problem, found.estimate.changed(initial=initial), (), iterations=iterations)
    better = 0.5 * lost * there.linear.chi2_by_segment < chi2
    if not better.any():
        return found
    states = np.where(better[:, None], there.estimate.initial, found.estimate.initial)
    again = fit(problem, found.estimate.changed(initial=states), found.free, iterations=iterations)
    return min(found, again, key=lambda one: one.chi2)


def student_weights(problem: Problem, found: Fit, freedom: float = 4.0) -> Array:
    """(samples, 2) Student-t weights of a fit's residuals, each against its own channel's spread.

    Source: Lange, Little & Taylor (1989), Robust statistical modeling using the t distribution, JASA 84, 881-896.
    """
    residual = problem.by_sample(found.linear.residual)
    read = [np.abs(residual[mine, axis]) for axis, mine in enumerate(problem.read.T)]
    spread = NORMAL_MAD * np.array([np.median(some) if len(some) else 1.0 for some in read])
    return (freedom + 1) / (freedom + (residual / spread) ** 2)
