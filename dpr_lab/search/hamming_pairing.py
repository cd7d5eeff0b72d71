"""Pairing for crossover: parents selected by fitness and not nearly equal, docs/theory.md (4)."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.arrays import Array, Flags
from dpr_lab.search.hybrid_coding import fresh
from dpr_lab.search.problem import Bounds

INBREEDING_BELOW = 2
"""Minimum number of genes in which two parents must differ: docs/theory.md (4)."""


def hamming_distance(x: Array, y: Array, tolerance: Array | float = 0.0) -> NDArray[np.int_]:
    """Return the Hamming distance: the number of genes in which two chromosomes differ.

    Args:
        x: (..., n) chromosomes
        y: (..., n) chromosomes
        tolerance: (n,) or scalar: largest difference at which two genes count as equal

    Returns:
        (...) number of genes that differ

    Source: docs/theory.md (4); the published distance has no tolerance.
    """
    return np.count_nonzero(np.abs(x - y) > tolerance, axis=-1)


def inbred(x: Array, y: Array, tolerance: Array | float = 0.0) -> Flags:
    """Return whether two chromosomes are too similar to be parents.

    Their Hamming distance is then below 2, or below 1 if there is a single gene.
    """
    return hamming_distance(x, y, tolerance) < min(INBREEDING_BELOW, x.shape[-1])


def pair(genes: Array, fitness: Array, pairs: int, box: Bounds, rng: np.random.Generator) -> tuple[Array, Array]:
    """Draw pairs of parents with probability proportional to fitness.

    If the parents of a pair are nearly equal, a new chromosome replaces the second parent.

    Args:
        genes: (M, n) population
        fitness: (M,) fitness of each individual; if all are 0, the probabilities are equal
        pairs: number of pairs
        box: (2, n) lower and upper bound of each gene
        rng: source of randomness

    Returns:
        two (pairs, n) arrays, the first and the second parents

    Source: docs/theory.md (4) and step 5; probabilities proportional to fitness are one interpretation.
    """
    total = fitness.sum()
    chances = fitness / total if total > 0 else None
    x, y = genes[rng.choice(len(genes), (2, pairs), p=chances)]
    return x, np.where(inbred(x, y)[:, None], fresh(pairs, box, rng), y)
