"""Update the nine parameters by the ratios (MAP), and determine their sources (docs/theory.md, equation 47).

A free swing determines five numbers. The nine parameters therefore form a four-dimensional family of equally good
values. Measured values (scale, calliper, knife edge) enter as priors with their standard uncertainty. For the other
parameters, the prior follows from the bounds of the search. A known added mass also makes b identifiable. The estimates
of the ratios then update this prior as an observation. The update (maximum a posteriori) consists of iterated extended
Kalman updates:

    K = P0 J^T (J P0 J^T + C)^-1,    Z = Z0 + K (q - q(Z0)),    P = P0 - K J P0

where Z are the parameters, Z0 their prior mean and P0 their prior covariance, q the ratios (and b), C the covariance of
the ratios, and J = dq/dZ. A parameter that neither data nor measured values determine keeps the standard deviation of
its bounds. It is reported as determined only by bounds.
"""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import BASE, RATIOS, base_jacobian, base_parameters, ratio_jacobian, whole_parameters
from dpr_lab.fitting.estimate import ON_ELBOW, unknown_ratios
from dpr_lab.fitting.prior import parameter_std, unknown_jacobian
from dpr_lab.identification.model import ParameterValue
from dpr_lab.rig import PARAMETERS, Rig

UNREACHED = 1e-6
"""Maximum relative change of a parameter along the null space for which the data determine the parameter.

The limit is far above rounding errors.
"""

_RELATIVE = (*range(len(RATIOS)), ON_ELBOW)


def update_prior(
    estimated: Array,
    covariance: Array,
    rig: Rig,
    visible: Sequence[int] | None = None,
) -> tuple[dict[str, ParameterValue], dict[str, ParameterValue]]:
    """Compute the most probable nine parameters, given the rig file and the estimated ratios.

    Args:
        estimated: (5,) ratios, or (6,) with b; or the unknowns with the indices `visible` in `UNKNOWN_RATIOS`
        covariance: (n, n) covariance of the estimated values
        rig: nominal values, bounds, measured values and L1, g
        visible: indices of the estimated unknowns; other ratios keep the values of the rig file

    Returns:
        the nine parameters by name, and the six absolute base parameters by name
    """
    places = list(range(len(estimated)) if visible is None else visible)
    Z, P = _update(estimated, covariance, rig, places)
    loose = _loose(Z, places, rig)
    slopes = base_jacobian(Z, rig.L1, rig.g)
    base = base_parameters(Z, rig.L1, rig.g)
    nine = {
        name: _value(Z[i], P[i, i], _origin(loose[i]) if rig.searched[i] else "measured")
        for i, name in enumerate(PARAMETERS)
    }
    moved = (slopes * Z) @ loose / np.maximum(base, 1e-30)[:, None]
    absolute = {name: _value(base[i], slopes[i] @ P @ slopes[i], _origin(moved[i])) for i, name in enumerate(BASE)}
    return nine, absolute


UNSURE = np.array([1e-3, 1e-3, 1e-3, 0.3, 0.3])
"""Assumed relative standard deviations of the five ratios a/b, d/b, e1/b, c1/b, c2/b when b is derived from them.

Those of the friction ratios are large, because other effects change these ratios most.
"""


def assumed_b(unknown: Array, rig: Rig) -> ParameterValue:
    """Return the most probable inertia b, kg m^2, given the rig file and five ratios.

    The ratios are the first values of `unknown`. b is the scale of all masses, inertias and torques.
    """
    values = unknown[: len(UNSURE)]
    _, base = update_prior(values, np.diag((UNSURE * np.maximum(values, 1e-3)) ** 2), rig)
    return base["b"]


def _origin(moved: Array) -> Literal["data", "bound"]:
    return "bound" if np.any(np.abs(moved) > UNREACHED) else "data"


def _value(value: np.float64, variance: np.float64, fixed_by: Literal["data", "measured", "bound"]) -> ParameterValue:
    std = None if fixed_by == "bound" else float(np.sqrt(max(variance, 0.0)))
    return ParameterValue(value=float(value), std=std, fixed_by=fixed_by)


def _loose(Z: Array, observed: list[int], rig: Rig) -> Array:
    """Find relative changes (9, k) of the searched parameters that do not change any observation."""
    scaled = unknown_jacobian(Z, rig)[observed] * Z / np.maximum(_unknowns(Z, rig)[observed], 1e-12)[:, None]
    directions = np.zeros((len(PARAMETERS), 0))
    if rig.searched.any():
        _, sizes, rows = np.linalg.svd(scaled[:, rig.searched])
        null = rows[np.count_nonzero(sizes > 1e-9 * sizes.max(initial=0.0)) :].T
        directions = np.zeros((len(PARAMETERS), null.shape[1]))
        directions[rig.searched] = null
    return directions


def _update(estimated: Array, covariance: Array, rig: Rig, places: list[int]) -> tuple[Array, Array]:
    prior, P0 = rig.nominal, np.diag(parameter_std(rig) ** 2)
    given = [] if set(range(len(RATIOS))) <= set(places) else [i for i in _RELATIVE if i not in places]
    estimated = np.append(estimated, _unknowns(prior, rig)[given])
    covariance = np.pad(covariance, (0, len(given)))
    places = places + given
    Z, P = prior, P0
    for _ in range(30):
        J = unknown_jacobian(Z, rig)[places]
        K = P0 @ J.T @ np.linalg.pinv(J @ P0 @ J.T + covariance, hermitian=True)
        innovation = estimated - _unknowns(Z, rig)[places] - J @ (prior - Z)
        moved = np.maximum(prior + K @ innovation, 1e-3 * prior)
        P = P0 - K @ J @ P0
        if np.max(np.abs(moved - Z) / prior) < 1e-10:
            return moved, P
        Z = moved
    return Z, P


def _unknowns(Z: Array, rig: Rig) -> Array:
    return unknown_ratios(whole_parameters(Z, rig.L1, rig.g))


def prior_ratio_std(rig: Rig) -> list[float]:
    """Compute the standard deviations (5,) of the ratios that follow from the rig file alone."""
    J = ratio_jacobian(rig.nominal, rig.L1, rig.g) * parameter_std(rig)
    return np.sqrt(np.sum(J**2, axis=1)).tolist()
