"""Simulate sampling faults of a real board: uneven times, repeated samples, missing samples."""

from statistics import NormalDist

import numpy as np
from numpy.typing import NDArray

from sim_device.plant.config import PlantConfig
from sim_device.plant.encoders import standard_noise
from sim_device.random_streams import RandomStream

# columns of the random numbers by their purpose
_JITTER, _REPEATED, _MISSING = range(3)


def instants(config: PlantConfig, release: int, first: int, count: int) -> NDArray[np.float64]:
    """Return the delay (count,) of each sample of a swing after its tick, s."""
    jitter = config.encoders.jitter_ms * 1e-3 * _noise(config, release, first, count)[:, _JITTER]
    return jitter + config.encoders.late_ms * 1e-3 * _in_cycle(config.encoders.late_every, first, count)


def repeated(config: PlantConfig, release: int, first: int, count: int, rate_hz: float) -> NDArray[np.bool_]:
    """Return the flags (count,) of the samples of a swing that repeat the previous sample."""
    encoders = config.encoders
    by_chance = _noise(config, release, first, count)[:, _REPEATED] < _threshold(encoders.repeated_share)
    stretch = _within(encoders.stale_from_s, encoders.stale_for_s, first, count, rate_hz)
    return by_chance | (stretch & _in_cycle(encoders.stale_every, first, count))


def missing(config: PlantConfig, release: int, first: int, count: int, rate_hz: float) -> NDArray[np.bool_]:
    """Return the flags (count,) of the samples of a swing that are never sent."""
    encoders = config.encoders
    by_chance = _noise(config, release, first, count)[:, _MISSING] < _threshold(encoders.missing_share)
    return by_chance | _within(encoders.lost_from_s, encoders.lost_for_s, first, count, rate_hz)


def between_ticks(theta: NDArray[np.float64], later: NDArray[np.float64]) -> NDArray[np.float64]:
    """Interpolate angles between the ticks by the parabola through three neighbouring ticks.

    Args:
        theta: (n + 2 + k, 3) angles at the ticks, at one tick before them, and at k + 1 ticks after them, rad
        later: (n,) delay after the ticks, in ticks, less than k + 1

    Returns:
        (n, 3) angles, rad
    """
    whole = np.maximum(np.floor(later), 0.0)
    near = np.arange(1, len(later) + 1) + whole.astype(np.int64)
    before, sample, after = theta[near - 1], theta[near], theta[near + 1]
    u = (later - whole)[:, None]
    return sample + u * (after - before) / 2 + u * u * (after - 2 * sample + before) / 2


def _within(begin_s: float, lasts_s: float | None, first: int, count: int, rate_hz: float) -> NDArray[np.bool_]:
    """Return the flags (count,) of the samples in an interval of the swing.

    Without a duration, the interval extends to the end.
    """
    since = np.arange(first, first + count) / rate_hz - begin_s
    return (since >= 0.0) & (since < (np.inf if lasts_s is None else lasts_s))


def _in_cycle(every: int, first: int, count: int) -> NDArray[np.bool_]:
    """Return the flags (count,) of the samples that are the last in a cycle of `every` samples.

    All values are False if `every` is 0.
    """
    if not every:
        return np.zeros(count, dtype=np.bool_)
    return np.arange(first, first + count) % every == every - 1


def _noise(config: PlantConfig, release: int, first: int, count: int) -> NDArray[np.float64]:
    return standard_noise(config.seed, RandomStream.SAMPLING, release, first, count)


def _threshold(share: float) -> float:
    return NormalDist().inv_cdf(share) if share > 0.0 else -np.inf
