"""Differential evolution of scipy, for comparison with the genetic algorithm."""

from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, NonNegativeFloat

from dpr_lab.arrays import Array
from dpr_lab.search.fitness import FAILED_ABOVE
from dpr_lab.search.population import Population, latin_hypercube, ranked
from dpr_lab.search.problem import Bounds, SearchProblem
from dpr_lab.search.settings import SearchSettings, Share


class DifferentialEvolutionSettings(SearchSettings, frozen=True):
    """Settings of differential evolution.

    Names and defaults are those of scipy, except the default population size.
    """

    algorithm: Literal["differential_evolution"] = "differential_evolution"
    generations: Annotated[int, Field(ge=0)] = 300
    """Maximum number of generations after the initial population."""
    population: Annotated[int, Field(ge=5)] = 50
    """Number of individuals in the population."""
    strategy: Literal["best1bin", "rand1bin", "currenttobest1bin", "randtobest1bin", "best2bin", "rand2bin"] = (
        "best1bin"
    )
    """Strategy that constructs the trial vectors, by its name in scipy."""
    mutation: tuple[NonNegativeFloat, NonNegativeFloat] = (0.5, 1.0)
    """Range from which the differential weight is drawn, once for each generation."""
    recombination: Share = 0.7
    """Share of the genes of a trial vector that come from its mutant."""


def differential_evolution(
    problem: SearchProblem, settings: DifferentialEvolutionSettings, rng: np.random.Generator
) -> Iterator[Population]:
    """Yield the populations of a search by differential evolution.

    Source: Storn & Price (1997), Journal of Global Optimization 11, 341-359.
    """
    population = latin_hypercube(problem, settings.population, rng)
    while True:
        yield population
        trials = _trials(population, problem.box, settings, rng)
        costs = problem.costs(trials)
        wins = costs <= population.cost
        genes = np.where(wins[:, None], trials, population.genes)
        population = ranked(genes, np.where(wins, costs, population.cost))


def _trials(
    population: Population, box: Bounds, settings: DifferentialEvolutionSettings, rng: np.random.Generator
) -> Array:
    """Return the (size, n) trial vectors, one for each individual.

    scipy has no function for a single generation. It therefore receives the population with its known costs and runs
    one iteration, in which it evaluates only the trials.
    """
    from scipy import optimize

    evaluated: list[Array] = []

    def known_then_none(columns: Array) -> Array:
        evaluated.append(columns.T)
        return np.minimum(population.cost, FAILED_ABOVE) if len(evaluated) == 1 else np.zeros(len(population.cost))

    init: Any = population.genes  # the type is str in scipy's signature
    optimize.differential_evolution(
        known_then_none,
        box.T,
        init=init,
        strategy=settings.strategy,
        mutation=settings.mutation,
        recombination=settings.recombination,
        maxiter=1,
        polish=False,
        updating="deferred",
        vectorized=True,
        rng=rng,
    )
    return np.clip(evaluated[1], *box)
