"""Feedback mutation: replacement of near-duplicates in the population by new chromosomes, step (4)."""

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.search.dynamic_encoding import around
from dpr_lab.search.hamming_pairing import inbred
from dpr_lab.search.hybrid_coding import fresh
from dpr_lab.search.problem import Bounds


def near_duplicates(genes: Array, tolerance: Array) -> Flags:
    """Mask of chromosomes that nearly equal a previous one.

    Args:
        genes: (M, n) population, best first
        tolerance: (n,) maximum difference of equal genes

    Returns:
        (M,) True if a better chromosome differs in fewer than two genes; never for the best
    """
    alike = inbred(genes[:, None], genes[None], tolerance)
    return np.any(np.tril(alike, k=-1), axis=1)


def replacements(best: Array, size: int, mu: float, nu: float, box: Bounds, rng: np.random.Generator) -> Array:
    """New chromosomes, with equal probability near the best (dynamic encoding) or anywhere (hybrid coding).

    Args:
        best: (n,) best chromosome
        size: chromosomes wanted
        mu: start of the dynamic range, share of the best gene
        nu: width of the dynamic range, share of the best gene
        box: (2, n) lower and upper bound of each gene
        rng: source of randomness

    Returns:
        (size, n) genes

    Source: docs/theory.md, step 4. The publication requires both kinds without their probabilities; equal probabilities
    are a choice of dpr-lab.
    """
    local = rng.random((size, 1)) < 0.5
    return np.where(local, around(best, size, mu, nu, box, rng), fresh(size, box, rng))
