"""Settings of a search (`configs/search/*.toml`); the defaults are the published ones (docs/theory.md)."""

from typing import Annotated, Literal

from pydantic import BaseModel, Field

Share = Annotated[float, Field(ge=0, le=1, allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Count = Annotated[int, Field(ge=1)]


class SearchSettings(BaseModel, extra="forbid", frozen=True):
    """Settings that all algorithms share."""

    algorithm: str
    generations: Annotated[int, Field(ge=0)] = 1000
    """Generations after the initial population, at most."""
    aggregate: Literal["sum", "max", "min"] = "sum"
    """How H is made from the E of the poses."""
    stagnation_generations: Count | None = None
    """Stop when the best cost has not decreased noticeably for so many generations; never when left out."""
    stagnation_improvement: Share = 0.01
    """Relative decrease of the best cost that does not count as progress."""
    delta: Positive = 35.0
    """Added to H in the fitness; the larger, the better the chances of bad individuals."""
    fitness_scale: Positive = 350.0
    """M of docs/theory.md (10), not published; with 350, sigma = 5 means H < 35."""


class IgaSettings(SearchSettings, frozen=True):
    """The improved genetic algorithm, in the symbols of docs/theory.md, section 2."""

    algorithm: Literal["iga"] = "iga"
    population: Annotated[int, Field(ge=2)] = 200
    """M, chromosomes in the population."""
    crossover_rate: Annotated[Share, Field(gt=0)] = 0.8
    """Pc; a generation has M Pc / 2 offspring."""
    mutation_rate: Share = 0.1
    """Pm, share of the offspring that mutate."""
    alpha: Share = 0.999
    """Dynamic encoding and feedback mutation wait until f_pop exceeds this."""
    sigma: NotNegative = 5.0
    """They also wait until the best fitness exceeds this."""
    mu: Positive = 0.95
    """Dynamic encoding starts at mu times the best gene."""
    nu: NotNegative = 0.1
    """Dynamic encoding ends at (mu + nu) times the best gene."""
    similarity: Share = 0.01
    """Genes closer than this share of their range count as equal in the feedback mutation."""
    orthogonal_array: Literal["L8", "L12", "L16"] = "L12"
    """Two-level array of the orthogonal experiment: so many trials for 7, 11 or 15 genes."""
