"""Merging of neighbouring segments as long as the model follows them; longer segments contain more information."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.identification.moving_arm.problem import ArmProblem, ArmRecording, Cut, problem_of
from dpr_lab.rig import Rig


@dataclass(frozen=True, slots=True)
class ArmMergeSettings:
    """Limits of the integration of a merged segment."""

    solver_error: float = 0.2
    """Maximum error of the integration, relative to the noise."""
    shortest_step: float = 2.5e-4
    """Shortest Runge-Kutta step, s; segments that need a shorter step are not merged."""


MERGE = ArmMergeSettings()


def merged(
    problem: ArmProblem, p: Array, initial: Array, recordings: Sequence[ArmRecording], rig: Rig, near_rad: float
) -> tuple[ArmProblem, Array] | None:
    """Merged segments with their initial states; None if no segments can be merged.

    Args:
        problem: problem of the current segments
        p: (12,) fitted parameters
        initial: (segments, 4 or 6) fitted initial states
        recordings: recordings of the segments
        rig: the recorded rig
        near_rad: maximum distance of the free run of the first segment from the readings of the second, rad
    """
    cuts = problem.cuts
    pairs = {
        first: (piece[0], slice(piece[1].start, other[1].stop))
        for first, (piece, other) in enumerate(pairwise(cuts))
        if piece[0] == other[0]
    }
    step = problem.max_step
    near, exact = _following(pairs, p, initial, recordings, rig, near_rad, step)
    while near - exact and step > MERGE.shortest_step:
        step /= 2
        near, exact = _following(pairs, p, initial, recordings, rig, near_rad, step)
    follows = near & exact
    pieces, begins, index = list[Cut](), list[int](), 0
    while index < len(cuts):
        pieces.append(pairs[index] if index in follows else cuts[index])
        begins.append(index)
        index += 2 if index in follows else 1
    return (problem_of(recordings, rig, pieces, step), initial[begins]) if len(pieces) < len(cuts) else None


def _following(
    pairs: dict[int, Cut],
    p: Array,
    initial: Array,
    recordings: Sequence[ArmRecording],
    rig: Rig,
    near_rad: float,
    step: float,
) -> tuple[set[int], set[int]]:
    """Indices of segments whose free run agrees with the next segment, and of exactly integrated segments.

    The integration error of an exactly integrated segment is negligible.
    """
    if not pairs:
        return set(), set()
    coarse, fine = (problem_of(recordings, rig, list(pairs.values()), h) for h in (step, step / 2))
    start = Estimate(p, initial[list(pairs)])
    with np.errstate(invalid="ignore", over="ignore"):
        readings = coarse.predict(start)
        near = ~coarse.read | (np.abs(readings - coarse.measured) < near_rad)
        exact = ~coarse.read | (coarse.weight * np.abs(readings - fine.predict(start)) < MERGE.solver_error)
    indices, firsts = np.array(list(pairs)), coarse.segments.offsets[:-1]
    near_pairs, exact_pairs = (
        set(indices[np.logical_and.reduceat(good.all(axis=1), firsts)].tolist()) for good in (near, exact)
    )
    return near_pairs, exact_pairs
