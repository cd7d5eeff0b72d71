"""Weight the readings of each segment, and whiten them if there is process noise.

Noise of the inputs accumulates along a swing. Its effect on the readings of sample k is C_k z_k, where z_k is a sum of
independent steps of covariance D_k in the coordinates of the initial state. The errors of the readings of one segment
are therefore correlated. A Kalman filter converts the weighted readings y to innovations e of unit variance, one
reading after the other,

    P <- P + D_k,    e = (y - C z) / sqrt(S),    S = 1 + C P C^T,    z <- z + P C^T (y - C z) / S

where P is the covariance of z. The result is the same as multiplication by the inverse Cholesky factor of the
covariance of the readings, but the filter takes linear time.

A film from a camera that is not fixed has another correlated error: the picture turns slowly. In one segment, the
angle of the picture is a straight line. Its value and its change over half of the segment have the standard deviation
s. The columns of C are the changes of the weighted readings per unit of each. The covariance of the weighted readings
is I + s^2 C C^T.

Source: F. C. Schweppe (1965), Evaluation of likelihood functions for Gaussian signals, IEEE Trans. Inf. Theory 11.
"""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.kernels import njit


@dataclass(frozen=True, slots=True, eq=False)
class Disturbance:
    """Effect of the noise of the inputs on the readings of segments."""

    walk: Array
    """(samples, 4, 4) D: covariance added since the previous sample, in the coordinates of the initial state."""
    out: Array
    """(samples, 2, 4) C: derivative of the readings with respect to the coordinates of the initial state."""
    shared: Array
    """(samples, 2) effect of a common error of a sample on both readings, one standard deviation, rad."""


def padded(values: Array, weight: Array, offsets: Integers) -> Array:
    """Weight values (samples, axes, k), and arrange them by segment.

    The result has the shape (segments, longest, axes, k), the weights have the shape (samples, axes).
    """
    blocks = np.zeros((len(offsets) - 1, int(np.diff(offsets).max()), weight.shape[1], values.shape[2]))
    _weigh(values, weight, offsets, blocks)
    return blocks


@njit(allocates=False)
def _weigh(values: Array, weight: Array, offsets: Integers, blocks: Array) -> None:
    for s in range(len(offsets) - 1):
        for n in range(offsets[s], offsets[s + 1]):
            for j in range(weight.shape[1]):
                for k in range(values.shape[2]):
                    blocks[s, n - offsets[s], j, k] = values[n, j, k] * weight[n, j]


@njit
def innovations(columns: Array, weight: Array, offsets: Integers, walk: Array, out: Array, shared: Array) -> float:
    """Whiten the result of `padded` in place, given the process noise of the same samples.

    Returns:
        the sum of log S over all innovations, where S is the variance of an innovation
    """
    volume = 0.0
    count = columns.shape[3]
    # four components of the random walk; the fifth is the common error of both readings, new for each sample
    C, PC, P, z = np.empty(5), np.empty(5), np.empty((5, 5)), np.empty((5, count))
    for s in range(len(offsets) - 1):
        P[:], z[:] = 0.0, 0.0
        for n in range(offsets[s], offsets[s + 1]):
            P[4], P[:, 4], z[4] = 0.0, 0.0, 0.0
            P[4, 4] = 1.0
            for a in range(4):
                for b in range(4):
                    P[a, b] += walk[n, a, b]
            for j in range(2):
                S = 1.0
                for a in range(4):
                    C[a] = weight[n, j] * out[n, j, a]
                C[4] = weight[n, j] * shared[n, j]
                for a in range(5):
                    PC[a] = P[a, 0] * C[0] + P[a, 1] * C[1] + P[a, 2] * C[2] + P[a, 3] * C[3] + P[a, 4] * C[4]
                    S += C[a] * PC[a]
                S = max(S, 1.0)
                volume += np.log(S)
                row = columns[s, n - offsets[s], j]
                for k in range(count):
                    row[k] -= C[0] * z[0, k] + C[1] * z[1, k] + C[2] * z[2, k] + C[3] * z[3, k] + C[4] * z[4, k]
                for a in range(5):
                    for k in range(count):
                        z[a, k] += PC[a] / S * row[k]
                    for b in range(5):
                        P[a, b] -= PC[a] * PC[b] / S
                for k in range(count):
                    row[k] /= np.sqrt(S)
    return volume


def turned_picture(t: Array, turned: Array, weight: Array, offsets: Integers) -> tuple[Array, Array]:
    """Return the weighted errors of readings by a slowly turning picture, for a unit angle.

    Args:
        t: (samples,) times, s
        turned: (axes,) change of the readings by a unit rotation of the picture
        weight: (samples, axes) reciprocal standard deviation of each reading, 1/rad
        offsets: (segments + 1,) index of the first sample of each segment, then the number of samples

    Returns:
        (segments, m, 2) orthonormal columns, and (segments, 2) their sizes, the roots of the eigenvalues of C C^T
    """
    first, last = t[offsets[:-1]], t[offsets[1:] - 1]
    owner = np.repeat(np.arange(len(first)), np.diff(offsets))
    since_middle = (2 * t - first[owner] - last[owner]) / np.maximum(last - first, np.finfo(float).tiny)[owner]
    line = np.column_stack([np.ones_like(t), since_middle])
    columns = padded(turned[:, None] * line[:, None, :], weight, offsets)
    U, sizes, _ = np.linalg.svd(columns.reshape(len(first), -1, 2), full_matrices=False)
    return U, sizes
