"""Type aliases of NumPy arrays for signatures; the shapes are given in docstrings."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Array of floating-point numbers."""

Flags = NDArray[np.bool_]
"""Array of Boolean values."""

Integers = NDArray[np.int64]
"""Array of integers, for example indices and counts."""
