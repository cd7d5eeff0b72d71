"""Input and output of a search: objective, bounds and generations."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array, Flags

Objective = Callable[[Array], Array]
"""Function from (n, d) candidates to (n, poses) errors E(Z) >= 0, docs/theory.md (2); `inf` for a failed candidate."""

Bounds = Array
"""(2, d) lower and upper bound of every gene; a gene whose bounds coincide is fixed."""


@dataclass(frozen=True, slots=True)
class Generation:
    """State of a search after a generation; generation 0 is the initial population."""

    number: int
    evaluations: int
    """Number of candidates evaluated so far."""
    best: Array
    """(d,) best candidate so far."""
    best_cost: float
    """Cost H of the best candidate; `inf` if every candidate has failed so far."""
    best_fitness: float
    population_fitness: float
    """f_pop of docs/theory.md (8): 1 if all individuals are as fit as the best individual."""
    population: Array
    """(size, d) candidates, the best candidate first."""
    cost: Array
    """(size,) cost H of each candidate of the population."""


@dataclass(slots=True)
class SearchProblem:
    """Objective of a search as a function of the free genes, with a counter of its evaluations."""

    objective: Objective
    bounds: Bounds
    """(2, d) lower and upper bounds of all genes."""
    cost: Callable[[Array], Array]
    """Combination of the errors of all poses: (n, poses) E -> (n,) H."""
    free: Flags = field(init=False)
    """(d,) mask of the free genes."""
    evaluations: int = field(init=False, default=0)

    def __post_init__(self) -> None:
        self.bounds = _checked(self.bounds)
        self.free = self.bounds[0] < self.bounds[1]
        if not self.free.any():
            raise ValueError("nothing to search for: lower and upper bound of every gene coincide")

    @property
    def box(self) -> Bounds:
        """(2, n) bounds of the free genes."""
        return self.bounds[:, self.free]

    def candidates(self, genes: Array) -> Array:
        """Return the (size, d) candidates from (size, n) free genes, with the fixed genes inserted."""
        genes_of_all = np.tile(self.bounds[0], (len(genes), 1))
        genes_of_all[:, self.free] = genes
        return genes_of_all

    def costs(self, genes: Array) -> Array:
        """Return the (size,) costs H of candidates given by (size, n) free genes.

        The cost of a candidate that failed is `inf`.

        Raises:
            ValueError: the objective did not return one row of E >= 0 for each candidate.
        """
        if not len(genes):
            return np.empty(0)
        errors = np.asarray(self.objective(self.candidates(genes)), dtype=np.float64)
        if errors.ndim != 2 or len(errors) != len(genes) or not errors.size:
            raise ValueError(f"the objective must return ({len(genes)}, poses) values of E, not shape {errors.shape}")
        if (errors < 0).any():
            raise ValueError(f"E is a sum of squares, but the objective returned {np.nanmin(errors)}")
        self.evaluations += len(genes)
        return self.cost(errors)


def _checked(bounds: ArrayLike) -> Bounds:
    box = np.array(bounds, dtype=np.float64)
    if box.ndim != 2 or len(box) != 2:
        raise ValueError(f"bounds must be (2, d): lower and upper of every gene, not shape {box.shape}")
    if not np.isfinite(box).all():
        raise ValueError("bounds must be finite")
    if (box[0] > box[1]).any():
        raise ValueError(f"bounds are reversed for gene {int(np.argmax(box[0] > box[1]))}")
    return box
