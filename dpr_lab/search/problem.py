"""Input and output of a search: common interface of all algorithms."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array, Flags
from dpr_lab.search.settings import SearchSettings

Settings = TypeVar("Settings", bound=SearchSettings)

Objective = Callable[[Array], Array]
"""(n, d) candidates -> (n, poses) E(Z) >= 0 of each candidate and pose, docs/theory.md (2); `inf` where one failed."""

Bounds = Array
"""(2, d) lower and upper bound of every gene; a gene whose bounds coincide is fixed."""


@dataclass(frozen=True, slots=True)
class Generation:
    """The state of a search after a generation; generation 0 is the initial population."""

    number: int
    evaluations: int
    """Candidates evaluated so far."""
    best: Array
    """(d,) best candidate so far."""
    best_cost: float
    """H of the best candidate, `inf` as long as every candidate failed."""
    best_fitness: float
    population_fitness: float
    """f_pop of docs/theory.md (8): 1 when the whole population is as good as its best."""
    population: Array
    """(size, d) candidates, best first."""
    cost: Array
    """(size,) H of each candidate of the population."""


@dataclass(frozen=True, slots=True)
class Algorithm(Generic[Settings]):
    """One row of `ALGORITHMS`: settings and function of a search.

    `run(objective, bounds, settings, rng)` yields generation 0 and then every generation, ends by itself at
    `settings.generations` or on stagnation, and may be stopped earlier by its consumer. It raises `ValueError`
    for bounds that are not (2, d), not finite, reversed, or all coincide.
    """

    settings: type[Settings]
    run: Callable[[Objective, Bounds, Settings, np.random.Generator], Iterator[Generation]]
    words: str
    """Title."""


@dataclass(slots=True)
class SearchProblem:
    """Objective inside a search: function of the free genes with one cost per candidate; counts its evaluations."""

    objective: Objective
    bounds: Bounds
    """(2, d) lower and upper bounds of all genes."""
    cost: Callable[[Array], Array]
    """(n, poses) E -> (n,) H."""
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
        """(size, n) free genes -> (size, d) with the fixed genes inserted."""
        genes_of_all = np.tile(self.bounds[0], (len(genes), 1))
        genes_of_all[:, self.free] = genes
        return genes_of_all

    def costs(self, genes: Array) -> Array:
        """(size, n) free genes -> (size,) H, `inf` for a candidate that failed; raises as `errors` does."""
        return self.cost(self.errors(genes)) if len(genes) else np.empty(0)

    def errors(self, genes: Array) -> Array:
        """(size, n) free genes, at least one -> (size, poses) E of the objective.

        Raises:
            ValueError: the objective did not return one row of E >= 0 for each candidate.
        """
        errors = np.asarray(self.objective(self.candidates(genes)), dtype=np.float64)
        if errors.ndim != 2 or len(errors) != len(genes) or not errors.size:
            raise ValueError(f"the objective must return ({len(genes)}, poses) values of E, not shape {errors.shape}")
        if (errors < 0).any():
            raise ValueError(f"E is a sum of squares, but the objective returned {np.nanmin(errors)}")
        self.evaluations += len(genes)
        return errors


def _checked(bounds: ArrayLike) -> Bounds:
    box = np.array(bounds, dtype=np.float64)
    if box.ndim != 2 or len(box) != 2:
        raise ValueError(f"bounds must be (2, d): lower and upper of every gene, not shape {box.shape}")
    if not np.isfinite(box).all():
        raise ValueError("bounds must be finite")
    if (box[0] > box[1]).any():
        raise ValueError(f"bounds are reversed for gene {int(np.argmax(box[0] > box[1]))}")
    return box
