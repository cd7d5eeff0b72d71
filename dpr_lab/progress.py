"""Progress events of the numerical core: objects that need no parsing."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class StageBegan:
    """A stage of a job started."""

    number: int
    """Number of the stage, from 1."""
    of: int
    name: str


@dataclass(frozen=True, slots=True)
class FitBegan:
    """A fit of a model to the recordings started."""

    effects: tuple[str, ...]
    """Effects in the fitted model; empty for the bare model."""

    @property
    def text(self) -> str:
        """Text for the operator."""
        return f"fit {', '.join(self.effects) or 'the bare model'}"


@dataclass(frozen=True, slots=True)
class ScoreTestBegan:
    """A score test of every effect of the library, given a model, started."""

    effects: tuple[str, ...]
    """Effects in the given model; empty for the bare model."""

    @property
    def text(self) -> str:
        """Text for the operator."""
        return f"score test on {', '.join(self.effects) or 'the bare model'}"


@dataclass(frozen=True, slots=True)
class GenerationDone:
    """A generation of the search ended; generation 0 is the initial population."""

    number: int
    at_most: int
    """Maximum number of generations of the search."""
    evaluations: int
    """Number of candidates evaluated so far."""
    best_cost: float
    best_fitness: float
    population_fitness: float


@dataclass(frozen=True, slots=True)
class LocalFitBegan:
    """The search ended, and the local fit starts from its best individual."""


@dataclass(frozen=True, slots=True)
class ImportProgress:
    """Progress while a table is read or its run is written."""

    step: Literal["read", "write"]
    done: int
    """Number of bytes read, or of rows written."""
    of: int
    """Total number of bytes of the file, or of rows of the run."""


OnImport = Callable[[ImportProgress], None]


def unwatched(progress: ImportProgress) -> None:
    """Ignore the progress of an import."""


_watching: list[Callable[[], None]] = []


@contextmanager
def watch_compiling(on_compiling: Callable[[], None]) -> Iterator[None]:
    """Context in which `on_compiling` is called at each compilation of a kernel, from any thread."""
    _watching.append(on_compiling)
    try:
        yield
    finally:
        _watching.remove(on_compiling)


def compiling() -> None:
    """Notify all listeners that a kernel is being compiled, in this process or in one for which this process waits."""
    for on_compiling in tuple(_watching):
        on_compiling()
