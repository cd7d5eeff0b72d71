"""Covariance of fitted values due to noise and to the uncertainty of constants that are not fitted."""

from collections.abc import Sequence

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.projection import ColumnSpace


def considered(fit: Fit, inflation: float, changes: Sequence[Array] = ()) -> Array:
    """Compute the consider covariance of the fitted values.

        f V + sum over changes c of s_c s_c^T,    V = (A^T A + f P)^-1,    s_c = V A^T c

    A is the Jacobian with the initial states projected out, and P is the inverse covariance of the prior.

    Args:
        fit: the fit
        inflation: variance inflation factor f = n / n_eff, chi2 per independent observation
        changes: (segments, m) whitened changes of the readings, one standard deviation each

    Returns:
        (free, free) covariance; zero for values at their bound
    """
    A = fit.linear.A[:, :, fit.inside]
    inner = _inner(fit, inflation)
    covariance = inner * inflation
    for change in changes:
        shift = _shift(inner, A, change)
        covariance += np.outer(shift, shift)
    covariance_of_all = np.zeros((len(fit.free), len(fit.free)))
    covariance_of_all[np.ix_(fit.inside, fit.inside)] = covariance
    return covariance_of_all


def shifted(fit: Fit, change: Array) -> Array:
    """Return the (free,) change of the fitted values for a change of the predicted readings.

    Args:
        fit: the fit
        change: (segments, m) whitened change of the predicted readings
    """
    A, change_of_all = fit.linear.A[:, :, fit.inside], np.zeros(len(fit.free))
    change_of_all[fit.inside] = -_shift(_inner(fit, 1.0), A, change)
    return change_of_all


def _inner(fit: Fit, inflation: float) -> Array:
    """Return the (inside, inside) covariance of the values inside their bounds, divided by the inflation."""
    space = ColumnSpace.of(fit.linear.A[:, :, fit.inside], fit.linear.e)
    rows = inflation**0.5 * fit.prior[:, fit.inside]
    return space.with_prior(rows, np.zeros(len(rows))).covariance()


def _shift(inner: Array, A: Array, change: Array) -> Array:
    return inner @ (A.reshape(change.size, A.shape[2]).T @ change.ravel())
