"""Variable precision crossover, docs/theory.md (5)."""

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.search.hybrid_coding import STEPS


def cross(x: Array, y: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Cross each pair of chromosomes at one random gene, and swap the genes that follow.

        x_i' = beta x_i + (1 - beta) y_i,   y_i' = (1 - beta) x_i + beta y_i,   beta in {0, 0.1, ..., 1}

    Each crossover of a gene adds a decimal digit to the grid of hybrid coding. The precision therefore increases in the
    region of the search.

    Args:
        x: (pairs, n) first parents
        y: (pairs, n) second parents
        rng: source of randomness

    Returns:
        two (pairs, n) arrays of crossed chromosomes

    Source: docs/theory.md (5), restored from "convex set".
    """
    pairs, n = x.shape
    point = rng.integers(n, size=(pairs, 1))
    beta = rng.choice(STEPS, (pairs, 1))
    gene = np.arange(n)
    return (
        np.where(gene < point, x, np.where(gene > point, y, _between(x, y, beta))),
        np.where(gene < point, y, np.where(gene > point, x, _between(y, x, beta))),
    )


def _between(x: Array, y: Array, beta: Array) -> Array:
    # rounding must neither leave the box nor change equal genes
    return np.clip(beta * x + (1 - beta) * y, np.minimum(x, y), np.maximum(x, y))
