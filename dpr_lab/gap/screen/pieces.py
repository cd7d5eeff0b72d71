"""Division of a single long record into pieces.

Every second piece is held out to validate the diagnosis.
"""

import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class PieceSettings:
    """Settings of the division of a recording into pieces."""

    length_s: float = 10.0
    """Length of a piece, s: as long as the releases for which thresholds and probabilities were calibrated."""
    from_s: float = 20.0
    """Minimum length of a record that is divided into pieces, s."""


PIECES = PieceSettings()


def whole(name: str) -> str:
    """Return the name of the run from which a piece was cut, for the name of the piece.

    The name of an uncut run is returned unchanged.
    """
    return re.sub(r" \d+-\d+ s$", "", name)


def uncut(names: Iterable[str], runs: Collection[str]) -> set[str]:
    """Return the names of the runs to which names of pieces belong.

    `runs` are the names of known runs: a run whose name looks like that of a piece keeps its name.
    """
    return {name if name in runs else whole(name) for name in names}


def are_pieces(names: Iterable[str]) -> bool:
    """Return whether a list of recordings is not empty and contains only pieces of long recordings."""
    names = list(names)
    return bool(names) and all(whole(name) != name for name in names)


def in_pieces(runs: Sequence[Run], held_out: Sequence[Run]) -> tuple[Sequence[Run], Sequence[Run], str]:
    """Divide a single long record into pieces.

    Return the runs to fit, the runs to hold out, and a sentence on the division. Only a single record is divided,
    because several records validate each other. The times of a piece continue those of the previous piece.
    """
    if len(runs) != 1 or held_out or runs[0].duration < PIECES.from_s:
        return runs, held_out, ""
    (run,) = runs
    count = round(run.duration / PIECES.length_s)
    edges = np.linspace(0.0, run.duration, count + 1)
    starts, stops = [-np.inf, *edges[1:-1]], [*edges[1:-1], np.inf]
    cut = [
        replace(run.between(start, stop), name=f"{run.name} {first:.0f}-{last:.0f} s")
        for start, stop, first, last in zip(starts, stops, edges[:-1], edges[1:], strict=True)
    ]
    sentence = (
        f"The record of {run.duration:.0f} s was cut into {count} pieces. Every second piece is held out"
        " and measures the reduction of the gap."
    )
    return cut[0::2], cut[1::2], sentence
