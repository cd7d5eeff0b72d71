"""From ratios to the nine parameters, and what fixed each.

A free swing fixes five numbers; the nine parameters have a four-dimensional family of equally good values. Measured
values (scale, calliper, knife edge) enter as priors with their standard uncertainty, the others as the bounds of the
search; a known added mass also makes b itself visible. What was estimated then updates that prior as a linear
observation (iterated extended Kalman update):

    K = P0 J^T (J P0 J^T + C)^-1,    Z = Z0 + K (q - q(Z0)),    P = P0 - K J P0

with q the ratios (and b), J = dq/dZ and C their covariance. A parameter that the data do not reach given the measured
ones keeps the spread of its bounds and is reported as fixed by nothing but them.
"""

from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from dpr_lab.dynamics.base import BASE, base_jacobian, base_parameters, ratio_jacobian, ratios
from dpr_lab.model import ParameterValue
from dpr_lab.rig import PARAMETERS, Rig

UNREACHED = 1e-6  # relative change along the null space that counts as "not fixed by the data"

_B = BASE.index("b")


def anchor(
    estimated: NDArray[np.float64], covariance: NDArray[np.float64], rig: Rig
) -> tuple[dict[str, ParameterValue], dict[str, ParameterValue]]:
    """The nine parameters nearest to the rig file's values that have the estimated ratios, and their base parameters.

    Args:
        estimated: (5,) ratios, or (6,) with b
        covariance: their covariance
        rig: nominal values, bounds, measured values and L1, g

    Returns:
        the nine parameters by name, and the six absolute base parameters by name
    """
    Z, P = _update(estimated, covariance, rig)
    loose = _loose(Z, len(estimated), rig)
    slopes = base_jacobian(Z, rig.rig.L1, rig.rig.g)
    base = base_parameters(Z, rig.rig.L1, rig.rig.g)
    nine = {
        name: _value(Z[i], P[i, i], _origin(loose[i]) if rig.searched[i] else "measured")
        for i, name in enumerate(PARAMETERS)
    }
    moved = (slopes * Z) @ loose / np.maximum(base, 1e-30)[:, None]
    absolute = {name: _value(base[i], slopes[i] @ P @ slopes[i], _origin(moved[i])) for i, name in enumerate(BASE)}
    return nine, absolute


def _origin(moved: NDArray[np.float64]) -> Literal["data", "bound"]:
    return "bound" if np.any(np.abs(moved) > UNREACHED) else "data"


def _value(value: np.float64, variance: np.float64, fixed_by: Literal["data", "measured", "bound"]) -> ParameterValue:
    std = None if fixed_by == "bound" else float(np.sqrt(max(variance, 0.0)))
    return ParameterValue(value=float(value), std=std, fixed_by=fixed_by)


def _loose(Z: NDArray[np.float64], observed: int, rig: Rig) -> NDArray[np.float64]:
    """(9, k) relative changes of the searched parameters that nothing observed can see."""
    scaled = _slopes(Z, observed, rig) * Z / np.maximum(_observed(Z, observed, rig), 1e-12)[:, None]
    directions = np.zeros((len(PARAMETERS), 0))
    if rig.searched.any():
        null = null_space(scaled[:, rig.searched], rcond=1e-9)
        directions = np.zeros((len(PARAMETERS), null.shape[1]))
        directions[rig.searched] = null
    return directions


def _update(
    estimated: NDArray[np.float64], covariance: NDArray[np.float64], rig: Rig
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    prior, P0 = rig.nominal, np.diag(_prior_std(rig) ** 2)
    Z, P = prior, P0
    for _ in range(30):
        J = _slopes(Z, len(estimated), rig)
        K = P0 @ J.T @ np.linalg.pinv(J @ P0 @ J.T + covariance, hermitian=True)
        innovation = estimated - _observed(Z, len(estimated), rig) - J @ (prior - Z)
        moved = np.maximum(prior + K @ innovation, 1e-3 * prior)
        P = P0 - K @ J @ P0
        if np.max(np.abs(moved - Z) / prior) < 1e-10:
            return moved, P
        Z = moved
    return Z, P


def _observed(Z: NDArray[np.float64], count: int, rig: Rig) -> NDArray[np.float64]:
    base = base_parameters(Z, rig.rig.L1, rig.rig.g)
    return np.append(ratios(base), base[_B])[:count]


def _slopes(Z: NDArray[np.float64], count: int, rig: Rig) -> NDArray[np.float64]:
    L1, g = rig.rig.L1, rig.rig.g
    return np.vstack([ratio_jacobian(Z, L1, g), base_jacobian(Z, L1, g)[_B]])[:count]


def _prior_std(rig: Rig) -> NDArray[np.float64]:
    lower, upper = rig.bounds
    measured = np.array([rig.parameters[name].std or 0.0 for name in PARAMETERS])
    return np.where(rig.searched, (upper - lower) / np.sqrt(12), measured)
