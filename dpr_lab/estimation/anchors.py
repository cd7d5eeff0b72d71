"""From five ratios to the nine parameters, and what fixed each.

A free swing fixes five numbers; the nine parameters have a four-dimensional family of equally good values. Measured
values (scale, calliper, knife edge) enter as priors with their standard uncertainty, the others as the bounds of the
search. The ratios then update that prior as a linear observation (iterated extended Kalman update):

    K = P0 J^T (J P0 J^T + C)^-1,    Z = Z0 + K (r - r(Z0)),    P = P0 - K J P0

with J = dratios/dZ and C the covariance of the ratios. A parameter that the data do not reach given the measured ones
keeps the spread of its bounds and is reported as fixed by nothing but them.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from dpr_lab.dynamics.base import base_parameters, ratio_jacobian, ratios
from dpr_lab.model import ParameterValue
from dpr_lab.rig import PARAMETERS, Rig

UNREACHED = 1e-6  # share of a parameter's own direction in the null space that counts as "not fixed by the data"


def nine_parameters(
    estimated: NDArray[np.float64], covariance: NDArray[np.float64], rig: Rig
) -> dict[str, ParameterValue]:
    """The nine parameters nearest to the rig file's values that have the estimated ratios.

    Args:
        estimated: (5,) ratios
        covariance: (5, 5) their covariance
        rig: nominal values, bounds, measured values and L1, g
    """
    values, P = _update(estimated, covariance, rig)
    free = np.flatnonzero(rig.searched)
    null = null_space(_scaled_jacobian(values, rig)[:, free], rcond=1e-9)
    loose = {PARAMETERS[i] for i, row in zip(free, null, strict=True) if np.linalg.norm(row) > UNREACHED}
    return {
        name: ParameterValue(
            value=float(values[i]),
            std=None if name in loose else float(np.sqrt(P[i, i])),
            fixed_by="measured" if not rig.searched[i] else "bound" if name in loose else "data",
        )
        for i, name in enumerate(PARAMETERS)
    }


def _update(
    estimated: NDArray[np.float64], covariance: NDArray[np.float64], rig: Rig
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    prior, P0 = rig.nominal, np.diag(_prior_std(rig) ** 2)
    Z, P = prior, P0
    for _ in range(30):
        J = ratio_jacobian(Z, rig.rig.L1, rig.rig.g)
        K = P0 @ J.T @ np.linalg.pinv(J @ P0 @ J.T + covariance, hermitian=True)
        innovation = estimated - ratios(base_parameters(Z, rig.rig.L1, rig.rig.g)) - J @ (prior - Z)
        moved = np.maximum(prior + K @ innovation, 1e-3 * prior)
        P = P0 - K @ J @ P0
        if np.max(np.abs(moved - Z) / prior) < 1e-10:
            return moved, P
        Z = moved
    return Z, P


def _prior_std(rig: Rig) -> NDArray[np.float64]:
    lower, upper = rig.bounds
    measured = np.array([rig.parameters[name].std or 0.0 for name in PARAMETERS])
    return np.where(rig.searched, (upper - lower) / np.sqrt(12), measured)


def _scaled_jacobian(Z: NDArray[np.float64], rig: Rig) -> NDArray[np.float64]:
    r = ratios(base_parameters(Z, rig.rig.L1, rig.rig.g))
    return ratio_jacobian(Z, rig.rig.L1, rig.rig.g) * Z / np.maximum(r, 1e-12)[:, None]
