"""Types of arrays in signatures; docstrings give the shapes."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Real numbers."""

Flags = NDArray[np.bool_]
"""Truth values."""

Integers = NDArray[np.int64]
"""Integers, such as indices and counts."""
