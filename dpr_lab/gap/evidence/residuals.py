"""Analysis of the residuals: autocorrelation, and deviation from a normal distribution.

Source: G. E. P. Box & G. M. Jenkins, Time Series Analysis, ch. 8: residual autocorrelation as a check of a model.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis
from dpr_lab.gap.result.evidence import ResidualAnalysis, Whiteness
from dpr_lab.gap.screen.sensor_faults import ALL_AXES


@dataclass(frozen=True, slots=True)
class ResidualSettings:
    """Settings of the residual analysis."""

    lags: int = 40
    """Maximum lag in readings; with readings every 5 ms, it is 0.2 s, shorter than a segment."""
    quantiles: int = 61
    """Number of quantiles of the distribution, evenly spaced in probability."""
    far: float = 3.0
    """Number of standard deviations beyond which a residual counts as extreme."""


RESIDUALS = ResidualSettings()


def residual_analysis(problem: Problem, models: Mapping[str, Hypothesis]) -> ResidualAnalysis:
    """Return the residual analysis of each joint under each model.

    Args:
        problem: segments of the fitted runs
        models: models before and after correction
    """
    chances = (np.arange(RESIDUALS.quantiles) + 0.5) / RESIDUALS.quantiles
    joints: dict[str, dict[str, Whiteness]] = {}
    for j, axis in enumerate(ALL_AXES[: problem.axes]):
        if problem.read[:, j].any():
            joints[axis] = {name: _whiteness(problem, model, j, chances) for name, model in models.items()}
    owner = problem.owner
    within = np.diff(owner) == 0
    return ResidualAnalysis(
        spacing_s=float(np.median(np.diff(problem.t)[within])),
        readings=int(np.count_nonzero(problem.read[:, 0])),
        normal=[NormalDist().inv_cdf(chance) for chance in chances],
        joints=joints,
    )


def _whiteness(problem: Problem, model: Hypothesis, joint: int, chances: Array) -> Whiteness:
    r = np.nan_to_num(problem.by_sample(model.fit.linear.residual)[:, joint], posinf=0.0)
    read = problem.read[:, joint]
    return Whiteness(
        autocorrelation=_autocorrelation(np.where(read, r, 0.0), read, problem.owner, RESIDUALS.lags).tolist(),
        quantiles=np.quantile(r[read], chances).tolist(),
        beyond3=float(np.mean(np.abs(r[read]) > RESIDUALS.far)),
    )


def _autocorrelation(r: Array, read: Flags, owner: Integers, lags: int) -> Array:
    """Return the (lags + 1,) autocorrelation of the residuals of a joint, from lag 0.

    Pairs of readings from different segments are omitted.
    """
    power = float(np.sum(r**2)) / max(int(read.sum()), 1)
    correlations = [1.0]
    for lag in range(1, min(lags, len(r) - 1) + 1):
        pairs = (owner[lag:] == owner[:-lag]) & read[lag:] & read[:-lag]
        mean = float(np.sum((r[lag:] * r[:-lag])[pairs])) / max(int(pairs.sum()), 1)
        correlations.append(mean / power if power > 0 else 0.0)
    return np.array(correlations)
