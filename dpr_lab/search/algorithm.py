"""Interface, main loop and common stopping rule of the search algorithms."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Generic, TypeVar

import numpy as np

from dpr_lab.search.fitness import cost, fitness, population_fitness
from dpr_lab.search.population import Population
from dpr_lab.search.problem import Bounds, Generation, Objective, SearchProblem
from dpr_lab.search.settings import SearchSettings

Settings = TypeVar("Settings", bound=SearchSettings)


@dataclass(frozen=True, slots=True)
class Algorithm(Generic[Settings]):
    """A search algorithm: its settings, and the generator of its populations."""

    settings: type[Settings]
    populations: Callable[[SearchProblem, Settings, np.random.Generator], Iterator[Population]]
    """Generator function that yields the initial population and then every further population, without end.

    The first individual of a population is the best individual so far.
    """
    words: str
    """Title of the algorithm."""

    def run(
        self, objective: Objective, bounds: Bounds, settings: Settings, rng: np.random.Generator
    ) -> Iterator[Generation]:
        """Search within the bounds for the candidate with the smallest cost H.

        The caller may stop the iteration at any generation.

        Args:
            objective: function from (n, d) candidates to (n, poses) errors E >= 0
            bounds: (2, d) lower and upper bound of each gene, equal for a fixed gene
            settings: population size, rates and constants
            rng: source of randomness; the same state gives the same generations

        Yields:
            the initial population as generation 0, then every generation up to `settings.generations` or stagnation

        Raises:
            ValueError: the bounds are not (2, d), not finite or reversed, or they all coincide.
        """
        problem = SearchProblem(objective, bounds, partial(cost, aggregate=settings.aggregate))
        return _generations(problem, self.populations(problem, settings, rng), settings)


def _generations(
    problem: SearchProblem, populations: Iterable[Population], settings: SearchSettings
) -> Iterator[Generation]:
    """Yield the recorded generations of a search until the last generation or stagnation."""
    best_costs: list[float] = []
    for number, population in enumerate(populations):
        best_costs.append(float(population.cost[0]))
        yield _recorded(number, problem, population, settings)
        if number == settings.generations or _stagnated(best_costs, settings):
            return


def _stagnated(best_costs: list[float], settings: SearchSettings) -> bool:
    """Return whether the best cost has stagnated.

    Its relative decrease over `stagnation_generations` is then at most `stagnation_improvement`.
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
