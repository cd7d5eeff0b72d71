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
    """Maximum number of generations after the initial population."""
    aggregate: Literal["sum", "max", "min"] = "sum"
    """Combination of the E of the poses to H."""
    stagnation_generations: Count | None = None
    """Stop if the best cost has not decreased noticeably for this number of generations; default: never."""
    stagnation_improvement: Share = 0.01
    """Relative decrease of the best cost that does not count as progress."""
    delta: Positive = 35.0
    """Constant added to H in the fitness; a larger value increases the selection probability of bad individuals."""
    fitness_scale: Positive = 350.0
    """M of docs/theory.md (10), not published. With 350, the fitness threshold sigma = 5 corresponds to H < 35."""


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
    """Dynamic encoding and feedback mutation are used if f_pop exceeds this value."""
    sigma: NotNegative = 5.0
    """Dynamic encoding and feedback mutation are used if the best fitness exceeds this value."""
    mu: Positive = 0.95
    """Lower end of dynamic encoding: mu times the best gene."""
    nu: NotNegative = 0.1
    """Upper end of dynamic encoding: (mu + nu) times the best gene."""
    similarity: Share = 0.01
    """Maximum difference, relative to the range, of genes that count as equal in the feedback mutation."""
    orthogonal_array: Literal["L8", "L12", "L16"] = "L12"
    """Two-level array of the orthogonal experiment: number of trials for 7, 11 or 15 genes."""
