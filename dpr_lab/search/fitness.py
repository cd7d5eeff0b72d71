"""Cost and fitness, docs/theory.md (10)."""

from typing import Literal

import numpy as np

from dpr_lab.arrays import Array

FAILED_ABOVE = 1e100
"""A swing counts as diverged if its E exceeds this value; sums of such costs would overflow."""
AGGREGATES = {"sum": np.sum, "max": np.max, "min": np.min}


def cost(errors: Array, aggregate: Literal["sum", "max", "min"]) -> Array:
    """H(Z): one cost from the errors of all poses.

    Args:
        errors: (n, poses) E >= 0; NaN, `inf` and anything above `FAILED_ABOVE` mean that the candidate failed
        aggregate: combination of the poses

    Returns:
        (n,) H; `inf` for a candidate that failed in any pose, for any aggregate

    Source: docs/theory.md (10); the aggregate of the publication is lost; the sum is one interpretation.
    """
    failed = np.any(~(errors <= FAILED_ABOVE), axis=1, keepdims=True)
    return AGGREGATES[aggregate](np.where(failed, np.inf, errors), axis=1)


def fitness(costs: Array, scale: float, delta: float) -> Array:
    """Fitness of each individual, in the form of a signal-to-noise ratio; 0 for a failed one.

        f = M / (H + delta)

    Args:
        costs: (n,) H
        scale: M, largest fitness times delta
        delta: increases the selection probability of bad individuals

    Returns:
        (n,) f

    Source: docs/theory.md (10), restored from the text.
    """
    return scale / (costs + delta)
