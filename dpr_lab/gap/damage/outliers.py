"""Detection of isolated outliers in the residual of a model, for low sampling rates."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.problem import Problem


@dataclass(frozen=True, slots=True)
class OutlierRules:
    """Limits of the detection of isolated outliers."""

    deviation: float = 8.0
    """Minimum deviation of an outlier from a line through its neighbours, in standard deviations."""
    among: float = 6.0
    """Minimum ratio of the deviation of an outlier to the usual deviation of its neighbours."""
    quantile: float = 0.8
    """Quantile of the deviations of the neighbours; a second outlier among them does not change it."""
    line: int = 7
    """Number of residuals to which a robust line is fitted: the three readings of an outlier are a minority."""


OUTLIERS = OutlierRules()


def isolated_outliers(problem: Problem, estimate: Estimate) -> Flags:
    """Return the (samples, 2) mask of isolated outliers of up to three readings.

    A robust straight line (Theil and Sen) is fitted to the seven residuals around a reading. An outlier deviates from
    this line far more than its neighbours, and the residuals before and after it have the same level. In contrast, the
    residual of a missing effect is smooth, large for some time, or a step.
    """
    r = np.nan_to_num(problem.weight * (problem.measured - problem.predict(estimate)))
    off, across = np.zeros_like(r), np.full_like(r, np.inf)
    for first, last in pairwise(problem.segments.offsets.tolist()):
        off[first:last] = _off_a_line(r[first:last])
        across[first + 3 : last - 3] = np.abs(r[first + 6 : last] - r[first : last - 6])
    offsets = np.concatenate([np.arange(-12, -3), np.arange(4, 13)])
    neighbours = np.clip(np.arange(len(r))[:, None] + offsets, 0, len(r) - 1)
    usual = np.quantile(off[neighbours], OUTLIERS.quantile, axis=1)
    return off > np.maximum(np.maximum(OUTLIERS.deviation, OUTLIERS.among * usual), 2 * across)


def _off_a_line(values: Array) -> Array:
    """Return the (n, 2) deviation of each value from a robust line through seven values.

    The seven values include the value itself, in the middle if possible. With fewer than seven values, the deviations
    are zero.
    """
    width = OUTLIERS.line
    if len(values) < width:
        return np.zeros_like(values)
    begin = np.clip(np.arange(len(values)) - width // 2, 0, len(values) - width)
    window = values[begin[:, None] + np.arange(width)]
    i, j = np.triu_indices(width, 1)
    slope = np.median((window[:, j] - window[:, i]) / (j - i)[:, None], axis=1)
    level = np.median(window - slope[:, None] * np.arange(width)[:, None], axis=1)
    return np.abs(values - level - slope * (np.arange(len(values)) - begin)[:, None])
