"""Type aliases of NumPy arrays, and sums over few columns.

Docstrings state the shapes of arrays.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Array of floating-point numbers."""

Flags = NDArray[np.bool_]
"""Array of Boolean values."""

Integers = NDArray[np.int64]
"""Array of integers, for example indices and counts."""


def row_sums(values: Array) -> Array:
    """Return (n,) sums over few columns (n, k), several times faster than `values.sum(axis=1)`."""
    return sum(values.T[1:], values[:, 0])
