"""Dynamic encoding: new chromosomes close to the best chromosome, docs/theory.md (9)."""

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.search.hybrid_coding import STEPS
from dpr_lab.search.problem import Bounds


def around(best: Array, size: int, mu: float, nu: float, box: Bounds, rng: np.random.Generator) -> Array:
    """Return new chromosomes near the best chromosome.

    At the published settings, each gene differs by at most 5 %.

        y_i = (mu + nu beta) x_i,   beta uniform on {0, 0.1, ..., 1}, clipped to the bounds

    The range is a share of the gene's value. It is therefore suitable for parameters far from zero, such as masses and
    lengths.

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
