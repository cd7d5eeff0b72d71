"""Hybrid coding: chromosomes on a coarse grid over the box, docs/theory.md (3)."""

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.search.problem import Bounds

STEPS = np.arange(11) / 10
"""Values of beta: 0, 0.1, ..., 1."""


def fresh(size: int, box: Bounds, rng: np.random.Generator) -> Array:
    """Return new chromosomes with genes from a grid of eleven values.

        x_i = L_i + beta (U_i - L_i),   beta uniform on {0, 0.1, ..., 1}

    L_i and U_i are the bounds of gene i.

    Args:
        size: number of new chromosomes
        box: (2, n) lower and upper bound of each gene
        rng: source of randomness

    Returns:
        (size, n) genes

    Source: docs/theory.md (3).
    """
    lower, upper = box
    beta = rng.choice(STEPS, (size, box.shape[1]))
    return np.clip(lower + beta * (upper - lower), lower, upper)
