"""Improved genetic algorithm (IGA), in the ten steps of docs/theory.md, section 2.

(1) Initialise by hybrid coding. (2) Sort by fitness. (3) Compute the population fitness. (4) Once the population has
converged: dynamic encoding and feedback mutation. (5) Pairing and crossover. (6) Orthogonal experiment. (7) Hybrid
mutation. (8) Steps (5) to (7) for M Pc / 2 offspring, all at once. (9) Merge and sort. (10) Keep the best M and repeat
from (3). Before convergence, step (4) of the publication requires "traditional mutation", interpreted here as the
mutation of step (7).
"""

from collections.abc import Iterator

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.search.fitness import fitness, population_fitness
from dpr_lab.search.operators import cross, fresh, mutate, near_duplicates, pair, replacements
from dpr_lab.search.orthogonal import Levels, array_for, experiment
from dpr_lab.search.population import Population, merged, ranked
from dpr_lab.search.problem import SearchProblem
from dpr_lab.search.settings import IgaSettings


def iga(problem: SearchProblem, settings: IgaSettings, rng: np.random.Generator) -> Iterator[Population]:
    """Yield the populations of the improved genetic algorithm.

    The cost of the best individual never increases.

    Raises:
        ConfigError: more genes are searched for than the orthogonal array has columns.

    Source: docs/theory.md, section 2.
    """
    levels = array_for(settings.orthogonal_array, problem.box.shape[1])
    genes = fresh(settings.population, problem.box, rng)  # step (1) of docs/theory.md, section 2
    population = ranked(genes, problem.costs(genes))  # step (2)
    while True:
        yield population
        if _converged(population, settings):  # steps (3) and (4)
            population = _refreshed(problem, population, settings, rng)
        offspring = _offspring(problem, population, levels, settings, rng)  # steps (5) to (8)
        population = merged(population, offspring).best(settings.population)  # steps (9) and (10)


def _fitness(population: Population, settings: IgaSettings) -> Array:
    return fitness(population.cost, settings.fitness_scale, settings.delta)


def _converged(population: Population, settings: IgaSettings) -> bool:
    """Return whether the population has converged: f_pop > alpha and f_optimal > sigma, step (4)."""
    f = _fitness(population, settings)
    return population_fitness(f) > settings.alpha and f[0] > settings.sigma


def _refreshed(
    problem: SearchProblem, population: Population, settings: IgaSettings, rng: np.random.Generator
) -> Population:
    """Replace near-duplicates by new chromosomes: dynamic encoding and feedback mutation, step (4)."""
    lower, upper = problem.box
    alike = near_duplicates(population.genes, settings.similarity * (upper - lower))
    best, count = population.genes[0], int(alike.sum())
    new = replacements(best, count, settings.mu, settings.nu, problem.box, rng)
    return merged(Population(population.genes[~alike], population.cost[~alike]), Population(new, problem.costs(new)))


def _offspring(
    problem: SearchProblem, population: Population, levels: Levels, settings: IgaSettings, rng: np.random.Generator
) -> Population:
    """Create all offspring of a generation, unsorted, by steps (5) to (7).

    Their number is M Pc / 2, with the population size M and the crossover rate Pc.
    """
    pairs = max(1, round(settings.population * settings.crossover_rate / 2))
    parents = pair(population.genes, _fitness(population, settings), pairs, problem.box, rng)  # step (5)
    crossed = cross(*parents, rng)
    offspring, costs = experiment(*crossed, levels, problem.costs)  # step (6)
    offspring, mutated = mutate(offspring, settings.mutation_rate, problem.box, rng)  # step (7)
    costs[mutated] = problem.costs(offspring[mutated])
    return Population(offspring, costs)
