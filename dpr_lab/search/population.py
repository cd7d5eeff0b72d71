"""A population: chromosomes with their costs, best first."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array


@dataclass(frozen=True, slots=True)
class Population:
    """Chromosomes with their costs, best first."""

    genes: Array
    """(size, n) free genes."""
    cost: Array
    """(size,) cost H of each chromosome."""

    def best(self, size: int) -> "Population":
        """The first `size` individuals."""
        return Population(self.genes[:size], self.cost[:size])


def ranked(genes: Array, cost: Array) -> Population:
    """Sort chromosomes by cost into a population; the sort is stable."""
    order = np.argsort(cost, kind="stable")
    return Population(genes[order], cost[order])


def merged(first: Population, second: Population) -> Population:
    """Merge two populations, best first; at equal cost `first` comes first."""
    return ranked(np.vstack([first.genes, second.genes]), np.concatenate([first.cost, second.cost]))
