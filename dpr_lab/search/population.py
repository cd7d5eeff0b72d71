"""A population: chromosomes with their costs, best first."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.search.problem import Floats


@dataclass(frozen=True, slots=True)
class Population:
    """Chromosomes sorted by cost, which is descending fitness; equal costs keep their order."""

    genes: Floats
    """(size, n) free genes."""
    cost: Floats
    """(size,) H."""

    def best(self, size: int) -> "Population":
        """The first `size` individuals."""
        return Population(self.genes[:size], self.cost[:size])


def ranked(genes: Floats, cost: Floats) -> Population:
    """A population from chromosomes in any order."""
    order = np.argsort(cost, kind="stable")
    return Population(genes[order], cost[order])
