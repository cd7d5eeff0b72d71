"""Population fitness: mean fitness of the population relative to its best individual, docs/theory.md (8)."""

from dpr_lab.arrays import Array


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
