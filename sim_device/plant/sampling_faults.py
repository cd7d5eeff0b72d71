"""What a real board does to samples: reads them at uneven instants, sends one twice, loses one."""

from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from sim_device.plant.config import PlantConfig
from sim_device.plant.encoders import standard_noise
from sim_device.random_streams import RandomStream

# Which column of the noise decides what.
_JITTER, _REPEATED, _MISSING = range(3)


def instants(config: PlantConfig, release: int, first: int, count: int) -> NDArray[np.float64]:
    """(count,) how much later than its tick each sample of a swing is read, s."""
    return config.encoders.jitter_ms * 1e-3 * _noise(config, release, first, count)[:, _JITTER]


def repeated(config: PlantConfig, release: int, first: int, count: int) -> NDArray[np.bool_]:
    """(count,) which samples of a swing say what the one before says."""
    return _noise(config, release, first, count)[:, _REPEATED] < _threshold(config.encoders.repeated_share)


def missing(config: PlantConfig, release: int, first: int, count: int) -> NDArray[np.bool_]:
    """(count,) which samples of a swing are never sent."""
    return _noise(config, release, first, count)[:, _MISSING] < _threshold(config.encoders.missing_share)


def between_ticks(theta: NDArray[np.float64], later: NDArray[np.float64]) -> NDArray[np.float64]:
    """Angles a fraction of a tick away from the ticks, on the parabola through three neighbours.

    Args:
        theta: (n + 2, 3) angles at the ticks and at one more on either side, rad
        later: (n,) how much later than the ticks, in ticks

    Returns:
        (n, 3) rad
    """
    before, at, after = theta[:-2], theta[1:-1], theta[2:]
    u = later[:, None]
    return at + u * (after - before) / 2 + u * u * (after - 2 * at + before) / 2


def _noise(config: PlantConfig, release: int, first: int, count: int) -> NDArray[np.float64]:
    return standard_noise(config.seed, RandomStream.SAMPLING, release, first, count)


def _threshold(share: float) -> float:
    return NormalDist().inv_cdf(share) if share > 0.0 else -np.inf
