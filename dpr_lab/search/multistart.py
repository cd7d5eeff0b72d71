"""Multi-start local search (L-BFGS-B), for comparison with the genetic algorithm.

The starts are the best points of a Latin hypercube.
"""

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from dpr_lab.arrays import Array
from dpr_lab.search.fitness import cost
from dpr_lab.search.population import Population, latin_hypercube, merged
from dpr_lab.search.problem import SearchProblem
from dpr_lab.search.settings import SearchSettings

MAX_POWER = 16
"""Exponent p of the p-norm of the errors E of the poses, a smooth approximation of the largest E.

For three poses the p-norm exceeds the largest E by at most 3^(1/p) - 1 = 7.1 %.
"""


class MultistartSettings(SearchSettings, frozen=True):
    """Settings of a multi-start search, in which each generation is one local search."""

    algorithm: Literal["multistart"] = "multistart"
    generations: Annotated[int, Field(ge=0)] = 20
    """Maximum number of generations, each of which is one local search."""
    population: Annotated[int, Field(ge=2)] = 50
    """Number of points of a Latin hypercube. When all points have been used as starts, the next hypercube is drawn."""
    iterations: PositiveInt = 50
    """Maximum number of iterations of a local search."""
    difference: Annotated[PositiveFloat, Field(lt=0.1)] = 1e-6
    """Step of the finite differences, as a share of each gene's range."""


def multistart(problem: SearchProblem, settings: MultistartSettings, rng: np.random.Generator) -> Iterator[Population]:
    """Yield the populations of local searches from many starts.

    Generation 0 is a Latin hypercube. In each later generation, a local search starts from the best point that has not
    been a start, and its result replaces that point.

    Source: L-BFGS-B: Byrd, Lu, Nocedal & Zhu (1995), SIAM Journal on Scientific Computing 16(5), 1190-1208.
    """
    ends = Population(np.empty((0, problem.box.shape[1])), np.empty(0))
    while True:
        starts = latin_hypercube(problem, settings.population, rng)
        if not len(ends.genes):
            yield starts
        for number, (start, start_cost) in enumerate(zip(starts.genes, starts.cost, strict=True), start=1):
            ends = merged(ends, _descended(problem, start, start_cost, settings))
            waiting = Population(starts.genes[number:], starts.cost[number:])
            yield merged(ends, waiting).best(settings.population)


def _descended(problem: SearchProblem, start: Array, start_cost: float, settings: MultistartSettings) -> Population:
    """Return the end of a local search from `start`, as a population of one.

    If the cost of `start` is infinite, the individual is `start` itself.
    """
    if not np.isfinite(start_cost):
        return Population(start[None], np.array([start_cost]))
    from scipy.optimize import minimize

    lower, upper = problem.box

    def value_and_slope(share: Array) -> tuple[float, Array]:
        """Return cost and gradient from one batch.

        The batch contains the point and a neighbour along each gene.
        """
        inward = np.where(share < 0.5, settings.difference, -settings.difference)
        batch = np.vstack([share, share + np.diag(inward)])
        costs = _smooth_cost(problem.errors(np.clip(lower + batch * (upper - lower), lower, upper)), settings)
        if not np.isfinite(costs[0]):
            return wall, np.zeros(len(share))
        return float(costs[0]), np.where(np.isfinite(costs[1:]), costs[1:] - costs[0], 0.0) / inward

    share = (start - lower) / (upper - lower)
    wall = 10 * float(start_cost) + 1  # the cost of a failed point is finite, because the line search interpolates
    options = {"maxiter": settings.iterations}
    local = minimize(value_and_slope, share, method="L-BFGS-B", jac=True, bounds=[(0, 1)] * len(share), options=options)
    genes = np.clip(lower + local.x * (upper - lower), lower, upper)[None]
    return Population(genes, problem.costs(genes))


def _smooth_cost(errors: Array, settings: MultistartSettings) -> Array:
    """Return the (n,) smooth approximation of the cost H for the local search.

    A quasi-Newton method stalls at the kinks of the aggregate `max`. A smooth p-norm of the errors replaces it.
    """
    combined = cost(errors, settings.aggregate)
    if settings.aggregate != "max":
        return combined
    scale = np.where(np.isfinite(combined) & (combined > 0), combined, 1.0)
    shares = np.where(np.isfinite(combined)[:, None], errors, 0.0) / scale[:, None]
    return combined * (shares**MAX_POWER).sum(axis=1) ** (1 / MAX_POWER)
