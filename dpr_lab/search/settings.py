"""Settings of a search (`configs/search/*.toml`); the defaults are the published values (docs/theory.md)."""

from typing import Annotated, Literal

from pydantic import BaseModel, Field, NonNegativeFloat, PositiveFloat, PositiveInt

Share = Annotated[float, Field(ge=0, le=1)]


class SearchSettings(BaseModel, extra="forbid", frozen=True, allow_inf_nan=False):
    """Settings that all algorithms share."""

    algorithm: str
    generations: Annotated[int, Field(ge=0)] = 1000
    """Maximum number of generations after the initial population."""
    aggregate: Literal["sum", "max", "min"] = "sum"
    """Combination of the errors E of the poses to the cost H."""
    stagnation_generations: PositiveInt | None = None
    """Number of generations over which the best cost must decrease, or the search stops; None: no such stop."""
    stagnation_improvement: Share = 0.01
    """Maximum relative decrease of the best cost over these generations at which the search stops."""
    delta: PositiveFloat = 35.0
    """Constant added to H in the fitness; a larger value increases the selection probability of bad individuals."""
    fitness_scale: PositiveFloat = 350.0
    """M of docs/theory.md (10), not published. With 350, the fitness threshold sigma = 5 corresponds to H < 35."""


class IgaSettings(SearchSettings, frozen=True):
    """Settings of the improved genetic algorithm, in the symbols of docs/theory.md, section 2."""

    algorithm: Literal["iga"] = "iga"
    population: Annotated[int, Field(ge=2)] = 200
    """M, the number of chromosomes in the population."""
    crossover_rate: Annotated[Share, Field(gt=0)] = 0.8
    """Pc, the crossover rate; a generation has M Pc / 2 offspring."""
    mutation_rate: Share = 0.1
    """Pm, the share of the offspring that mutate."""
    alpha: Share = 0.999
    """Population fitness f_pop above which the population counts as converged, if the best fitness also exceeds
    `sigma`.

    Dynamic encoding and feedback mutation are used in a converged population only.
    """
    sigma: NonNegativeFloat = 5.0
    """Best fitness above which the population counts as converged, if f_pop also exceeds `alpha`."""
    mu: PositiveFloat = 0.95
    """Lower end of the range of dynamic encoding, as a multiple of the best gene."""
    nu: NonNegativeFloat = 0.1
    """Width of the range of dynamic encoding: its upper end is (mu + nu) times the best gene."""
    similarity: Share = 0.01
    """Maximum difference, as a share of the gene's range, of two genes that the feedback mutation regards as equal."""
    orthogonal_array: Literal["L8", "L12", "L16"] = "L12"
    """Two-level array of the orthogonal experiment, with 8, 12 or 16 trials for up to 7, 11 or 15 genes."""
