"""A long record cut into pieces, every second one held out, so that one record too is tested on what took no part."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class PieceSettings:
    """When a record is cut, and how."""

    length_s: float = 10.0
    """Of a piece: as long as the releases that thresholds and probabilities were learnt on."""
    from_s: float = 20.0
    """Length from which a record makes two pieces or more."""


PIECES = PieceSettings()


def whole(name: str) -> str:
    """Name of the run that a piece was cut from, and of a whole run itself."""
    return re.sub(r" \d+-\d+ s$", "", name)


def in_pieces(runs: Sequence[Run], held_out: Sequence[Run]) -> tuple[Sequence[Run], Sequence[Run], str]:
    """The runs to fit, those to hold out, and a sentence where a long record was cut for that.

    Only one record alone is cut: several are tested on each other. Time goes on from piece to piece.
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
        f"The record of {run.duration:.0f} s was cut into {count} pieces; every second one is held out of the fit and"
        " shows how far the gap closes."
    )
    return cut[0::2], cut[1::2], sentence
