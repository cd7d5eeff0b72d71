"""Compiled Kalman filter and Rauch-Tung-Striebel smoother for the chains of both rods.

The state x, with the covariance P, consists of the chains of rod 1 and rod 2. F and Q contain the matrices of
`dpr_lab.estimation.chain` on the diagonal. H selects the two angles, R is the covariance of their noise, and y is the
innovation. The forward pass is

    x- = F x,   P- = F P F^T + Q,    S = H P- H^T + R,   K = P- H^T S^-1,    x = x- + K y,   P = P- - K H P-

The backward pass, from the last sample but one to the first, is

    C = P F^T (P-)^-1,    x_s = x + C (x_s' - x-')

where ' denotes the next sample and the index s the smoothed values. P- is factored by Cholesky. Every inner loop runs
along a row of `STATES` numbers, and no sum changes its order. The compiler can therefore use vector registers in strict
arithmetic.

Source: H. E. Rauch, F. Tung & C. T. Striebel (1965), AIAA Journal 3(8), 1445-1450.
"""

import math

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.estimation.chain import CHAIN, SAME_INTERVAL, fill_chain
from dpr_lab.kernels import njit, subroutine

STATES = 2 * CHAIN
"""Number of states of both rods."""


@njit
def smooth_chains(
    t: Array,
    theta: Array,
    noise: Array,
    snap: Array,
    prior: Array,
) -> Array:
    """Estimate the states of both rods at every instant from all readings, in filter units.

    Args:
        t: (n,) increasing times
        theta: (n, 2) angles
        noise: (2, 2) covariance of a reading
        snap: (n, 2) process noise of each rod before each sample; the first row is not used
        prior: (CHAIN,) variance of each rod's state at the first reading, whose angle is that of the reading

    Returns:
        (n, STATES) states
    """
    n = len(t)
    x, P = np.empty((n, STATES)), np.empty((n, STATES, STATES))
    f, q = np.zeros((CHAIN, CHAIN)), np.empty((CHAIN, CHAIN))
    G, P_ahead, ahead = np.empty((STATES, STATES)), np.empty((STATES, STATES)), np.empty(STATES)
    for i in range(STATES):
        x[0, i] = theta[0, i // CHAIN] if i % CHAIN == 0 else 0.0
        for j in range(STATES):
            P[0, i, j] = prior[i % CHAIN] if i == j else 0.0
    interval = 0.0
    for k in range(n):
        if k:
            interval = _set_interval(t[k] - t[k - 1], interval, f, q)
            _predict(x[k - 1], P[k - 1], f, q, snap[k], x[k], P[k], G)
        _update(x[k], P[k], theta[k], noise)
    for k in range(n - 2, -1, -1):
        interval = _set_interval(t[k + 1] - t[k], interval, f, q)
        _predict(x[k], P[k], f, q, snap[k + 1], ahead, P_ahead, G)
        _solve(P_ahead, G)  # G becomes the transposed gain C^T
        for i in range(STATES):
            for j in range(STATES):
                x[k, j] += G[i, j] * (x[k + 1, i] - ahead[i])
    return x


@subroutine
def _set_interval(interval: float, before: float, f: Array, q: Array) -> float:
    """Recompute f and q if the interval has changed; return their interval."""
    if abs(interval - before) <= SAME_INTERVAL * before:
        return before
    fill_chain(interval, f, q)
    return interval


@subroutine
def _predict(
    x: Array,
    P: Array,
    f: Array,
    q: Array,
    snap: Array,
    x_ahead: Array,
    P_ahead: Array,
    G: Array,
) -> None:
    """Compute x_ahead = F x, P_ahead = F P F^T + Q and G = F P in place."""
    for i in range(STATES):
        x_ahead[i] = 0.0
        for m in range(i % CHAIN, CHAIN):
            x_ahead[i] += f[i % CHAIN, m] * x[i - i % CHAIN + m]
    _multiply(f, P, G)
    _multiply(f, G.T, P_ahead)  # F (F P)^T, because P is symmetric
    for rod in range(2):
        for i in range(CHAIN):
            for j in range(CHAIN):
                P_ahead[rod * CHAIN + i, rod * CHAIN + j] += snap[rod] * q[i, j]
    # the readings do not correct an asymmetry due to rounding, and the prediction amplifies it as t^6
    for i in range(STATES):
        for j in range(i):
            P_ahead[j, i] = P_ahead[i, j]


@subroutine
def _multiply(f: Array, A: Array, product: Array) -> None:
    """Set `product` to F A, where F has two equal, upper triangular diagonal blocks f."""
    for i in range(STATES):
        first = i - i % CHAIN
        for j in range(STATES):
            product[i, j] = A[i, j]
        for m in range(i % CHAIN + 1, CHAIN):
            for j in range(STATES):
                product[i, j] += f[i % CHAIN, m] * A[first + m, j]


@subroutine
def _update(x: Array, P: Array, theta: Array, noise: Array) -> None:
    """Update the state x and its covariance P by a reading, in place."""
    s11, s12, s22 = P[0, 0] + noise[0, 0], P[0, CHAIN] + noise[0, 1], P[CHAIN, CHAIN] + noise[1, 1]
    scale = 1.0 / (s11 * s22 - s12 * s12)
    i11, i12, i22 = s22 * scale, -s12 * scale, s11 * scale
    y1, y2 = theta[0] - x[0], theta[1] - x[CHAIN]
    of1, of2 = P[0].copy(), P[CHAIN].copy()
    for i in range(STATES):
        gain1, gain2 = of1[i] * i11 + of2[i] * i12, of1[i] * i12 + of2[i] * i22
        x[i] += gain1 * y1 + gain2 * y2
        for j in range(STATES):
            P[i, j] -= gain1 * of1[j] + gain2 * of2[j]


@subroutine
def _solve(A: Array, B: Array) -> None:
    """Compute B = A^-1 B in place for a symmetric positive definite A.

    A is overwritten by its Cholesky factor L, A = L L^T.
    """
    for i in range(STATES):
        for m in range(i):
            for j in range(i, STATES):
                A[j, i] -= A[j, m] * A[i, m]
        root = 1.0 / math.sqrt(A[i, i])
        for j in range(i, STATES):
            A[j, i] *= root
    for i in range(STATES):
        for m in range(i):
            for j in range(STATES):
                B[i, j] -= A[i, m] * B[m, j]
        for j in range(STATES):
            B[i, j] /= A[i, i]
    for i in range(STATES - 1, -1, -1):
        for m in range(i + 1, STATES):
            for j in range(STATES):
                B[i, j] -= A[m, i] * B[m, j]
        for j in range(STATES):
            B[i, j] /= A[i, i]
