"""Log-likelihood of the angles of one rod, computed by a compiled Kalman filter.

The angles are modelled as a chain of integrators driven by white noise.
"""

import math

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.estimation.chain import CHAIN, SAME_INTERVAL, fill_chain
from dpr_lab.kernels import njit, subroutine


@njit
def log_likelihood(t: Array, theta: Array, snap: float, prior: Array) -> float:
    """Return the log-likelihood of the innovations y_k with variances S_k, up to a constant.

        -1/2 sum_k (log S_k + y_k^2 / S_k)

    All arguments are in filter units, in which the noise of a reading is 1. The first CHAIN readings only initialise
    the state and are not counted.

    Args:
        t: (n,) increasing times
        theta: (n,) angles
        snap: strength of the process noise
        prior: (CHAIN,) variance of the state at the first reading
    """
    x, P = np.zeros(CHAIN), np.diag(prior)
    x[0] = theta[0]
    f, Q, work = np.eye(CHAIN), np.zeros((CHAIN, CHAIN)), np.empty((CHAIN, CHAIN))
    total, interval = 0.0, 0.0
    for k in range(len(t)):
        if k:
            if abs(t[k] - t[k - 1] - interval) > SAME_INTERVAL * interval:
                interval = t[k] - t[k - 1]
                fill_chain(interval, f, Q)
                Q *= snap
            _predict(x, P, f, Q, work)
        variance = P[0, 0] + 1.0
        innovation = theta[k] - x[0]
        _update(x, P, innovation, variance)
        if k >= CHAIN:
            total -= 0.5 * (math.log(variance) + innovation * innovation / variance)
    return total


@subroutine
def _predict(
    x: Array,
    P: Array,
    f: Array,
    Q: Array,
    work: Array,
) -> None:
    """Advance state and covariance in place: x = f x, P = f P f^T + Q.

    f is upper triangular.
    """
    for i in range(CHAIN):
        ahead = 0.0
        for m in range(i, CHAIN):
            ahead += f[i, m] * x[m]
        x[i] = ahead
        for j in range(CHAIN):
            work[i, j] = 0.0
            for m in range(i, CHAIN):
                work[i, j] += f[i, m] * P[m, j]
    for i in range(CHAIN):
        for j in range(CHAIN):
            P[i, j] = Q[i, j]
            for m in range(j, CHAIN):
                P[i, j] += work[i, m] * f[j, m]


@subroutine
def _update(x: Array, P: Array, innovation: float, variance: float) -> None:
    for i in range(CHAIN - 1, -1, -1):
        gain = P[i, 0] / variance
        x[i] += gain * innovation
        for j in range(CHAIN):
            P[i, j] -= gain * P[0, j]
