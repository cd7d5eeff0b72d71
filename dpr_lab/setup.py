"""What is known of a run besides its readings: what hung on the rig, and what drove it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpr_lab.rig_tables import AddedMass, Mounting


@dataclass(frozen=True, slots=True, eq=False)
class Torques:
    """Known joint torques: each holds from its instant to the next; the first and the last extend beyond the record."""

    t: NDArray[np.float64]
    """(n,) increasing, s since the release."""
    joints: NDArray[np.float64]
    """(n, 2) torque of joint 1 on the inner rod, and of joint 2 on the outer one, N m."""
    kind: str = ""
    """`measured` or `commanded`, where it is known."""

    @property
    def knots(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(n + 2,) instants and (n + 2, 2) impulse on theta1, theta2 until each, N m s; linear between them."""
        return _knots(self)

    def mean_before(self, at: ArrayLike) -> NDArray[np.float64]:
        """(m, 2) mean generalised torques on theta1, theta2 between each of (m,) instants and the one before, N m."""
        at, (t, impulse) = np.asarray(at, dtype=np.float64), self.knots
        until = np.stack([np.interp(at, t, column) for column in impulse.T], axis=1)
        passed = np.diff(at, prepend=at[0] - 1.0)
        return np.diff(until, axis=0, prepend=until[:1]) / np.where(passed > 0, passed, 1.0)[:, None]


@lru_cache(maxsize=32)  # every prediction asks for them
def _knots(torques: Torques) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    onward = np.concatenate([torques.t[:1] - 1.0, torques.t, torques.t[-1:] + 1e6])
    joints = np.concatenate([torques.joints[:1], torques.joints])
    held = np.stack([joints[:, 0] - joints[:, 1], joints[:, 1]], axis=1)
    whole = np.cumsum(held * np.diff(onward)[:, None], axis=0)
    return onward, np.concatenate([np.zeros((1, 2)), whole])


@dataclass(frozen=True, slots=True, eq=False)
class ArmMotion:
    """Known motion of an arm: its speed is linear between instants and constant beyond them."""

    t: NDArray[np.float64]
    """(n,) increasing, s since the release."""
    theta: NDArray[np.float64]
    """(n,) theta0, rad."""
    omega: NDArray[np.float64]
    """(n,) its speed, rad/s."""
    noise: float = 0.0
    """Standard deviation of the readings that it was estimated from, rad."""

    def mean_before(self, at: ArrayLike) -> NDArray[np.float64]:
        """(m, 2) mean acceleration and squared speed between each of (m,) instants and the one before, rad, s."""
        at = np.asarray(at, dtype=np.float64)
        v = np.interp(at, self.t, self.omega)
        u, passed = np.append(v[:1], v[:-1]), np.diff(at, prepend=at[0] - 1.0)
        return np.stack([(v - u) / passed, (u * u + u * v + v * v) / 3.0], axis=1)


@dataclass(frozen=True, slots=True)
class Setup:
    """Mounting of a run, and its known inputs."""

    mounting: Mounting = "both"
    """What swings: both rods, the inner or outer one alone, or both with the elbow clamped."""
    added: AddedMass | None = None
    """The known mass that was clamped on."""
    elbow: float = 0.0
    """Angle theta2 - theta1 of a clamped elbow, to a tenth of a radian: elbows that differ by less show nothing
    new of the ratios. What swings takes it from its own initial state."""
    torques: Torques | None = None
    """What drove the joints; None for a free swing."""
    arm: ArmMotion | None = None
    """How the arm moved, where that is prescribed; None where it was clamped or moved by itself."""

    @property
    def alone(self) -> bool:
        """Whether one rod swung alone, so that the readings of joint 2 mean nothing."""
        return self.mounting in ("inner", "outer")

    @property
    def weighs(self) -> bool:
        """Whether a known mass or torque makes the scale of all torques visible."""
        return self.added is not None or self.torques is not None

    @property
    def free(self) -> bool:
        """Whether nothing known drives the rods: no torque, and no arm that moves."""
        return self.torques is None and self.arm is None

    @property
    def held(self) -> bool:
        """Whether all that hung on joint 1 turned as one."""
        return self.mounting != "both"

    @property
    def starts(self) -> int:
        """Numbers of an initial state: two angles and two speeds, one speed of a clamped elbow, one rod's own."""
        return {"both": 4, "clamped": 3}.get(self.mounting, 2)


BOTH = Setup()
"""Both rods swing, and nothing is clamped on."""
