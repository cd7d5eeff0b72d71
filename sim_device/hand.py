"""The operator's hand and the latch: places the rods, imperfectly, and lets them go."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.rig import JOINTS, Pose
from sim_device.chance import Stream, generator
from sim_device.config import Hand

PLACING_TIME = 0.5
"""How long the hand takes from one pose to the next, s of device time."""


@dataclass(frozen=True, slots=True)
class Held:
    """Rods in the hand or the latch: moving smoothly from `start` to `target`, then at rest.

    theta(t) = start + (target - start) s(x),  s(x) = 10 x^3 - 15 x^4 + 6 x^5,  x = (t - begins) / takes in [0, 1]

    Source: minimum-jerk motion, Flash and Hogan (1985), J. Neurosci. 5(7) 1688-1703.
    """

    start: NDArray[np.float64]
    target: NDArray[np.float64]
    begins: float = 0.0
    takes: float = 0.0

    def theta(self, t: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 3) angles at the device times `t` (n,), rad."""
        if self.takes == 0.0 or t[0] >= self.begins + self.takes:
            return np.broadcast_to(self.target, (len(t), JOINTS))
        x = np.clip((t - self.begins) / self.takes, 0.0, 1.0)
        share = x**3 * (10 - 15 * x + 6 * x**2)
        return self.start + share[:, None] * (self.target - self.start)


def placement(hand: Hand, pose: Pose, seed: int, release: int, error: float = 0.0) -> NDArray[np.float64]:
    """(3,) where the operator leaves the rods for a pose: both rods a little off, and by `error` on purpose, rad."""
    return pose.theta + np.array([0.0, error, error]) + hand.placement_std * _draw(seed, release)[0]


def release_speed(hand: Hand, seed: int, release: int) -> NDArray[np.float64]:
    """(3,) angular velocities at the instant the latch opens, rad/s."""
    return hand.release_speed_std * _draw(seed, release)[1]


def _draw(seed: int, release: int) -> NDArray[np.float64]:
    """(2, 3) unit normal deviations of angle and speed; the clamped arm has none."""
    rods = generator(seed, Stream.HAND, release).standard_normal((2, JOINTS - 1))
    return np.concatenate([np.zeros((2, 1)), rods], axis=1)
