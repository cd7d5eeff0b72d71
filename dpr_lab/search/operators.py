"""Operators of the improved genetic algorithm on chromosomes, docs/theory.md (3) to (5), (7) and (9).

Hybrid coding creates chromosomes on a coarse grid over the box, equation (3). Parents are selected by fitness and are
not nearly equal, equation (4). Crossover has variable precision, equation (5), and hybrid mutation changes one gene or
several genes, equation (7). Dynamic encoding creates chromosomes near the best one, equation (9). Feedback mutation
replaces near-duplicates, step (4) of the algorithm.
"""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.arrays import Array, Flags
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
    """Return whether pairs of chromosomes are too similar to be parents.

    The Hamming distance of such a pair is below 2, or below 1 if there is a single gene.
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


def cross(x: Array, y: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Cross each pair of chromosomes at one random gene, and swap the genes that follow.

        x_i' = beta x_i + (1 - beta) y_i,   y_i' = (1 - beta) x_i + beta y_i,   beta in {0, 0.1, ..., 1}

    Each crossover of a gene adds a decimal digit to the grid of hybrid coding, so that the precision increases during
    the search.

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


def around(best: Array, size: int, mu: float, nu: float, box: Bounds, rng: np.random.Generator) -> Array:
    """Return new chromosomes near the best chromosome by dynamic encoding.

    With the published settings, each gene differs by at most 5 % from that of the best chromosome.

        y_i = (mu + nu beta) x_i,   beta uniform on {0, 0.1, ..., 1}, clipped to the bounds

    The width of the range is proportional to the gene, which is suitable for parameters far from zero, such as masses
    and lengths.

    Args:
        best: (n,) best chromosome x
        size: number of new chromosomes
        mu: lower end of the range, as a share of the best gene
        nu: width of the range, as a share of the best gene
        box: (2, n) lower and upper bound of each gene
        rng: source of randomness

    Returns:
        (size, n) genes

    Source: docs/theory.md (9), restored: it fits the published mu = 0.95 and nu = 0.1.
    """
    beta = rng.choice(STEPS, (size, len(best)))
    return np.clip((mu + nu * beta) * best, *box)


def near_duplicates(genes: Array, tolerance: Array) -> Flags:
    """Return the (M,) mask of the chromosomes that nearly equal a better chromosome.

    Args:
        genes: (M, n) population, best first
        tolerance: (n,) largest difference at which two genes count as equal

    Returns:
        True if a better chromosome differs in fewer than two genes; False for the best chromosome
    """
    alike = inbred(genes[:, None], genes[None], tolerance)
    return np.any(np.tril(alike, k=-1), axis=1)


def replacements(best: Array, size: int, mu: float, nu: float, box: Bounds, rng: np.random.Generator) -> Array:
    """Return new chromosomes that replace near-duplicates.

    Each new chromosome is, with equal probability, near the best chromosome (dynamic encoding) or anywhere in the box
    (hybrid coding).

    Args:
        best: (n,) best chromosome
        size: number of new chromosomes
        mu: lower end of the dynamic range, as a share of the best gene
        nu: width of the dynamic range, as a share of the best gene
        box: (2, n) lower and upper bound of each gene
        rng: source of randomness

    Returns:
        (size, n) genes

    Source: docs/theory.md, step 4. The publication requires both kinds but does not state their probabilities. Equal
    probabilities are a choice of dpr-lab.
    """
    local = rng.random((size, 1)) < 0.5
    return np.where(local, around(best, size, mu, nu, box, rng), fresh(size, box, rng))
