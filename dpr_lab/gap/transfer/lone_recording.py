"""Detect the only recording that a model does not explain.

A kick, a draught or a caught cable acts in one recording and is not a property of the rig. The common fit then explains
this recording by values and effects that the other recordings do not need. Let

    rho_s = sqrt(max(chi2_s - level dof_s, 0) / (level dof_s))

be the remainder of recording s in units of the noise, and r the recording with the largest remainder. The model is
fitted to the other recordings by linear algebra (`dpr_lab.gap.hypothesis.cross_validation`). Recording r counts as the
only unexplained recording if rho_r of the common fit is several times larger than every rho_s of the fit without r.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.cross_validation import scaled_columns
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis


@dataclass(frozen=True, slots=True)
class LoneRules:
    """Limits for a remainder that occurs in one recording only (decision 44)."""

    recordings: int = 3
    """Minimum number of recordings. If there are two, it is unknown which of them is the exception."""
    ratio: float = 3.0
    """Minimum ratio of the remainder of the exceptional recording to the remainder of every other recording."""
    least: float = 0.5
    """Lower limit of the remainder of the other recordings in this ratio, in units of the noise."""


LONE = LoneRules()


@dataclass(frozen=True, slots=True)
class LoneRecording:
    """The only recording with a remainder, and the largest other remainder, both in units of the noise."""

    name: str
    remainder: float
    others: float


def lone_recording(problem: Problem, model: Hypothesis, names: Sequence[str]) -> LoneRecording | None:
    """Return the only recording with a remainder, or None if there is no such recording.

    The result is also None if a segment cannot be simulated.

    Args:
        problem: the segments
        model: the selected set
        names: names of the fitted recordings
    """
    fit, run = model.fit, problem.segments.run
    if len(names) < LONE.recordings or not np.isfinite(fit.linear.chi2):
        return None
    noise = np.maximum(model.residuals.level * np.bincount(run, problem.evidence_by_segment, len(names)), 1.0)

    def remainders(chi2: Array) -> Array:
        return np.sqrt(np.maximum(np.bincount(run, chi2, len(names)) / noise - 1.0, 0.0))

    common = remainders(fit.linear.chi2_by_segment)
    largest = int(np.argmax(common))
    others = np.delete(remainders(_refitted(fit, run != largest)), largest)
    return exceptional(names[largest], float(common[largest]), float(others.max()))


def exceptional(name: str, remainder: float, others: float) -> LoneRecording | None:
    """Return the recording if its remainder far exceeds all others, otherwise None.

    Args:
        name: name of the recording
        remainder: its remainder, in units of the noise
        others: largest remainder of the other recordings, in units of the noise
    """
    return LoneRecording(name, remainder, others) if remainder > LONE.ratio * max(others, LONE.least) else None


def _refitted(fit: Fit, chosen: Flags) -> Array:
    """Refit the model to the chosen segments by one Gauss-Newton step; return the (segments,) chi2 of all segments."""
    A = scaled_columns(fit, fit.inside)
    X, e = A[chosen].reshape(-1, A.shape[2]), fit.linear.e[chosen].ravel()
    step = np.linalg.solve(X.T @ X + np.eye(A.shape[2]), X.T @ e)
    return np.sum((fit.linear.e - A @ step) ** 2, axis=1)
