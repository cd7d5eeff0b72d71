"""Generations of a search with the stopping rule that all algorithms share."""

from collections.abc import Iterable, Iterator

from dpr_lab.search.fitness import fitness
from dpr_lab.search.population import Population
from dpr_lab.search.population_fitness import population_fitness
from dpr_lab.search.problem import Generation, SearchProblem
from dpr_lab.search.settings import SearchSettings


def generations(
    problem: SearchProblem, populations: Iterable[Population], settings: SearchSettings
) -> Iterator[Generation]:
    """Record the populations of a search, numbered, until it ends or stagnates.

    Args:
        problem: the search problem; it supplies the number of evaluations and the fixed genes
        populations: infinite sequence, the initial population first; each population is computed on demand, and its
            first row is the best individual so far
        settings: stopping rule and constants of the fitness
    """
    best_costs: list[float] = []
    for number, population in enumerate(populations):
        best_costs.append(float(population.cost[0]))
        yield _recorded(number, problem, population, settings)
        if number == settings.generations or _stagnated(best_costs, settings):
            return


def _stagnated(best_costs: list[float], settings: SearchSettings) -> bool:
    """Return whether the search stagnates.

    The search stagnates if the relative decrease of the best cost over `stagnation_generations` is at most
    `stagnation_improvement`.
    """
    patience = settings.stagnation_generations
    if patience is None or len(best_costs) <= patience:
        return False
    return best_costs[-1] >= (1 - settings.stagnation_improvement) * best_costs[-1 - patience]


def _recorded(number: int, problem: SearchProblem, population: Population, settings: SearchSettings) -> Generation:
    f = fitness(population.cost, settings.fitness_scale, settings.delta)
    candidates = problem.candidates(population.genes)
    return Generation(
        number=number,
        evaluations=problem.evaluations,
        best=candidates[0],
        best_cost=float(population.cost[0]),
        best_fitness=float(f[0]),
        population_fitness=population_fitness(f),
        population=candidates,
        cost=population.cost,
    )
