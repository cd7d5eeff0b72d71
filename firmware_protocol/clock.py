"""Conversion of device ticks to host time, with uncertainty.

Each answered PING gives an exchange: the host time t_sent of the PING, the device time at its arrival, and the host
time t_received of the answer. The device read its clock between these host times, near the middle if the round trip was
short.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Ping, Pong
from firmware_protocol.stream import unwrap

OUTSTANDING = 16
"""Maximum number of pings that wait for an answer. Older ones are discarded."""
RESOLUTION_S = 1e-6
"""Difference of round trips below which they count as equal, s."""
FEWEST = 5
"""Minimum number of exchanges for a fit: two for the line and three for its accuracy."""


@dataclass(frozen=True, slots=True)
class Exchange:
    """A PING and its PONG: host times of sending and receiving, s, and device time in between, ticks."""

    t_sent: float
    ticks: float
    t_received: float

    @property
    def round_trip(self) -> float:
        """Time from PING to PONG, s."""
        return self.t_received - self.t_sent


class Pinger:
    """Generator of PING commands, which assigns each PONG to its PING."""

    def __init__(self) -> None:
        self._sent: dict[int, float] = {}
        self._token = 0
        self._tick = 0

    def ping(self, now: float) -> Ping:
        """Create the next PING, to be sent at the host time `now`, s."""
        self._token = (self._token + 1) & 0xFFFF
        self._sent[self._token] = now
        if len(self._sent) > OUTSTANDING:
            del self._sent[next(iter(self._sent))]
        return Ping(self._token)

    def exchange(self, pong: Pong, now: float) -> Exchange | None:
        """Return the exchange that a PONG received at the host time `now`, s, completes; None if it is unexpected."""
        t_sent = self._sent.pop(pong.token, None)
        if t_sent is None:
            return None
        self._tick = max(unwrap(pong.tick, self._tick, 32), 0)
        return Exchange(t_sent, self._tick + pong.fraction / 65536, now)


@dataclass(frozen=True, slots=True)
class ClockFit:
    """Fit host time = offset + ticks * period, with standard uncertainties."""

    offset: float
    """Host time of tick 0, s."""
    offset_std: float
    """Standard uncertainty of the offset, s: uncertainty of the line at tick 0, and of the unknown division of the
    shortest round trip into its two directions."""
    rate_ppm: float
    """Relative deviation of the tick rate, measured with the host's clock, from its nominal value, ppm."""
    rate_ppm_std: float
    rtt_min: float
    """Shortest round trip, s."""
    n: int
    """Number of used exchanges."""
    period: float
    """Duration of one tick in host time, s."""


def fit_clock(exchanges: Sequence[Exchange], rate_hz: float) -> ClockFit:
    """Fit a line to the exchanges of one stream (ticks restart with every STREAM).

    Only the half with the shortest round trips is used, because queues can only lengthen a round trip. The excess of a
    round trip over the shortest one is a delay on the way to or from the device, in unknown proportions. The time of
    the device's reading therefore has the variance of a uniform distribution with the excess as its width. The median
    excess is a lower limit of this width, because the shortest round trip also contains such a delay. The line is
    weighted by the inverse variances. If the scatter is larger than expected, the uncertainties are increased in
    proportion.

    Source of the regression on exchanges with short round trips, without weights: K. O'Connor, Klipper, `clocksync.py`.

    Args:
        exchanges: at least `FEWEST`, at different ticks
        rate_hz: nominal tick rate, Hz

    Raises:
        ValueError: too few exchanges.
    """
    used = _shortest(exchanges)
    ticks = np.array([e.ticks for e in used])
    if len(np.unique(ticks)) < FEWEST:
        raise ValueError(
            f"{len(exchanges)} exchanges are not enough for a clock fit: at least {FEWEST} at"
            f" different ticks are needed"
        )
    start = used[0].t_sent
    middle = np.array([(e.t_sent - start + e.t_received - start) / 2 for e in used])
    round_trip = np.array([e.round_trip for e in used])
    rtt_min = float(round_trip.min())
    longer = round_trip - rtt_min
    variance = (longer**2 + max(float(np.median(longer)), RESOLUTION_S) ** 2) / 12
    (offset, period), covariance = _line(ticks, middle, variance)
    split = rtt_min / np.sqrt(12)
    return ClockFit(
        offset=start + offset,
        offset_std=float(np.hypot(np.sqrt(covariance[0, 0]), split)),
        rate_ppm=(1 / (rate_hz * period) - 1) * 1e6,
        rate_ppm_std=float(np.sqrt(covariance[1, 1])) * rate_hz * 1e6,
        rtt_min=rtt_min,
        n=len(used),
        period=period,
    )


def _shortest(exchanges: Sequence[Exchange]) -> list[Exchange]:
    half = max(FEWEST, (len(exchanges) + 1) // 2)
    return sorted(exchanges, key=lambda exchange: exchange.round_trip)[:half]


def _line(
    x: NDArray[np.float64], y: NDArray[np.float64], variance: NDArray[np.float64]
) -> tuple[tuple[float, float], NDArray[np.float64]]:
    """Fit y = a + b x by weighted least squares; return (a, b) and their covariance."""
    weight = 1 / variance
    x_mean = float(np.average(x, weights=weight))
    design = np.stack([np.ones_like(x), x - x_mean], axis=1)
    normal = design.T * weight @ design
    a, b = np.linalg.solve(normal, design.T @ (weight * y))
    scatter = float(weight @ (y - design @ np.array([a, b])) ** 2) / (len(x) - 2)
    shift = np.array([[1.0, -x_mean], [0.0, 1.0]])
    covariance = shift @ np.linalg.inv(normal) @ shift.T * max(scatter, 1.0)
    return (float(a - b * x_mean), float(b)), covariance.astype(np.float64)
