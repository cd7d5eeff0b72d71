"""Search: the best of uniform random candidates, a baseline for other searches."""

from collections.abc import Iterator
from functools import partial
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from dpr_lab.search.fitness import cost
from dpr_lab.search.generations import generations
from dpr_lab.search.population import Population, merged, ranked
from dpr_lab.search.problem import Algorithm, Bounds, Generation, Objective, SearchProblem
from dpr_lab.search.settings import SearchSettings


class RandomSettings(SearchSettings, frozen=True):
    """Uniform random search."""

    algorithm: Literal["random"] = "random"
    generations: Annotated[int, Field(ge=0)] = 50
    population: Annotated[int, Field(ge=2)] = 100
    """Candidates drawn for each generation."""


def random_search(
    objective: Objective, bounds: Bounds, settings: RandomSettings, rng: np.random.Generator
) -> Iterator[Generation]:
    """Draw candidates, and keep the best of all."""
    problem = SearchProblem(objective, bounds, partial(cost, aggregate=settings.aggregate))
    lower, upper = problem.box

    def drawn() -> Population:
        genes = rng.uniform(lower, upper, (settings.population, len(lower)))
        return ranked(genes, problem.costs(genes))

    def populations() -> Iterator[Population]:
        population = drawn()
        while True:
            yield population
            population = merged(population, drawn()).best(settings.population)

    return generations(problem, populations(), settings)


SEARCH = Algorithm(RandomSettings, random_search, "random search")
