"""Pairing for crossover: parents by fitness, never two that are nearly the same, docs/theory.md (4)."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.search.hybrid_coding import fresh
from dpr_lab.search.problem import Bounds, Floats

INBREEDING_BELOW = 2
"""Parents that differ in fewer genes than this are too close: docs/theory.md (4)."""


def hamming_distance(x: Floats, y: Floats, tolerance: Floats | float = 0.0) -> NDArray[np.int_]:
    """Number of genes in which chromosomes differ.

    Args:
        x: (..., n) chromosomes
        y: (..., n) chromosomes
        tolerance: (n,) or one for all: genes apart by no more than this are equal

    Returns:
        (...) number of genes that differ

    Source: docs/theory.md (4); the published distance has no tolerance.
    """
    return np.count_nonzero(np.abs(x - y) > tolerance, axis=-1)


def inbred(x: Floats, y: Floats, tolerance: Floats | float = 0.0) -> NDArray[np.bool_]:
    """Whether chromosomes are too close to each other: a Hamming distance below 2 (below 1 for a single gene)."""
    return hamming_distance(x, y, tolerance) < min(INBREEDING_BELOW, x.shape[-1])


def pair(genes: Floats, fitness: Floats, pairs: int, box: Bounds, rng: np.random.Generator) -> tuple[Floats, Floats]:
    """Draw parents with chances proportional to fitness; replace the second of an inbred pair by a fresh chromosome.

    Args:
        genes: (M, n) population
        fitness: (M,) fitness of each individual; when all are 0 the chances are equal
        pairs: pairs wanted
        box: (2, n) lower and upper bound of each gene
        rng: source of randomness

    Returns:
        two (pairs, n) arrays, first and second parents

    Source: docs/theory.md (4) and step 5; chances in proportion to fitness are one reading.
    """
    total = fitness.sum()
    chances = fitness / total if total > 0 else None
    x, y = genes[rng.choice(len(genes), (2, pairs), p=chances)]
    return x, np.where(inbred(x, y)[:, None], fresh(pairs, box, rng), y)
