"""Find the direction of the y axis from the motion of tracked points."""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, correlation


@dataclass(frozen=True, slots=True)
class DirectionSettings:
    """Settings for the direction of the y axis."""

    frames_of_speed: int = 8
    """Ratio of the interval over which energies are compared to half the interval over which a speed is measured."""


SETTINGS = DirectionSettings()


def points_downwards(rods: list[Array]) -> bool:
    """Check whether the y axis points downwards, from the motion of the points.

    Falling points become faster. If y points upwards, the increments of squared speed and of height of the rods' ends
    are therefore negatively correlated over intervals in which friction is negligible. This is also true for rods that
    swing from near upright or turn over. Noise hides the correlation over short intervals, and the exchange of energy
    between the rods hides it over some longer ones. The interval with the largest correlation is therefore used. Points
    that do not move are assumed to hang.
    """
    points = np.cumsum(rods, axis=0)  # (rods, n, xy)
    lags = [2**k for k in range(points.shape[1].bit_length()) if 4 * 2**k < points.shape[1]]
    correlations = [_falling(points, lag) for lag in lags]
    largest = max(correlations, key=abs, default=0.0)
    return largest > 0 if largest else bool(np.nanmedian(points[:, :, 1]) > 0)


def _falling(points: Array, lag: int) -> float:
    """Correlate the increments of squared speed with the increments of height.

    All increments are taken over `lag` frames.
    """
    half = max(1, lag // SETTINGS.frames_of_speed)
    speed2 = ((points[:, 2 * half :] - points[:, : -2 * half]) ** 2).sum(axis=2)
    faster, higher = (values[:, lag:] - values[:, :-lag] for values in (speed2, points[:, half:-half, 1]))
    return correlation(faster.ravel(), higher.ravel())
