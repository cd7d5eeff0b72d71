"""Estimate the angular velocities of both rods during a recording by a Kalman filter.

The motion model is that of `dpr_lab.estimation.velocity`: a chain of integrators driven by white noise in the fourth
derivative of the angle. Internally, angles are in units of the noise and times in units of the filter's memory
(`FilterUnits`).
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array

CHAIN = 4
"""Number of states of one rod: theta, omega, alpha, jerk."""


@dataclass(frozen=True, slots=True)
class LiveFilterSettings:
    """Settings of the filter that estimates speeds during a recording."""

    snap: float = 1e8
    """Default strength of the process noise, rad^2/s^7; suitable for rods of about 0.4 m."""
    prior: tuple[float, ...] = (1.0, 1e7, 1e7, 1e7)
    """Variances of the initial angle, speed, acceleration and jerk in filter units.

    The variance of the angle is that of a reading. The other states are practically unknown.
    """

    most_hz: float = 200.0
    """Maximum rate of filtered samples during a recording, Hz; an update takes a few tenths of a millisecond."""


LIVE = LiveFilterSettings()


@dataclass(frozen=True, slots=True)
class FilterUnits:
    """Units in which all states of the filter have similar sizes, and the noise in these units."""

    time: float
    """Unit of time, s: the memory of the filter, or the sampling period if this is longer."""
    angle: Array
    """(2,) unit of angle of each rod, rad: the standard deviation of a reading."""
    noise: Array
    """(2, 2) covariance of a reading, in units of `angle`."""
    snap: Array
    """(2,) strength of the process noise of each rod, in these units."""

    @classmethod
    def of(cls, period: float, covariance: Array, snap: ArrayLike) -> "FilterUnits":
        """Choose the units for a sampling period and noise.

        Args:
            period: sampling period, s
            covariance: (2, 2) covariance of a reading, rad^2
            snap: process noise of both rods, one number or (2,), rad^2/s^7
        """
        strengths = np.broadcast_to(np.asarray(snap, dtype=np.float64), 2)
        angle = np.sqrt(np.diag(covariance))
        memory = (angle**2 * period / strengths) ** (1 / (2 * CHAIN))
        time = max(period, float(np.sqrt(memory.prod())))
        scaled = strengths * time ** (2 * CHAIN - 1) / angle**2
        return cls(time, angle, covariance / np.outer(angle, angle), scaled)

    def scaled(self, snap: Array) -> Array:
        """Convert strengths of process noise (..., 2) from rad^2/s^7 to these units."""
        return snap * self.time ** (2 * CHAIN - 1) / self.angle**2


class VelocityFilter:
    """Kalman filter that estimates the speeds of both rods during a recording; `update` takes one sample.

    Create a filter before the recording starts, because its creation imports filterpy, which can take some seconds.

    Args:
        covariance: (2, 2) noise of (theta1, theta2), rad^2
        rate_hz: nominal sample rate, which only scales the internal units; `update` gets the true times
        snap: strength of the process noise of each rod, rad^2/s^7
    """

    def __init__(self, covariance: ArrayLike, rate_hz: float, snap: ArrayLike = LIVE.snap) -> None:
        from filterpy.kalman import KalmanFilter

        self._units = FilterUnits.of(1.0 / rate_hz, np.asarray(covariance, dtype=np.float64), snap)
        self._filter: Any = KalmanFilter(dim_x=2 * CHAIN, dim_z=2)
        self._filter.P = np.diag(np.tile(LIVE.prior, 2))
        self._filter.H = np.kron(np.eye(2), np.eye(1, CHAIN))
        self._filter.R = self._units.noise
        self._t = -math.inf
        self._interval = math.nan

    def update(self, t: float, theta: ArrayLike) -> Array:
        """Return the (2,) speeds after the sample theta (2,) at time t, rad/s.

        Raises:
            ValueError: t is not later than the previous sample.
        """
        if not t > self._t:
            raise ValueError(f"samples must come in order: {t} s after {self._t} s")
        scaled = np.asarray(theta, dtype=np.float64) / self._units.angle
        if math.isfinite(self._t):
            self._predict(t - self._t)
        else:
            self._filter.x = np.kron(scaled, np.eye(1, CHAIN)[0])
        self._filter.update(scaled)
        self._t = t
        return self._filter.x[[1, CHAIN + 1]] * self._units.angle / self._units.time

    def _predict(self, interval: float) -> None:
        from filterpy.common import Q_continuous_white_noise, kinematic_state_transition

        # Instants are sums of floating-point periods, so equal intervals differ by rounding.
        if not math.isclose(interval, self._interval, rel_tol=1e-6):
            step = interval / self._units.time
            noise = np.asarray(Q_continuous_white_noise(CHAIN, step), dtype=np.float64)
            self._filter.F = np.kron(np.eye(2), kinematic_state_transition(CHAIN - 1, step))
            self._filter.Q = np.kron(np.diag(self._units.snap), noise)
            self._interval = interval
        self._filter.predict()
