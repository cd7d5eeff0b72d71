"""Progress events that the numerical core reports, as typed objects."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, slots=True)
class StageBegan:
    """Event: a stage of a job started."""

    number: int
    """Number of the stage, from 1."""
    of: int
    name: str


@dataclass(frozen=True, slots=True)
class FitBegan:
    """Event: the fit of a model to the recordings started."""

    effects: tuple[str, ...]
    """Effects in the fitted model; empty for the bare model."""

    @property
    def text(self) -> str:
        """Text for the operator."""
        return f"fit {', '.join(self.effects) or 'the bare model'}"


@dataclass(frozen=True, slots=True)
class ScoreTestBegan:
    """Event: the score test of all effects of the library started, for a given model."""

    effects: tuple[str, ...]
    """Effects in the given model; empty for the bare model."""

    @property
    def text(self) -> str:
        """Text for the operator."""
        return f"score test on {', '.join(self.effects) or 'the bare model'}"


@dataclass(frozen=True, slots=True)
class GenerationDone:
    """Event: a generation of the search ended; generation 0 is the initial population."""

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
    """Event: the search ended, and the local fit starts from its best individual."""


@dataclass(frozen=True, slots=True)
class ImportProgress:
    """Event: progress of reading a table, or of writing its run."""

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
    """Call `on_compiling` at each compilation of a kernel, from any thread, within this context."""
    _watching.append(on_compiling)
    try:
        yield
    finally:
        _watching.remove(on_compiling)


def compiling() -> None:
    """Notify all listeners that a kernel is being compiled.

    The compiler runs in this process, or in another one for which this process waits.
    """
    for on_compiling in tuple(_watching):
        on_compiling()
