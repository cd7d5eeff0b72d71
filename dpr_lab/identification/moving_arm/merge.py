"""Merge adjacent segments as long as the model follows the merged segments.

Longer segments contain more information.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Flags
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.identification.moving_arm.problem import ArmProblem, Cut


@dataclass(frozen=True, slots=True)
class ArmMergeSettings:
    """Limits for the integration of a merged segment."""

    solver_error: float = 0.2
    """Maximum error of the integration, relative to the noise."""
    shortest_step: float = 2.5e-4
    """Shortest Runge-Kutta step, s; segments that need a shorter step are not merged."""


MERGE = ArmMergeSettings()


def merged(problem: ArmProblem, estimate: Estimate, near_rad: float) -> tuple[ArmProblem, Estimate] | None:
    """Merge adjacent segments, and return them with their initial states.

    The result is None if no segments can be merged.

    Args:
        problem: problem of the current segments
        estimate: fitted parameters and initial states
        near_rad: maximum distance of the free run of the first segment from the readings of the second segment, rad
    """
    cuts, step = problem.cuts, problem.max_step
    pairs = {
        first: (piece[0], slice(piece[1].start, other[1].stop))
        for first, (piece, other) in enumerate(pairwise(cuts))
        if piece[0] == other[0]
    }
    if not pairs:
        return None
    start = Estimate(estimate.vector, estimate.initial[list(pairs)])
    longer = problem.with_cuts(list(pairs.values()), step)
    near, exact = _following(longer, start, near_rad)
    while (near & ~exact).any() and step > MERGE.shortest_step:
        step /= 2
        near, exact = _following(problem.with_cuts(longer.cuts, step), start, near_rad)
    follows = {first for first, good in zip(pairs, near & exact, strict=True) if good}
    pieces, begins, index = list[Cut](), list[int](), 0
    while index < len(cuts):
        pieces.append(pairs[index] if index in follows else cuts[index])
        begins.append(index)
        index += 2 if index in follows else 1
    if len(pieces) == len(cuts):
        return None
    return problem.with_cuts(pieces, step), Estimate(estimate.vector, estimate.initial[begins])


def _following(longer: ArmProblem, start: Estimate, near_rad: float) -> tuple[Flags, Flags]:
    """Check for each segment whether its free run is accurate.

    Returns:
        (segments,) whether the free run stays near all readings
        (segments,) whether the error of its integration is negligible
    """
    finer = longer.with_cuts(longer.cuts, longer.max_step / 2)
    with np.errstate(invalid="ignore", over="ignore"):
        readings = longer.predict(start)
        near = ~longer.read | (np.abs(readings - longer.measured) < near_rad)
        exact = ~longer.read | (longer.weight * np.abs(readings - finer.predict(start)) < MERGE.solver_error)
    firsts = longer.segments.offsets[:-1]
    return np.logical_and.reduceat(near.all(axis=1), firsts), np.logical_and.reduceat(exact.all(axis=1), firsts)
