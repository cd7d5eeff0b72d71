"""How far long work is: what the numerical core tells while it works, as values and never as text to be parsed."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class StageBegan:
    """Start of a stage of a job."""

    number: int
    """From 1."""
    of: int
    name: str


@dataclass(frozen=True, slots=True)
class FitBegan:
    """A model is being fitted to the recordings."""

    effects: tuple[str, ...]
    """The effects that it holds besides the rods; none for the bare model."""

    @property
    def text(self) -> str:
        """In words."""
        return f"fit {', '.join(self.effects) or 'the bare model'}"


@dataclass(frozen=True, slots=True)
class ScoreTestBegan:
    """A score test of every effect of the library on a model."""

    effects: tuple[str, ...]
    """The effects that this model holds; none for the bare model."""

    @property
    def text(self) -> str:
        """In words."""
        return f"score test on {', '.join(self.effects) or 'the bare model'}"


@dataclass(frozen=True, slots=True)
class GenerationDone:
    """A generation of the search is done; number 0 is the initial population."""

    number: int
    at_most: int
    """How many generations come at most."""
    evaluations: int
    """Candidates evaluated so far."""
    best_cost: float
    best_fitness: float
    population_fitness: float


@dataclass(frozen=True, slots=True)
class LocalFitBegan:
    """The search is over; the local fit goes from its best individual to the noise floor."""


@dataclass(frozen=True, slots=True)
class ImportProgress:
    """A table is being read, or the run of it written."""

    step: Literal["read", "write"]
    done: int
    """Bytes read, or rows written."""
    of: int
    """Bytes of the file, or rows of the run."""


OnImport = Callable[[ImportProgress], None]


def unwatched(progress: ImportProgress) -> None:
    """Ignore the progress of an import."""
