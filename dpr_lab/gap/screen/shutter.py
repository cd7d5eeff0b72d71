"""Rolling shutter: the time of a reading depends on its position in the picture.

The picture shows a point with the position p (m, from the pivot) at the instant

    t + k n . p,

with the instant t of the line of the pivot, the normal n of the lines in the picture, and the delay k (s/m). Lines are
horizontal, or vertical if the camera was turned by 90 degrees.

Source: Meingast, Geyer & Sastry (2005), Geometric models of rolling-shutter cameras, OMNIVIS, arXiv cs/0503076.
"""

from typing import Literal

import numpy as np

from dpr_lab.arrays import Array, without_turns
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.gap.result.saved import Saved
from dpr_lab.joint_angles import JointAngles

Lines = Literal["horizontal", "vertical"]

NORMALS: dict[Lines, tuple[float, float]] = {"horizontal": (0.0, -1.0), "vertical": (1.0, 0.0)}
"""Normal of the lines of a picture, downwards or to the right, by the direction of the lines."""


class RollingShutter(Saved):
    """Rolling shutter of the camera that filmed the recordings (`dpr_lab.gap.screen.shutter`)."""

    lines: Lines
    """Direction of the lines of the picture."""
    delay_s_per_m: float
    """Delay between two lines of the picture, divided by their distance on the rig, s/m."""

    def corrected(self, t: Array, shown: Array, constants: RigConstants, *, alone: bool) -> Array:
        """Interpolate readings to the times at which the line of the pivot is exposed.

        The ends of the rods are at p_i at the times t_i + k n . p_i. These positions are interpolated to t_i by cubic
        splines. The times need not increase with i: a point that moves faster than the lines are read, or too large a
        delay, exchanges neighbouring times.

        Args:
            t: (n,) times at which the line of the pivot is exposed, s
            shown: (n, 2) angles of the joints in the picture, rad
            constants: lengths of the rods
            alone: whether only the inner rod is mounted

        Returns:
            (n, 2) readings, rad
        """
        from scipy.interpolate import CubicSpline  # slow to import, and few recordings need it

        normal, joints = np.array(NORMALS[self.lines]), JointAngles(constants.relative2 == 1.0)

        def at_pivot(values: Array, position: Array) -> Array:
            instants, order = np.unique(t + self.delay_s_per_m * position @ normal, return_index=True)
            return CubicSpline(instants, values[order])(t)

        theta = shown @ joints.to_rods_matrix.T
        elbow = _end(theta[:, 0], constants.L1)
        theta1 = at_pivot(theta[:, 0], elbow)
        if alone:
            return np.column_stack([theta1, shown[:, 1]])
        tip = elbow + _end(theta[:, 1], constants.L2)
        rod2 = at_pivot(tip, tip) - _end(theta1, constants.L1)
        turned = np.arctan2(-rod2[:, 0], rod2[:, 1]) - theta[:, 1]
        theta2 = theta[:, 1] + without_turns(turned)
        return joints.of_rods(np.column_stack([theta1, theta2]))


def _end(theta: Array, length: float) -> Array:
    """Return the (n, 2) end of a rod, x to the right and y upwards from its joint, m."""
    return length * np.column_stack([-np.sin(theta), np.cos(theta)])
