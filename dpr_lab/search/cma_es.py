"""Covariance matrix adaptation (CMA-ES) with restarts, for comparison with the genetic algorithm.

The package `cma` supplies the strategy through its ask-and-tell interface.
"""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from dpr_lab.search.fitness import FAILED_ABOVE
from dpr_lab.search.population import Population, merged, ranked
from dpr_lab.search.problem import SearchProblem
from dpr_lab.search.settings import SearchSettings

FEWEST_GENES = 2
"""Minimum number of dimensions that the package `cma` accepts; a dummy dimension is added to a single gene."""

LARGEST_GROWTH = 64
"""Largest population of a restart, as a multiple of the population of the first search."""


class CmaEsSettings(SearchSettings, frozen=True):
    """Settings of the covariance matrix adaptation.

    After each stop of the strategy, it restarts with a larger population (IPOP).
    """

    algorithm: Literal["cma_es"] = "cma_es"
    generations: Annotated[int, Field(ge=0)] = 500
    """Maximum number of generations after the first one, summed over all restarts."""
    population: Annotated[int, Field(ge=4)] | None = None
    """Number of candidates in a generation of the first search; default: 4 + 3 ln(number of genes)."""
    sigma: Annotated[PositiveFloat, Field(le=1)] = 0.3
    """Initial standard deviation of the candidates, as a share of each gene's range."""
    restart_growth: PositiveInt = 2
    """Factor by which the population grows at each restart, up to `LARGEST_GROWTH` times the first population."""


def cma_es(problem: SearchProblem, settings: CmaEsSettings, rng: np.random.Generator) -> Iterator[Population]:
    """Yield the populations of a search by CMA-ES.

    A population consists of the candidates of a generation and the best individual so far. A restart begins at a random
    point within the bounds.

    Source: Hansen (2016), The CMA Evolution Strategy: A Tutorial, arXiv:1604.00772; restarts: Auger & Hansen (2005),
    IEEE Congress on Evolutionary Computation, 1769-1776.
    """
    genes = problem.box.shape[1]
    best = Population(np.empty((0, genes)), np.empty(0))
    size = first = settings.population or 4 + int(3 * np.log(max(genes, FEWEST_GENES)))
    while True:
        for sample in _search(problem, size, settings.sigma, rng):
            population = merged(best, sample)
            best = population.best(1)
            yield population
        size = min(size * settings.restart_growth, LARGEST_GROWTH * first)


def _search(problem: SearchProblem, size: int, sigma: float, rng: np.random.Generator) -> Iterator[Population]:
    """Yield the populations of one search until a stopping criterion is met.

    The strategy works in the unit cube; its points are scaled to the bounds.
    """
    lower, upper = problem.box
    strategy = _strategy(len(lower), size, sigma, rng)
    while not strategy.stop():
        shares = strategy.ask()
        genes = np.clip(lower + np.array(shares)[:, : len(lower)] * (upper - lower), lower, upper)
        costs = problem.costs(genes)
        strategy.tell(shares, np.minimum(costs, FAILED_ABOVE).tolist())
        yield ranked(genes, costs)


def _strategy(genes: int, size: int, sigma: float, rng: np.random.Generator) -> Any:
    import cma  # the import takes one second

    dimension = max(genes, FEWEST_GENES)
    options = {
        "bounds": [0, 1],
        "BoundaryHandler": cma.BoundTransform,
        "popsize": size,
        "randn": lambda *shape: rng.standard_normal(shape),
        "seed": np.nan,  # a separate generator leaves numpy's global one unchanged
        "verbose": -9,
    }
    return cma.CMAEvolutionStrategy(rng.random(dimension), sigma, options)
