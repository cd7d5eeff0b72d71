"""Speeds of the rods while a swing is recorded."""

import math

import numpy as np

from dpr_lab.acquisition.rest import RodPair
from dpr_lab.arrays import Array
from dpr_lab.estimation.live_velocity import LIVE, VelocityFilter
from dpr_lab.rig import Rig


class LiveSpeed:
    """Kalman filter for the speeds of both rods, updated with new samples of a recording.

    The constructor imports the filter library, which takes about a second, so create the object before the rods are
    released.

    Args:
        rig: the rig, for its encoders
        rate_hz: sample rate of the recording, Hz
    """

    def __init__(self, rig: Rig, rate_hz: float) -> None:
        to_rods = rig.encoders.joint_angles.to_rods_matrix
        self._every = math.ceil(rate_hz / LIVE.most_hz)
        self._filter = VelocityFilter(to_rods @ np.diag(rig.reading_std[1:] ** 2) @ to_rods.T, rate_hz / self._every)
        self._skipped = 0
        self._omega = (0.0, 0.0)

    def after(self, t: Array, theta: Array) -> RodPair:
        """Return the speeds of inner and outer rod after new samples of the swing, rad/s.

        The speeds are unchanged if there are no new samples.

        Args:
            t: (n,) time since the release, s, later than in the previous call; samples before the release are ignored
            theta: (n, 3) absolute angles, rad
        """
        t, theta = t[t >= 0], theta[t >= 0]
        first = -self._skipped % self._every
        self._skipped = (self._skipped + len(t)) % self._every
        for instant, rods in zip(t[first :: self._every].tolist(), theta[first :: self._every, 1:], strict=True):
            omega1, omega2 = self._filter.update(instant, rods).tolist()
            self._omega = (omega1, omega2)
        return self._omega
