"""Fits that are robust against a few outlying readings or segments."""

from dataclasses import replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.fitting.gauss_newton import GAUSS_NEWTON, Fit, GaussNewton, descend, fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.uncompiled import NORMAL_MAD


def without_outstanding(
    problem: Problem,
    first_fit: Fit,
    *,
    iterations: int = 12,
    outstanding: float = 9.0,
    settings: GaussNewton = GAUSS_NEWTON,
) -> Fit:
    """Fit with down-weighted outlying segments, then refit all segments from the result.

    Without this, a single swing that passes near the upright position can keep all parameters in a local minimum.

    Args:
        problem: measured readings, weights and model
        first_fit: fit of all segments
        iterations: maximum number of iterations of each of the two fits
        outstanding: ratio of the chi2 of a segment to the median above which the segment is down-weighted
        settings: tolerances of both fits; `to_beat` is a chi2 of `problem` and applies to the second fit

    Returns:
        the better of the first fit and the refit
    """
    worst = relative_chi2(first_fit)
    if not (worst > outstanding).any():
        return first_fit
    lighter = 1 / np.sqrt(np.maximum(worst, 1.0))
    eased = problem.weighted(lighter[problem.owner, None])
    free = first_fit.free
    easing = replace(settings, to_beat=np.inf)
    relocated = descend(eased, first_fit.estimate, free, iterations=iterations, settings=easing)
    start, predicted = relocated.estimate, relocated.predicted
    race = replace(settings, to_beat=min(first_fit.chi2, settings.to_beat), race=True)
    refit = fit(problem, start, free, iterations=iterations, predicted=predicted, settings=race)
    return min(first_fit, refit, key=_lost_and_chi2)


def relative_chi2(fitted: Fit) -> Array:
    """Return the (segments,) chi2 of each segment relative to the median.

    The median is that of the segments that the model can simulate. The value is inf for a segment whose simulation
    fails.
    """
    chi2 = np.nan_to_num(fitted.linear.chi2_by_segment, nan=np.inf, posinf=np.inf)
    finite = chi2[np.isfinite(chi2)]
    median = float(np.median(finite)) if len(finite) else 1.0
    with np.errstate(over="ignore"):
        return chi2 / max(median, float(np.finfo(np.float64).tiny))


def refit_lost(problem: Problem, first_fit: Fit, initial: Array, *, iterations: int = 20, lost: float = 9.0) -> Fit:
    """Refit segments that ended in a local minimum, starting from other initial states.

    Args:
        problem: measured readings, weights and model
        first_fit: fit of all segments
        initial: (segments, 4) other initial states
        iterations: maximum number of iterations of each of two fits
        lost: ratio of the chi2 of a segment to the median above which the segment may be in an incorrect minimum; the
            new chi2 must be lower by half of this factor

    Returns:
        the better of the first fit and the refit
    """
    chi2 = np.nan_to_num(first_fit.linear.chi2_by_segment, nan=np.inf)
    if not (relative_chi2(first_fit) > lost).any():
        return first_fit
    relocated = fit(problem, first_fit.estimate.changed(initial=initial), (), iterations=iterations)
    better = 0.5 * lost * relocated.linear.chi2_by_segment < chi2
    if not better.any():
        return first_fit
    states = np.where(better[:, None], relocated.estimate.initial, first_fit.estimate.initial)
    refit = fit(problem, first_fit.estimate.changed(initial=states), first_fit.free, iterations=iterations)
    return min(first_fit, refit, key=_lost_and_chi2)


def _lost_and_chi2(fitted: Fit) -> tuple[int, float]:
    """Return the number of segments whose simulation fails, and the chi2 of the other segments."""
    chi2 = fitted.linear.chi2_by_segment
    followed = np.isfinite(chi2)
    return int(np.count_nonzero(~followed)), float(chi2[followed].sum())


def student_weights(problem: Problem, first_fit: Fit, freedom: float = 4.0) -> Array:
    """Return the (samples, 2) Student-t weights of the residuals, which are scaled by the spread of each encoder.

    Source: Lange, Little & Taylor (1989), Robust statistical modeling using the t distribution, JASA 84, 881-896.
    """
    residual = problem.by_sample(first_fit.linear.residual)
    read = [np.abs(residual[used, axis]) for axis, used in enumerate(problem.read.T)]
    spread = NORMAL_MAD * np.array([np.median(errors) if len(errors) else 1.0 for errors in read])
    return (freedom + 1) / (freedom + (residual / spread) ** 2)
