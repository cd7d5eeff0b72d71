"""Known conditions of a run: mounting, known torques and prescribed motions."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array, Flags
from dpr_lab.rig_tables import AddedMass, Mounting


@dataclass(frozen=True, slots=True, eq=False)
class Torques:
    """Known joint torques.

    Each value is held until the next instant. The first value also applies before the record, the last one after it.
    """

    t: Array
    """(n,) increasing times since the release, s."""
    joints: Array
    """(n, 2) torque of joint 1 on the inner rod, and of joint 2 on the outer one, N m."""
    kind: str = ""
    """Kind of the torques, `measured` or `commanded`; empty if unknown."""
    on_arm: Array | None = None
    """(n,) torque on a driven arm, N m; None if it is unknown."""
    scaled: bool = True
    """Whether the torques are known in N m, so that they determine the scale of all torques. False: they are known up
    to a factor."""
    interpolated: Torques | None = None
    """Rows between which these torques were interpolated; None if these torques are the rows."""

    @property
    def on_joints(self) -> bool:
        """Whether any torque acts at joint 1 or 2."""
        return _on_joints(self)

    @property
    def arm_knots(self) -> tuple[Array, Array]:
        """Times (n + 2,), s, and time integrals of the arm torque, N m s.

        Empty without a torque on the arm.
        """
        return _arm_knots(self)

    def arm_means(self, instants: Array) -> Array:
        """Return the (m - 1,) mean torques on the arm between successive times (m,), N m."""
        return np.diff(np.interp(instants, *self.arm_knots)) / np.diff(instants)

    @property
    def knots(self) -> tuple[Array, Array]:
        """Times and integrals of the generalised torques.

        The shapes are (n + 2,), s, and (n + 2, 2), N m s. The columns belong to theta1 and theta2. The integrals are
        linear between times.
        """
        return _knots(self)

    def earlier(self, share: float) -> Torques:
        """Shift each torque to an earlier time by a share of the preceding interval.

        With a share of 1/2, each torque is held in the interval around its instant, which is suitable for samples of a
        continuous signal.
        """
        return replace(self, t=self.t - share * np.diff(self.t, prepend=2 * self.t[:1] - self.t[1:2]))

    def as_samples(self, parts: int = 8) -> Torques:
        """Interpret the torques as samples of a continuous signal; return `parts` means per row.

        The signal is interpolated by monotone piecewise cubic polynomials, which do not overshoot (PCHIP; Fritsch &
        Carlson, SIAM J. Numer. Anal. 17, 238, 1980).
        """
        from scipy.interpolate import PchipInterpolator

        rows = np.arange(len(self.t))
        t = np.interp(np.arange(parts * (len(self.t) - 1) + 1) / parts, rows, self.t)
        arm = np.zeros((len(self.t), 0)) if self.on_arm is None else self.on_arm[:, None]
        values = np.hstack([self.joints, arm])
        impulse = PchipInterpolator(self.t, values).antiderivative()(t)
        means = np.vstack([np.diff(impulse, axis=0) / np.diff(t)[:, None], values[-1:]])
        arm_means = None if self.on_arm is None else means[:, 2]
        return replace(self, t=t, joints=means[:, :2], on_arm=arm_means, interpolated=self)

    def mean_before(self, instants: ArrayLike, first: Flags | None = None) -> Array:
        """Return the (m, 2) mean generalised torques between successive times (m,), N m.

        The mean is zero at times without a previous one: at the first instant, and where `first` (m,) is true.
        """
        instants, (t, impulse) = np.asarray(instants, dtype=np.float64), self.knots
        until = np.stack([np.interp(instants, t, column) for column in impulse.T], axis=1)
        passed = _since_before(instants, first)
        gained = np.diff(until, axis=0, prepend=until[:1])
        gained[~np.isfinite(passed)] = 0.0
        return gained / np.where(passed > 0, passed, 1.0)[:, None]


@lru_cache(maxsize=32)  # cached, because every prediction uses it
def _knots(torques: Torques) -> tuple[Array, Array]:
    onward = np.concatenate([torques.t[:1] - 1.0, torques.t, torques.t[-1:] + 1e6])
    joints = np.concatenate([torques.joints[:1], torques.joints])
    held = np.stack([joints[:, 0] - joints[:, 1], joints[:, 1]], axis=1)
    whole = np.cumsum(held * np.diff(onward)[:, None], axis=0)
    return onward, np.concatenate([np.zeros((1, 2)), whole])


@lru_cache(maxsize=32)
def _on_joints(torques: Torques) -> bool:
    return bool(torques.joints.any())


@lru_cache(maxsize=32)
def _arm_knots(torques: Torques) -> tuple[Array, Array]:
    if torques.on_arm is None:
        return np.zeros(0), np.zeros(0)
    onward = np.concatenate([torques.t[:1] - 1.0, torques.t, torques.t[-1:] + 1e6])
    held = np.concatenate([torques.on_arm[:1], torques.on_arm])
    return onward, np.append(0.0, np.cumsum(held * np.diff(onward)))


@dataclass(frozen=True, slots=True, eq=False)
class ArmMotion:
    """Known motion of an arm or an inner rod.

    Its speed is linear between the times, and constant before the first and after the last.
    """

    t: Array
    """(n,) increasing times since the release, s."""
    theta: Array
    """(n,) angle, rad."""
    omega: Array
    """(n,) speed, rad/s."""
    noise: float = 0.0
    """Standard deviation of the readings from which the motion was estimated, rad."""

    def scaled(self, factor: float) -> ArmMotion:
        """Return the motion with all angles multiplied by a factor."""
        return replace(self, theta=factor * self.theta, omega=factor * self.omega)

    def mean_before(self, instants: ArrayLike, first: Flags | None = None) -> Array:
        """Return (m, 2) means over each interval: acceleration, rad/s^2, and squared speed, rad^2/s^2.

        Row i belongs to the interval that ends at instant i. At the first instant, and where `first` (m,) is true,
        there is no interval. The squared speed is then that at the instant.
        """
        instants = np.asarray(instants, dtype=np.float64)
        v, passed = np.interp(instants, self.t, self.omega), _since_before(instants, first)
        u = np.where(np.isfinite(passed), np.append(v[:1], v[:-1]), v)
        return np.stack([(v - u) / passed, (u * u + u * v + v * v) / 3.0], axis=1)


def _since_before(instants: Array, first: Flags | None) -> Array:
    """Return the time (m,) since the previous instant, s; infinite if there is none."""
    passed = np.diff(instants, prepend=-np.inf)
    return passed if first is None else np.where(first, np.inf, passed)


@dataclass(frozen=True, slots=True)
class PrescribedJoint:
    """Constants that represent a joint with a prescribed motion in the equation of motion."""

    inertia: float = 1e6
    """Assumed inertia of the inner rod, kg m^2. It is so large that the outer rod does not move the inner rod."""


PRESCRIBED = PrescribedJoint()


def inner_torques(motion: ArmMotion) -> Torques:
    """Compute the torque of joint 1 that produces the prescribed motion of the inner rod.

    The angular acceleration is constant between two rows of the motion.
    """
    alpha = np.append(np.diff(motion.omega) / np.diff(motion.t), 0.0)
    return Torques(motion.t, np.column_stack([PRESCRIBED.inertia * alpha, np.zeros(len(alpha))]), scaled=False)


@dataclass(frozen=True, slots=True)
class Setup:
    """Mounting and known inputs of a run."""

    mounting: Mounting = "both"
    """Moving parts: both rods, the inner or outer rod alone, or both rods with a clamped elbow."""
    added: AddedMass | None = None
    """Known mass that is attached; None if no mass is attached."""
    elbow: float = 0.0
    """Angle theta2 - theta1 of a clamped elbow, rad. It is rounded to 0.1 rad, because smaller differences add no
    information about the ratios. The simulation uses the exact angle of the initial state."""
    torques: Torques | None = None
    """Torques that drove the joints; None for a free swing."""
    arm: ArmMotion | None = None
    """Motion of the arm if it is prescribed; None if it was clamped, free or driven."""
    inner: ArmMotion | None = None
    """Motion of the inner rod if joint 1 is prescribed; otherwise None. The torque of joint 1 is then that of
    `inner_torques`."""
    arm_moves: bool = False
    """Whether the arm was free or driven; its angle is then measured and is part of the state."""

    @property
    def alone(self) -> bool:
        """Whether a single rod was mounted, so that joint 2 has no readings."""
        return self.mounting in ("inner", "outer")

    @property
    def weighs(self) -> bool:
        """Whether a known mass or known torques make the scale of all torques identifiable."""
        return self.added is not None or (self.torques is not None and self.torques.scaled)

    @property
    def free(self) -> bool:
        """Whether there are no known inputs: neither torques nor a prescribed arm."""
        return self.torques is None and self.arm is None

    @property
    def held(self) -> bool:
        """Whether all parts on joint 1 turn as one body.

        This is the case for one rod, and for two rods with a clamped elbow.
        """
        return self.mounting != "both"

    @property
    def initial_values(self) -> int:
        """Number of variables of the initial state: angles and speeds of the moving parts."""
        return {"both": 4, "clamped": 3}.get(self.mounting, 2) + 2 * self.arm_moves


BOTH = Setup()
"""Both rods mounted, without an attached mass."""


def only_inner(setups: Iterable[Setup]) -> bool:
    """Return whether the inner rod swings alone in every run."""
    return all(setup.mounting == "inner" for setup in setups)
