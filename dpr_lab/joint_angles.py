"""Map between the absolute angles of the rods and the angles of the encoders.

    joint 1 = theta1,    joint 2 = theta2 - r theta1,    r = 1 for an encoder on the joint, 0 for one fixed to the arm

The map is linear, so it also applies to speeds, errors and sensitivities.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array


@dataclass(frozen=True, slots=True)
class JointAngles:
    """Linear map between rod angles and encoder angles, which depends on the mounting of encoder 2."""

    relative2: bool
    """Whether encoder 2 measures theta2 - theta1; otherwise it measures theta2."""

    @property
    def to_rods_matrix(self) -> Array:
        """Matrix J (2, 2) with theta = J joint."""
        return np.array([[1.0, 0.0], [float(self.relative2), 1.0]])

    @property
    def hanging(self) -> Array:
        """Joint angles (2,) of the hanging rods, rad."""
        return self.of_rods([math.pi, math.pi])

    def of_rods(self, theta: ArrayLike) -> Array:
        """Convert rod angles theta1, theta2 (..., 2) to joint angles (..., 2), rad.

        The map also applies to other quantities that are linear in the angles.
        """
        inner, outer = np.moveaxis(np.asarray(theta, dtype=np.float64), -1, 0)
        return np.stack([inner, outer - self.relative2 * inner], axis=-1)

    def to_rods(self, joint: ArrayLike) -> Array:
        """Convert joint angles (..., 2) to the rod angles theta1 and theta2 (..., 2), rad.

        This is the inverse of `of_rods`.
        """
        inner, turned = np.moveaxis(np.asarray(joint, dtype=np.float64), -1, 0)
        return np.stack([inner, turned + self.relative2 * inner], axis=-1)
