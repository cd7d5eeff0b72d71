"""True motion of a plant, without encoders and drives."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.rig import JOINTS
from sim_device.plant.plant import Plant

Array = NDArray[np.float64]


def motion(plant: Plant, theta: Array, omega: Array, t: Array) -> Array:
    """Return the angles and speeds (n, 6) at the times `t` (n,) of a swing with theta, omega (3,) at t[0]."""
    return plant.free_states(plant.start(theta, omega), t)[:, : 2 * JOINTS]
