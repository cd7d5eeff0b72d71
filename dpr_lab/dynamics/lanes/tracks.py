"""Assign candidates and segments to the lanes."""

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dpr_lab.arrays import Flags, Integers
from dpr_lab.dynamics.lanes.workspace import LANES
from dpr_lab.effects.effect_kernels import required_by
from dpr_lab.effects.fold import compiled
from dpr_lab.effects.stages import Requirements


class Tracks(NamedTuple):
    """Tracks in blocks of at most `LANES` with the same active effects.

    A track is one candidate on one segment. If effects have internal states, a track is one candidate on all segments
    of a run in sequence.
    """

    candidate: Integers
    """(tracks,) index of the candidate of each track."""
    first: Integers
    """(tracks,) index of the first segment of each track."""
    last: Integers
    """(tracks,) index after the last segment of each track."""
    edges: Integers
    """(blocks + 1,) index of the first track of each block, then the number of tracks."""
    active: Flags
    """(blocks, effects) mask of the active effects of each block."""
    required: Requirements
    """(blocks,) quantities that the active effects of each block require."""


required_in = compiled(
    [
        "def required_in(required, b):",
        f"    return Requirements({', '.join(f'required.{f}[b]' for f in Requirements._fields)})",
    ],
    {"Requirements": Requirements},
)
"""(required, b) -> quantities required by block b."""


def tracks_of(active: Flags, chained: Flags, run: Integers, chains: Integers) -> Tracks:
    """Arrange the pairs of candidate and segment as tracks, which the lanes integrate.

    The result is cached, because all steps of a fit predict the same segments with the same effects.

    Args:
        active: (n, runs or 1, effects) mask of the active effects by candidate and run
        chained: (n, runs or 1) whether the segments of the run must be integrated in sequence
        run: (S,) run of each segment
        chains: (runs with segments + 1,) first segment of each run
    """
    return _tracks(active.shape, active.tobytes(), chained.tobytes(), run.tobytes(), chains.tobytes())


@lru_cache(maxsize=32)
def _tracks(shape: tuple[int, int, int], active_: bytes, chained_: bytes, run_: bytes, chains_: bytes) -> Tracks:
    """Compute the result of `tracks_of` from arguments that can be hashed for the cache."""
    n, runs, _ = shape
    active, chained = (
        np.frombuffer(mask, dtype=np.bool_).reshape(size) for mask, size in ((active_, shape), (chained_, (n, runs)))
    )
    run, chains = (np.frombuffer(indices, dtype=np.int64) for indices in (run_, chains_))
    rows = [row.tobytes() for row in active.reshape(n * runs, -1)]
    kinds = {row: i for i, row in enumerate(dict.fromkeys(rows))}
    kind = np.array([kinds[row] for row in rows]).reshape(n, runs)
    segments = np.arange(len(run))
    parts = [] if chained.all() else [_parts(~chained, kind, run, segments, segments + 1)]
    parts += [_parts(chained, kind, run, chains[:-1], chains[1:])] if chained.any() else []
    group, candidate, first, last = np.concatenate(parts, axis=1)
    order = np.argsort(group, kind="stable")
    group = group[order]
    starts = [0, *(np.flatnonzero(group[1:] != group[:-1]) + 1).tolist(), len(group)]
    edges = np.array([*(i for ends in pairwise(starts) for i in range(*ends, LANES)), len(group)])
    on = np.array([np.frombuffer(row, dtype=np.bool_) for row in kinds])[group[edges[:-1]]]
    # another array layout would require another compilation
    required = Requirements(*map(np.ascontiguousarray, required_by(on)))
    return Tracks(candidate[order], first[order], last[order], edges, on, required)


def _parts(
    which: Flags,
    kind: Integers,
    run: Integers,
    first: Integers,
    last: Integers,
) -> Integers:
    """Return four rows of integers for tracks, (4, tracks).

    The rows are the index of the set of active effects, the candidate, the first segment, and the index after the last
    segment. Only the pairs of candidate and run in the mask `which` have tracks. Neighbouring tracks belong to
    candidates on the same segment where possible, so that neighbouring lanes have the same times.
    """
    columns = run[first] if which.shape[1] > 1 else np.zeros(len(first), dtype=np.int64)
    segment, candidate = np.nonzero(which[:, columns].T)
    return np.stack([kind[candidate, columns[segment]], candidate, first[segment], last[segment]])
