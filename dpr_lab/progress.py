"""Progress messages of the numerical core, as values that need no parsing."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class StageBegan:
    """Start of a stage of a job."""

    number: int
    """Number of the stage, from 1."""
    of: int
    name: str


@dataclass(frozen=True, slots=True)
class FitBegan:
    """Start of a fit of a model to the recordings."""

    effects: tuple[str, ...]
    """Effects in this model; none for the bare model."""

    @property
    def text(self) -> str:
        """Text for the operator."""
        return f"fit {', '.join(self.effects) or 'the bare model'}"


@dataclass(frozen=True, slots=True)
class ScoreTestBegan:
    """Start of a score test of every effect of the library on a model."""

    effects: tuple[str, ...]
    """Effects in this model; none for the bare model."""

    @property
    def text(self) -> str:
        """Text for the operator."""
        return f"score test on {', '.join(self.effects) or 'the bare model'}"


@dataclass(frozen=True, slots=True)
class GenerationDone:
    """End of a generation of the search; number 0 is the initial population."""

    number: int
    at_most: int
    """Maximum number of generations."""
    evaluations: int
    """Candidates evaluated so far."""
    best_cost: float
    best_fitness: float
    population_fitness: float


@dataclass(frozen=True, slots=True)
class LocalFitBegan:
    """End of the search; the local fit starts from its best individual."""


@dataclass(frozen=True, slots=True)
class ImportProgress:
    """Progress of reading a table or writing its run."""

    step: Literal["read", "write"]
    done: int
    """Bytes read, or rows written."""
    of: int
    """Total bytes of the file, or rows of the run."""


OnImport = Callable[[ImportProgress], None]


def unwatched(progress: ImportProgress) -> None:
    """Ignore the progress of an import."""


_watching: list[Callable[[], None]] = []


@contextmanager
def watch_compiling(on_compiling: Callable[[], None]) -> Iterator[None]:
    """Call `on_compiling` at each compilation of a kernel within the context; from any thread."""
    _watching.append(on_compiling)
    try:
        yield
    finally:
        _watching.remove(on_compiling)


def compiling() -> None:
    """Notify all listeners that a kernel is being compiled, in this process or in one for which it waits."""
    for on_compiling in tuple(_watching):
        on_compiling()
