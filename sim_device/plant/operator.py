"""Simulate the operator, who places the rods with random errors, and the latch."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.rig import JOINTS
from dpr_lab.rig_tables import Pose
from sim_device.plant.config import OperatorConfig
from sim_device.random_streams import RandomStream, generator


@dataclass(frozen=True, slots=True)
class Habits:
    """Settings of the operator."""

    placing_time: float = 0.5
    """Time that the operator takes from one pose to the next, s of device time."""
    looks: int = 8
    """Maximum number of times that the operator corrects a pose if the displayed angles differ from the pose."""
    near: float = 0.5
    """Maximum error of the displayed angles that the operator accepts, relative to the tolerance of the pose."""


HABITS = Habits()


@dataclass(frozen=True, slots=True)
class HeldRods:
    """Rods in the hand of the operator or in the latch: they move smoothly from `start` to `target`, then rest.

        theta(t) = start + (target - start) s(x),   s(x) = 10 x^3 - 15 x^4 + 6 x^5,   x = (t - begins) / takes in [0, 1]

    Source: minimum-jerk motion, Flash and Hogan (1985), J. Neurosci. 5(7) 1688-1703.
    """

    start: NDArray[np.float64]
    target: NDArray[np.float64]
    begins: float = 0.0
    takes: float = 0.0

    def theta(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the angles (n, 3) at the device times `t` (n,), rad."""
        if self.takes == 0.0 or t[0] >= self.begins + self.takes:
            return np.broadcast_to(self.target, (len(t), JOINTS))
        x = np.clip((t - self.begins) / self.takes, 0.0, 1.0)
        share = x**3 * (10 - 15 * x + 6 * x**2)
        return self.start + share[:, None] * (self.target - self.start)


def placement(operator: OperatorConfig, pose: Pose, seed: int, release: int, error: float = 0.0) -> NDArray[np.float64]:
    """Return the angles (3,) at which the operator holds the rods for a pose, rad.

    They contain random errors and the deliberate error `error` of both rods.
    """
    theta = pose.theta + np.array([0.0, error, error]) + operator.placement_std * _draw(seed, release)[0]
    return theta if operator.elbow is None else np.array([theta[0], theta[1], theta[1] + operator.elbow])


def release_speed(operator: OperatorConfig, seed: int, release: int) -> NDArray[np.float64]:
    """Return the angular velocities (3,) when the latch opens, rad/s."""
    return operator.release_speed_std * _draw(seed, release)[1]


def _draw(seed: int, release: int) -> NDArray[np.float64]:
    """Return the standard normal numbers (2, 3) from which the errors of angle and speed are computed.

    The numbers of the clamped arm are zero.
    """
    rods = generator(seed, RandomStream.OPERATOR, release).standard_normal((2, JOINTS - 1))
    return np.concatenate([np.zeros((2, 1)), rods], axis=1)
