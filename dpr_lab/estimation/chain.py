"""Chain of integrators driven by white noise: a kinematic model without rig parameters."""

import math

from dpr_lab.arrays import Array
from dpr_lab.estimation.live_velocity import CHAIN
from dpr_lab.kernels import njit

SAME_INTERVAL = 1e-8
"""Relative difference up to which two intervals count as equal; instants are sums of floating-point periods."""


@njit
def fill_chain(interval: float, f: Array, q: Array) -> None:
    """Write the exact transition matrix f and process noise q over an interval h.

        f_ij = h^(j-i) / (j-i)!,    q_ij = h^(l+r+1) / (l! r! (l+r+1)),    l = CHAIN-1-i,  r = CHAIN-1-j

    The white noise has unit strength.

    Args:
        interval: h, in the unit of time of the filter
        f: (CHAIN, CHAIN) transition matrix; must be zero below the diagonal
        q: (CHAIN, CHAIN) covariance of the process noise
    """
    for i in range(CHAIN):
        for j in range(CHAIN):
            left, right = CHAIN - 1 - i, CHAIN - 1 - j
            power = left + right + 1
            q[i, j] = interval**power / (math.gamma(left + 1.0) * math.gamma(right + 1.0) * power)
            if j >= i:
                f[i, j] = interval ** (j - i) / math.gamma(j - i + 1.0)
