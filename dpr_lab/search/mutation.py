"""Hybrid mutation, step (7) of the algorithm: one gene or several genes change."""

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.search.hybrid_coding import fresh
from dpr_lab.search.problem import Bounds


def mutate(genes: Array, rate: float, box: Bounds, rng: np.random.Generator) -> tuple[Array, Flags]:
    """Mutate some of the chromosomes: genes receive new values from the grid of hybrid coding.

    Each chromosome mutates with probability `rate`. With equal probability, either one gene changes, or a random number
    of genes between two and all.

    Args:
        genes: (size, n) chromosomes
        rate: Pm
        box: (2, n) lower and upper bound of each gene
        rng: source of randomness

    Returns:
        (size, n) genes, and the (size,) mask of the chromosomes that mutated

    Source: docs/theory.md (7); the number of genes in a multi-point mutation is a choice of dpr-lab.
    """
    size, n = genes.shape
    mutates = rng.random(size) < rate
    several = rng.integers(min(2, n), n + 1, size)
    points = np.where(rng.random(size) < 0.5, 1, several)
    order = rng.permuted(np.tile(np.arange(n), (size, 1)), axis=1)
    chosen = mutates[:, None] & (order < points[:, None])
    return np.where(chosen, fresh(size, box, rng), genes), mutates
