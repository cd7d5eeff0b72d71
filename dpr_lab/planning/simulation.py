"""Nonlinear check of a planned release: one cause is simulated and another is fitted.

The linearised distance of two causes is valid only near the estimate. The best releases are therefore simulated with
the more probable cause. The other cause is fitted to the simulated readings by Gauss-Newton steps. The information F of
the runs is the prior:

    min over p and initial states of chi2(p) + (p - p*)^T F (p - p*),

where p* is the best fit of the other cause to the runs recorded so far. The minimum is Delta D^2.
"""

from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.effects import without_effect
from dpr_lab.fitting.estimate import EFFECTS_BEGIN, Estimate, moved
from dpr_lab.fitting.linearise import linearise
from dpr_lab.planning.information import laid_out
from dpr_lab.planning.knowledge import Knowledge
from dpr_lab.planning.release import CandidateRelease
from dpr_lab.planning.worth.criteria import OpenPairs


@dataclass(frozen=True, slots=True)
class SimulatedFit:
    """Settings of the simulation and of the fit of the other cause."""

    least: float = 1.0
    """Minimum linearised Delta D^2 of a release that is simulated; a smaller value carries too little information."""
    iterations: int = 6
    """Number of Gauss-Newton steps from the linear solution; further steps hardly change the minimum."""


SIMULATED_FIT = SimulatedFit()


def simulated_distance(
    release: CandidateRelease, known: Knowledge, pairs: OpenPairs, truth: int, other: int
) -> float | None:
    """Compute by nonlinear simulation how far a release moves two causes apart, as Delta D^2.

    The result is None if the fit becomes non-finite.

    Args:
        release: the release
        known: knowledge before the release
        pairs: the candidate causes
        truth: index of the cause that is simulated
        other: index of the cause that is fitted
    """
    problem, start = laid_out([release], known.model)
    true_estimate = _with(known, pairs, truth, start)
    problem = replace(problem, measured=problem.predict(true_estimate))
    free = [*pairs.fitted, *pairs.places[other]]
    columns, F = [known.model.columns[i] for i in free], known.information[np.ix_(free, free)] * known.inflation
    expected = _best_fit(known, pairs, truth, other, start, free)
    estimate = expected
    for _ in range(SIMULATED_FIT.iterations):
        linear = linearise(problem, estimate, columns)
        if not np.isfinite(linear.residual).all():
            return None
        A, e = linear.flat
        deviation = np.array([c.read(expected) - c.read(estimate) for c in columns])
        step = np.asarray(np.linalg.solve(A.T @ A + F, A.T @ e + F @ deviation), dtype=np.float64)
        estimate = moved(estimate, columns, step, linear.initial_steps(step))
    deviation = np.array([c.read(estimate) - c.read(expected) for c in columns])
    distance = problem.chi2(estimate) + deviation @ F @ deviation
    return float(distance / known.inflation) if np.isfinite(distance) else None


def _with(known: Knowledge, pairs: OpenPairs, cause: int, initial: Array) -> Estimate:
    """Replace the named effect in the estimate by another cause at its estimated size."""
    about = pairs.about
    vector = known.model.estimate.vector.copy()
    if pairs.names[cause] != about:
        vector[EFFECTS_BEGIN : EFFECTS_BEGIN + len(known.model.estimate.params)] = without_effect(
            known.model.estimate.params, about
        )
    for place, size in zip(pairs.places[cause], pairs.sizes[cause].tolist(), strict=True):
        vector[known.model.columns[place].place] = size
    return Estimate(vector, initial)


def _best_fit(known: Knowledge, pairs: OpenPairs, truth: int, other: int, initial: Array, free: list[int]) -> Estimate:
    """Fit a wrong cause to the recorded runs, in linear approximation.

    `other` is the wrong cause, and `truth` is the true one.
    """
    true_places = list(pairs.places[truth])
    lost = known.information[np.ix_(free, true_places)] @ pairs.sizes[truth]
    shift = np.asarray(np.linalg.solve(known.information[np.ix_(free, free)], lost), dtype=np.float64)
    estimate = _with(known, pairs, truth, initial)
    estimate = estimate.changed(params=without_effect(estimate.params, pairs.names[truth]))
    columns = [known.model.columns[i] for i in free]
    held = [i for i, c in enumerate(columns) if c.effect == pairs.names[truth]]
    shift[held] += [c.read(_with(known, pairs, truth, initial)) for c in (columns[i] for i in held)]
    return moved(estimate, columns, shift, np.zeros_like(initial))
