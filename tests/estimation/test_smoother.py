"""Compiled smoother compared with filterpy and with methods without a filter."""

import math

import numpy as np
import pytest

from dpr_lab.estimation.chain import CHAIN, fill_chain
from dpr_lab.estimation.smoother import STATES, smooth_chains

THETA = [0, CHAIN]
NOISE = np.array([[1.0, 0.7], [0.7, 1.0]])
PRIOR = np.array([1.0, 30.0, 30.0, 30.0])
DIFFUSE = np.array([1.0, 1e7, 1e7, 1e7])


def transition(interval: float, snap: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Transition matrix and process noise (8, 8), from an independent closed form of a chain of integrators."""
    f = np.array([[interval ** (j - i) / math.factorial(j - i) if j >= i else 0.0 for j in range(4)] for i in range(4)])
    q = np.empty((4, 4))
    for i, j in np.ndindex(4, 4):
        left, right = 3 - i, 3 - j
        q[i, j] = interval ** (left + right + 1) / (math.factorial(left) * math.factorial(right) * (left + right + 1))
    return np.kron(np.eye(2), f), np.kron(np.diag(snap), q)


def by_filterpy(t, theta, noise, snap, prior):
    """Forward pass and `rts_smoother` of filterpy. The matrices of sample k describe the step from k - 1 to k."""
    from filterpy.kalman import KalmanFilter  # slow to import

    kalman = KalmanFilter(dim_x=STATES, dim_z=2)
    kalman.x = np.zeros(STATES)
    kalman.x[THETA] = theta[0]
    kalman.P = np.diag(np.tile(prior, 2))
    kalman.H = np.zeros((2, STATES))
    kalman.H[[0, 1], THETA] = 1.0
    kalman.R = noise
    matrices = [transition(h, s) for h, s in zip(np.diff(t), snap[1:], strict=True)]
    Fs, Qs = zip(matrices[0], *matrices, strict=True)
    means, covariances = [], []
    for k in range(len(t)):
        if k:
            kalman.predict(F=Fs[k], Q=Qs[k])
        kalman.update(theta[k])
        means.append(kalman.x)
        covariances.append(kalman.P)
    x, P, _, _ = kalman.rts_smoother(np.array(means), np.array(covariances), Fs=Fs, Qs=Qs)
    return x, P


def swing(kind: str, n: int = 400) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Instants in filter units, two noisy correlated angles, and the process noise of each sample."""
    rng = np.random.default_rng(5)
    intervals = np.full(n - 1, 0.3)
    if kind != "even":
        intervals = rng.uniform(0.1, 0.6, n - 1)
    if kind == "gap":
        intervals[n // 2] = 6.0
    t = np.concatenate([[0.0], np.cumsum(intervals)])
    theta = np.column_stack([30 * np.sin(0.4 * t), 20 * np.cos(0.5 * t)])
    theta += rng.standard_normal((n, 2)) @ np.linalg.cholesky(NOISE).T
    snap = np.column_stack([0.05 * 10 ** np.sin(0.1 * t), np.full(n, 0.2)])
    return t, theta, snap


@pytest.mark.parametrize("kind", ["even", "uneven", "gap"])
def test_forward_and_backward_pass_are_those_of_filterpy(kind):
    t, theta, snap = swing(kind)
    x = smooth_chains(t, theta, NOISE, snap, PRIOR)  # a diffuse one costs filterpy's inverse its digits
    expected_x, expected_P = by_filterpy(t, theta, NOISE, snap, PRIOR)
    std = np.sqrt(np.diagonal(expected_P, axis1=1, axis2=2))
    assert np.abs((x - expected_x) / std).max() < 1e-6


def test_states_are_those_of_batch_least_squares():
    """All states are estimated at once: from the prior of the first state, the transitions and the readings."""
    t, theta, snap = swing("uneven", 25)
    x = smooth_chains(t, theta, NOISE, snap, DIFFUSE)
    n, whiten = len(t), np.linalg.inv(np.linalg.cholesky(NOISE))
    first = np.zeros(STATES)
    first[THETA] = theta[0]
    rows = [np.eye(STATES, n * STATES) / np.sqrt(np.tile(DIFFUSE, 2))[:, None]]
    right = [first / np.sqrt(np.tile(DIFFUSE, 2))]
    for k in range(n):
        reading = np.zeros((2, n * STATES))
        reading[[0, 1], [k * STATES + i for i in THETA]] = 1.0
        rows.append(whiten @ reading)
        right.append(whiten @ theta[k])
        if k:
            F, Q = transition(t[k] - t[k - 1], snap[k])
            step = np.zeros((STATES, n * STATES))
            step[:, (k - 1) * STATES : (k + 1) * STATES] = np.hstack([-F, np.eye(STATES)])
            rows.append(np.linalg.inv(np.linalg.cholesky(Q)) @ step)
            right.append(np.zeros(STATES))
    A, b = np.vstack(rows), np.concatenate(right)
    scale = np.linalg.norm(A, axis=0)
    Q, R = np.linalg.qr(A / scale)
    expected = np.linalg.solve(R, Q.T @ b) / scale
    inverse = np.linalg.inv(R) / scale[:, None]
    std = np.linalg.norm(inverse, axis=1)
    assert np.abs((x.ravel() - expected) / std).max() < 1e-5


def test_states_stay_accurate_where_the_process_noise_changes_ten_million_fold():
    t = 0.1 * np.arange(4000)
    rng = np.random.default_rng(2)
    theta = 40 * np.exp(-t / 60)[:, None] * np.column_stack([np.sin(t), np.cos(1.3 * t)]) + rng.normal(0, 1, (4000, 2))
    snap = np.geomspace(100.0, 1e-5, 4000)[:, None] * np.ones(2)
    x = smooth_chains(t, theta, NOISE, snap, DIFFUSE)
    assert np.abs(x[:, THETA] - theta).max() < 6.0


def test_a_chain_over_two_intervals_is_the_chain_over_their_sum():
    parts = []
    for interval in (0.3, 0.5, 0.8):
        f, q = np.zeros((CHAIN, CHAIN)), np.empty((CHAIN, CHAIN))
        fill_chain(interval, f, q)
        parts.append((f, q))
    (f1, q1), (f2, q2), (f, q) = parts
    np.testing.assert_allclose(f2 @ f1, f, rtol=1e-14)
    np.testing.assert_allclose(f2 @ q1 @ f2.T + q2, q, rtol=1e-12)
