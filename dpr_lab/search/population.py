"""Populations of chromosomes with their costs, sorted by cost."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array


@dataclass(frozen=True, slots=True)
class Population:
    """Chromosomes with their costs, the best chromosome first."""

    genes: Array
    """(size, n) values of the free genes."""
    cost: Array
    """(size,) cost H of each chromosome, ascending."""

    def best(self, size: int) -> "Population":
        """Return a population of the best `size` individuals."""
        return Population(self.genes[:size], self.cost[:size])


def ranked(genes: Array, cost: Array) -> Population:
    """Sort chromosomes by cost into a population; chromosomes of equal cost keep their order."""
    order = np.argsort(cost, kind="stable")
    return Population(genes[order], cost[order])


def merged(first: Population, second: Population) -> Population:
    """Merge two populations, best first.

    If two individuals have equal costs, the individual from `first` comes first.
    """
    return ranked(np.vstack([first.genes, second.genes]), np.concatenate([first.cost, second.cost]))
