"""Weigh columns of readings and lay them out by segment, in one pass over memory."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.kernels import njit


@njit
def padded(values: NDArray[np.float64], weight: NDArray[np.float64], offsets: NDArray[np.int64]) -> NDArray[np.float64]:
    """(segments, longest, 2, k) from (samples, 2, k) and weights (samples, 2); short segments end in zeros."""
    longest = 0
    for s in range(len(offsets) - 1):
        longest = max(longest, offsets[s + 1] - offsets[s])
    found = np.zeros((len(offsets) - 1, longest, 2, values.shape[2]))
    for s in range(len(offsets) - 1):
        for n in range(offsets[s], offsets[s + 1]):
            for j in range(2):
                for k in range(values.shape[2]):
                    found[s, n - offsets[s], j, k] = values[n, j, k] * weight[n, j]
    return found
