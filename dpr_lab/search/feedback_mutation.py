"""Feedback mutation, step (4) of the algorithm: new chromosomes replace near-duplicates in the population."""

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.search.dynamic_encoding import around
from dpr_lab.search.hamming_pairing import inbred
from dpr_lab.search.hybrid_coding import fresh
from dpr_lab.search.problem import Bounds


def near_duplicates(genes: Array, tolerance: Array) -> Flags:
    """Return the mask of the chromosomes that nearly equal a better chromosome.

    Args:
        genes: (M, n) population, best first
        tolerance: (n,) largest difference at which two genes count as equal

    Returns:
        (M,) True if a better chromosome differs in fewer than two genes; always False for the best chromosome
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
