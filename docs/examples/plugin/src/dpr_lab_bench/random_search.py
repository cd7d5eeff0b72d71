"""Search: the best of uniform random candidates, a baseline for other searches."""

from collections.abc import Iterator
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from dpr_lab.search.algorithm import Algorithm
from dpr_lab.search.population import Population, merged, ranked
from dpr_lab.search.problem import SearchProblem
from dpr_lab.search.settings import SearchSettings


class RandomSettings(SearchSettings, frozen=True):
    """Uniform random search."""

    algorithm: Literal["random"] = "random"
    generations: Annotated[int, Field(ge=0)] = 50
    population: Annotated[int, Field(ge=2)] = 100
    """Candidates drawn for each generation."""


def random_search(problem: SearchProblem, settings: RandomSettings, rng: np.random.Generator) -> Iterator[Population]:
    """Draw candidates, and keep the best of all."""
    lower, upper = problem.box
    best = Population(np.empty((0, len(lower))), np.empty(0))
    while True:
        genes = rng.uniform(lower, upper, (settings.population, len(lower)))
        best = merged(best, ranked(genes, problem.costs(genes))).best(settings.population)
        yield best


SEARCH = Algorithm(RandomSettings, random_search, "random search")
