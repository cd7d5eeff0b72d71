"""Estimate the clock rate of the device from the arrival times of its samples.

A sample cannot arrive before it was taken. Therefore arrival = offset + tick * period + delay with delay >= 0. Buffers
and a busy host make individual delays long, but the shortest delay of a block of time is nearly constant. A line is
fitted to the samples with the shortest delays.
"""

from array import array
from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Integers


@dataclass(frozen=True, slots=True)
class ArrivalSettings:
    """Settings of the clock rate estimate from arrival times."""

    bin_s: float = 0.05
    """Width of a bin of host time, s. In each bin only the read with the shortest delay is used."""
    block_s: float = 0.4
    """Minimum length of a block, s. It is longer than a typical stall of a link. Only the shortest delay of each block
    is used."""
    blocks: tuple[int, int] = (5, 32)
    """Minimum and maximum number of blocks of a recording."""
    rounds: int = 3
    """Number of line fits. Each fit uses the reads with the smallest delays relative to the previous line."""
    shortest_s: float = 0.5
    """Minimum duration for an estimate of the rate, s."""
    delay_drift_s: float = 0.01
    """Assumed bound on an undetected change of the shortest delay during a recording, s: a few time slices of the
    host."""
    central: tuple[float, float] = (0.1, 0.9)
    """Two quantiles of the residuals; their difference is the scatter. Residuals outside them may come from blocks that
    lie entirely within a stall."""


ARRIVALS = ArrivalSettings()


@dataclass(frozen=True, slots=True)
class ArrivalFit:
    """Clock rate estimated from arrival times."""

    arrival_ppm: float
    """Relative deviation of the sample rate, measured with the host's clock, from its nominal value, ppm."""
    arrival_margin_ppm: float
    """Bound on the error of `arrival_ppm`, ppm: possible change of the delay divided by the duration of the
    recording."""


class Arrivals:
    """Arrival times of samples: the pair (device tick, host time) with the shortest delay of each bin.

    Args:
        rate_hz: nominal sample rate, Hz
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._ticks, self._times = array("d"), array("d")
        self._bin_end = -np.inf

    def add(self, tick: int, host_time: float) -> None:
        """Add a read at `host_time`, s, whose newest sample has the tick `tick`."""
        if host_time >= self._bin_end:
            self._bin_end = host_time + ARRIVALS.bin_s
            self._ticks.append(tick)
            self._times.append(host_time)
        elif tick - self._ticks[-1] >= (host_time - self._times[-1]) * self._rate_hz:
            self._ticks[-1], self._times[-1] = tick, host_time

    def fit(self) -> ArrivalFit | None:
        """Return the current estimate of the clock rate, or None without sufficient data."""
        s = ARRIVALS
        device, host = np.array(self._ticks) / self._rate_hz, np.array(self._times)
        if len(host) < s.blocks[0] or host[-1] - host[0] < s.shortest_s or device[-1] <= device[0]:
            return None
        host = host - host[0]
        count = int(np.clip(host[-1] / s.block_s, *s.blocks))
        block = np.minimum((host / host[-1] * count).astype(int), count - 1)
        period = host[-1] / (device[-1] - device[0])
        quickest = _quickest(host - period * device, block)
        for _ in range(s.rounds):
            period = _median_slope(device[quickest], host[quickest])
            if not 0 < period < np.inf:
                return None
            quickest = _quickest(host - period * device, block)
        residuals = host[quickest] - period * device[quickest]
        scatter = float(np.diff(np.quantile(residuals, s.central))[0])
        margin = (2 * scatter + s.delay_drift_s) / host[-1]
        return ArrivalFit((1 / period - 1) * 1e6, margin / period * 1e6)


def _quickest(delay: Array, block: Integers) -> Integers:
    """Return the index of the read with the shortest delay in each non-empty block."""
    order = np.lexsort((delay, block))
    return order[np.flatnonzero(np.diff(block[order], prepend=-1))]


def _median_slope(x: Array, y: Array) -> float:
    """Return the median of the slopes between all pairs of points (Theil-Sen)."""
    first, second = np.triu_indices(len(x), 1)
    run = x[second] - x[first]
    slopes = (y[second] - y[first])[run > 0] / run[run > 0]
    return float(np.median(slopes)) if len(slopes) else np.nan
