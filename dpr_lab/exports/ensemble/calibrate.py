"""Calibrate the width of an ensemble of models on recordings.

The errors of an incomplete model exceed the noise, so that the bands of the model are too narrow. The standard
deviations of the posterior are multiplied by the smallest factor for which the predictive bands cover the required
share of the readings of calibration runs.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from dpr_lab.exports.ensemble.bands import BANDS, PredictiveBand
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.run import Run

M = TypeVar("M")


@dataclass(frozen=True, slots=True)
class CalibrationSettings:
    """Settings of the search for the factor on the standard deviations."""

    factors: tuple[float, ...] = (2.0, 4.0, 8.0, 16.0)
    """Factors on the standard deviations, in the order in which they are tried if the factor 1 is too small."""
    halvings: int = 2
    """Number of bisection steps, on a logarithmic scale, between the last factor that is too small and the first
    sufficient factor."""
    members: int = 39
    """Number of models in each trial. The band lies between their second smallest and second largest values."""


CALIBRATED = CalibrationSettings()


def calibrated(
    drawn: Callable[[float, int], Sequence[M]], band: Callable[[Sequence[M], Run], PredictiveBand], runs: Sequence[Run]
) -> float:
    """Find the smallest factor on the standard deviations at which the bands cover the required share of readings.

    Args:
        drawn: function that returns random models; its arguments are the factor and the number of models
        band: function that returns the band of models for a run
        runs: the calibration runs

    Raises:
        RunError: the model cannot follow a run.
    """

    def too_narrow(factor: float) -> bool:
        members = drawn(factor, CALIBRATED.members)
        return pooled([band(members, run) for run in runs]) < BANDS.level

    low = enough = 1.0
    for factor in CALIBRATED.factors:
        if not too_narrow(enough):
            break
        low, enough = enough, factor
    for _ in range(CALIBRATED.halvings if enough > 1.0 else 0):
        middle = (low * enough) ** 0.5
        low, enough = (middle, enough) if too_narrow(middle) else (low, middle)
    return enough


def widened(components: Sequence[PosteriorComponent], factor: float) -> list[PosteriorComponent]:
    """Multiply the standard deviations of a posterior by a factor."""
    return [
        component.model_copy(update={"covariance": (factor**2 * component.predictive).tolist(), "between": []})
        for component in components
    ]


def pooled(bands: Sequence[PredictiveBand]) -> float:
    """Return the share of all readings inside their bands, or nan without readings."""
    counts = [band.readings for band in bands]
    covered = sum(band.covered * count for band, count in zip(bands, counts, strict=True) if count)
    return covered / sum(counts) if sum(counts) else float("nan")
