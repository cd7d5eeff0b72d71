"""Cost and fitness, docs/theory.md (10), and population fitness (8)."""

from typing import Literal

import numpy as np

from dpr_lab.arrays import Array

FAILED_ABOVE = 1e100
"""Largest error E of a candidate that did not fail; sums of larger errors could overflow."""
AGGREGATES = {"sum": np.sum, "max": np.max, "min": np.min}


def cost(errors: Array, aggregate: Literal["sum", "max", "min"]) -> Array:
    """Return the cost H(Z) of each candidate, combined from its errors in all poses.

    Args:
        errors: (n, poses) E >= 0; NaN, `inf` and every value above `FAILED_ABOVE` mean that the candidate failed
        aggregate: how the errors of the poses are combined

    Returns:
        (n,) H; `inf` for a candidate that failed in at least one pose, with every aggregate

    Source: docs/theory.md (10). The publication does not state the aggregate; the sum is one interpretation.
    """
    failed = np.any(~(errors <= FAILED_ABOVE), axis=1, keepdims=True)
    return AGGREGATES[aggregate](np.where(failed, np.inf, errors), axis=1)


def fitness(costs: Array, scale: float, delta: float) -> Array:
    """Return the fitness of each individual.

        f = M / (H + delta)

    The fitness is 0 for an individual that failed.

    Args:
        costs: (n,) H
        scale: M, the largest possible fitness times delta
        delta: constant added to H; it increases the selection probability of bad individuals

    Returns:
        (n,) f

    Source: docs/theory.md (10), restored from the text.
    """
    return scale / (costs + delta)


def population_fitness(fitness: Array) -> float:
    """Return the mean fitness of the population as a share of the largest fitness.

        f_pop = (1/M) sum_i f_i / f_optimal

    Args:
        fitness: (M,) fitness of each individual

    Returns:
        f_pop in 0..1; 0 if every individual failed

    Source: docs/theory.md (8).
    """
    best = float(fitness.max())
    return float((fitness / best).mean()) if best > 0 else 0.0  # divide first, so that rounding cannot give more than 1
