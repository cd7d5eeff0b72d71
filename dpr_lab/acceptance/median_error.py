"""Median of the free-run errors of several releases, and the number of releases that decide its limit.

The logarithms of the errors are assumed to be normally distributed, with an unknown spread. For n releases whose
logarithms have the mean m and the standard deviation s, the 90 % interval of the median is

    exp(m -+ t s / sqrt(n)),

with the 95 % quantile t of Student's distribution with n - 1 degrees of freedom. A forecast for further releases uses a
larger n, with the same m and s.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dpr_lab.acceptance.limits import FreeRunLimit
from dpr_lab.acceptance.reason import Reason, within
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.scaling.scale import Interval90
from dpr_lab.shown import counted


@dataclass(frozen=True, slots=True)
class MedianError:
    """Settings of the interval of the median error, and of its forecast."""

    confidence: float = 0.95
    """Confidence of each limit of the interval, on one side."""
    further: int = 20
    """Maximum number of further releases of a forecast."""
    least: float = 1e-12
    """Lower limit of an error before its logarithm is taken, rad."""


MEDIAN = MedianError()


def median90(errors: Sequence[float], further: int = 0) -> Interval90:
    """Return the 90 % interval of the median of two or more errors.

    Args:
        errors: errors of the recorded releases, rad
        further: number of further releases with the same mean and spread
    """
    from scipy.special import stdtrit  # slow to import, and every diagnosis imports this module

    logs, count = np.log(np.maximum(errors, MEDIAN.least)), len(errors) + further
    reach = float(stdtrit(count - 1, MEDIAN.confidence) * logs.std(ddof=1) / np.sqrt(count))
    return float(np.exp(logs.mean() - reach)), float(np.exp(logs.mean() + reach))


def undecided(errors: Sequence[float], limit: float, further: int = 0) -> tuple[float, bool]:
    """Return the half width of the interval towards the limit, rad, and whether the limit is undecided.

    The limit is undecided if the interval of the median contains it. The other arguments are those of `median90`.
    """
    low, high = median90(errors, further)
    median = float(np.sqrt(low) * np.sqrt(high))
    return abs((high if limit > median else low) - median), low <= limit <= high


def further_releases(errors: Sequence[float], limit: float) -> int | None:
    """Return the number of further releases that are expected to decide a limit of the median.

    The result is 0 if these errors decide it, and None if `MEDIAN.further` releases do not.
    """
    return next((number for number in range(MEDIAN.further + 1) if not undecided(errors, limit, number)[1]), None)


def what_decides(diagnosis: Diagnosis, limit: FreeRunLimit, errors: Sequence[float]) -> Reason:
    """Return the reason of an undecided limit, with the number of further releases that decide it, or the obstacle."""
    if (number := further_releases(errors, limit.max)) is not None:
        further = counted(number, "further release")
        return within(remedy=f"{further} with the same mean and spread of the errors would decide it")
    cause, budget = "", diagnosis.evidence.budget if diagnosis.evidence else None
    horizons = [run.until_s for run in budget.runs if run.reaches_horizon] if budget else []
    if min(horizons, default=np.inf) < limit.horizon_s:
        cause = f"; small initial errors dominate them after {min(horizons):.2g} s: choose a shorter horizon_s"
    elif diagnosis.gap.remainder_Nm:
        cause = "; the unexplained remainder contributes to them, and further releases do not reduce it"
    factor = max(errors) / max(min(errors), MEDIAN.least)
    spread = f"the errors of the releases differ by up to a factor of {factor:.2g}"
    return within(f", and {MEDIAN.further} further releases would probably not decide it", f"{spread}{cause}")
