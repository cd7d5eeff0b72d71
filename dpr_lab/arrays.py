"""Types of arrays in signatures.

Docstrings state the shapes.
"""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Array of real numbers."""

Flags = NDArray[np.bool_]
"""Array of truth values."""

Integers = NDArray[np.int64]
"""Array of integers, for example indices and counts."""
