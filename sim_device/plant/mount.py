"""Compliant mount of the rig, which oscillates horizontally in the plane of the rods.

    x'' = w^2 (F / k - x) - 2 zeta w x',    F = -d/dt (S1 cos(theta1) omega1 + S2 cos(theta2) omega2),

with the first moments S1 = e1 / g and S2 = e2 / g. The acceleration of the mount acts on the rods as the torques -S_i
cos(theta_i) x''. The mount is stiff, so F is computed for rods on a rigid mount. The neglected terms are quadratic in
the compliance.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sim_device.plant.config import MountConfig

Array = NDArray[np.float64]

AT_REST = np.zeros(2)
"""Displacement and speed of the mount before the release."""


class CompliantMount(NamedTuple):
    """Compliant mount that carries the rods."""

    config: MountConfig
    moments: tuple[float, float]
    """First moments S1 and S2 of the rods, kg m."""

    def torques(self, t: Array, states: Array, start: Array) -> tuple[Array, Array]:
        """Return the torques of joints 1 and 2 that the motion of the mount exerts.

        Args:
            t: (n,) evenly spaced times, s
            states: (n, 6 + internal) motion of arm and rods on a rigid mount
            start: (2,) displacement and speed of the mount at t[0]

        Returns:
            (n - 1, 2) torques of joints 1 and 2 from each instant to the next, N m; (2,) displacement and speed of the
                mount at t[-1]
        """
        from scipy.signal import lsim  # slow to import, and few plants need it

        levers = np.asarray(self.moments) * np.cos(states[:, 1:3])
        force = -np.gradient((levers * states[:, 4:6]).sum(axis=1), t, edge_order=2)
        w = 2 * math.pi * self.config.frequency_hz
        A = np.array([[0.0, 1.0], [-w * w, -2 * self.config.damping_ratio * w]])
        B = np.array([[0.0], [w * w / self.config.stiffness_N_per_m]])
        _, accelerations, moved = lsim((A, B, A[1:], B[1:]), force, t - t[0], start)
        of_rods = -levers * accelerations[:, None]
        of_joints = np.column_stack([of_rods.sum(axis=1), of_rods[:, 1]])
        return 0.5 * (of_joints[1:] + of_joints[:-1]), moved[-1]
