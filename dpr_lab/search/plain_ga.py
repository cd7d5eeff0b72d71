"""Traditional genetic algorithm, for comparison with the improved one.

It uses tournament selection, single-point crossover, Gaussian mutation and elitism.
"""

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt

from dpr_lab.arrays import Array
from dpr_lab.search.population import Population, merged, ranked
from dpr_lab.search.problem import Bounds, SearchProblem
from dpr_lab.search.settings import SearchSettings, Share


class PlainGaSettings(SearchSettings, frozen=True):
    """Settings of the traditional genetic algorithm with real-valued genes."""

    algorithm: Literal["plain_ga"] = "plain_ga"
    generations: Annotated[int, Field(ge=0)] = 200
    """Maximum number of generations after the initial population."""
    population: Annotated[int, Field(ge=2)] = 100
    """Number of chromosomes in the population."""
    elite: PositiveInt = 2
    """Number of the best chromosomes that survive a generation unchanged."""
    tournament: PositiveInt = 3
    """Number of chromosomes in a tournament, whose winner becomes a parent."""
    crossover_rate: Share = 0.8
    """Share of the pairs of parents that are crossed."""
    mutation_rate: Share = 0.1
    """Share of the genes of the offspring that mutate."""
    mutation_std: PositiveFloat = 0.05
    """Standard deviation of the Gaussian mutation, as a share of the gene's range."""


def plain_ga(problem: SearchProblem, settings: PlainGaSettings, rng: np.random.Generator) -> Iterator[Population]:
    """Yield the populations of the traditional genetic algorithm.

    Source: Goldberg (1989), Genetic Algorithms in Search, Optimization and Machine Learning, chapter 1, with real genes
    instead of bits.
    """
    lower, upper = problem.box
    genes = rng.uniform(lower, upper, (settings.population, len(lower)))
    population = ranked(genes, problem.costs(genes))
    while True:
        yield population
        genes = _mutated(_crossed(population.genes, settings, rng), problem.box, settings, rng)
        offspring = Population(genes, problem.costs(genes))
        population = merged(population.best(settings.elite), offspring).best(settings.population)


def _crossed(genes: Array, settings: PlainGaSettings, rng: np.random.Generator) -> Array:
    """Return the (size, n) offspring of parents that are selected by tournaments.

    The rows of `genes` are sorted, best first, so the winner of a tournament is its lowest index.
    """
    size, n = genes.shape
    mothers, fathers = rng.integers(size, size=(2, size, settings.tournament)).min(axis=2)
    point = rng.integers(1, max(2, n), (size, 1))
    swaps = (rng.random((size, 1)) < settings.crossover_rate) & (np.arange(n) >= point)
    return np.where(swaps, genes[fathers], genes[mothers])


def _mutated(genes: Array, box: Bounds, settings: PlainGaSettings, rng: np.random.Generator) -> Array:
    lower, upper = box
    step = rng.normal(0, settings.mutation_std, genes.shape) * (upper - lower)
    mutates = rng.random(genes.shape) < settings.mutation_rate
    return np.clip(np.where(mutates, genes + step, genes), lower, upper)
