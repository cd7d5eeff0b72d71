"""Known conditions of a run besides its readings: mounting and drive."""

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
    """Known joint torques; each value holds until the next instant, the first and the last beyond the record."""

    t: Array
    """(n,) increasing, s since the release."""
    joints: Array
    """(n, 2) torque of joint 1 on the inner rod, and of joint 2 on the outer one, N m."""
    kind: str = ""
    """`measured` or `commanded`, if known."""
    on_arm: Array | None = None
    """(n,) torque on a driven arm, N m; None if it is unknown."""
    scaled: bool = True
    """Whether they are known in N m and thus determine the scale of all torques; False: known up to a factor."""

    @property
    def on_joints(self) -> bool:
        """Whether a torque acts at joint 1 or 2."""
        return _on_joints(self)

    @property
    def arm_knots(self) -> tuple[Array, Array]:
        """(n + 2,) instants and (n + 2,) impulse on the arm up to each, N m s; empty without a torque on the arm."""
        return _arm_knots(self)

    @property
    def knots(self) -> tuple[Array, Array]:
        """(n + 2,) instants and (n + 2, 2) impulse on theta1, theta2 up to each, N m s; linear in between."""
        return _knots(self)

    def earlier(self, share: float) -> Torques:
        """Shift each torque to an earlier time, by a share (0 to 1) of the interval from the previous instant.

        With a share of 1/2, each torque is held in the interval around its instant, which is suitable for samples of a
        continuous signal.
        """
        return replace(self, t=self.t - share * np.diff(self.t, prepend=2 * self.t[:1] - self.t[1:2]))

    def as_samples(self, parts: int = 8) -> Torques:
        """The same torques as samples of a continuous signal, in steps of a fraction of the interval between rows.

        The signal is piecewise cubic without overshoot (Fritsch & Carlson, SIAM J. Numer. Anal. 17, 238, 1980). Each
        step has its mean torque.
        """
        from scipy.interpolate import PchipInterpolator

        rows = np.arange(len(self.t))
        t = np.interp(np.arange(parts * (len(self.t) - 1) + 1) / parts, rows, self.t)
        arm = np.zeros((len(self.t), 0)) if self.on_arm is None else self.on_arm[:, None]
        values = np.hstack([self.joints, arm])
        impulse = PchipInterpolator(self.t, values).antiderivative()(t)
        means = np.vstack([np.diff(impulse, axis=0) / np.diff(t)[:, None], values[-1:]])
        return replace(self, t=t, joints=means[:, :2], on_arm=None if self.on_arm is None else means[:, 2])

    def mean_before(self, instants: ArrayLike, first: Flags | None = None) -> Array:
        """(m, 2) mean generalised torques on theta1, theta2 between each of (m,) instants and the previous one, N m.

        The mean is zero if there is no previous instant: at the first one, and if `first` (m,) is true.
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
    """Known motion of an arm: its speed is linear between instants and constant outside them."""

    t: Array
    """(n,) increasing, s since the release."""
    theta: Array
    """(n,) theta0, rad."""
    omega: Array
    """(n,) speed of the arm, rad/s."""
    noise: float = 0.0
    """Standard deviation of the readings from which it was estimated, rad."""

    def mean_before(self, instants: ArrayLike, first: Flags | None = None) -> Array:
        """(m, 2) mean acceleration and squared speed between each of (m,) instants and the previous one, rad, s.

        Without a previous instant, at the first one and where `first` (m,) is true, the speed is that of the instant.
        """
        instants = np.asarray(instants, dtype=np.float64)
        v, passed = np.interp(instants, self.t, self.omega), _since_before(instants, first)
        u = np.where(np.isfinite(passed), np.append(v[:1], v[:-1]), v)
        return np.stack([(v - u) / passed, (u * u + u * v + v * v) / 3.0], axis=1)


def _since_before(instants: Array, first: Flags | None) -> Array:
    """(m,) time since the previous instant; infinite without one."""
    passed = np.diff(instants, prepend=-np.inf)
    return passed if first is None else np.where(first, np.inf, passed)


@dataclass(frozen=True, slots=True)
class PrescribedJoint:
    """Representation of a joint with a prescribed motion."""

    inertia: float = 1e6
    """Assumed inertia of the inner rod, kg m^2: it is so large that the outer rod does not move it."""


PRESCRIBED = PrescribedJoint()


def inner_torques(motion: ArmMotion) -> Torques:
    """Torque of joint 1 that gives an inner rod with the inertia of `PRESCRIBED` this motion.

    The acceleration is constant from each row to the next.
    """
    alpha = np.append(np.diff(motion.omega) / np.diff(motion.t), 0.0)
    return Torques(motion.t, np.column_stack([PRESCRIBED.inertia * alpha, np.zeros(len(alpha))]), scaled=False)


@dataclass(frozen=True, slots=True)
class Setup:
    """Mounting of a run and its known inputs."""

    mounting: Mounting = "both"
    """Moving parts: both rods, the inner or outer one alone, or both with the elbow clamped."""
    added: AddedMass | None = None
    """The attached known mass."""
    elbow: float = 0.0
    """Angle theta2 - theta1 of a clamped elbow, rounded to 0.1 rad, because smaller differences add no information
    about the ratios. The simulation takes the exact angle from its initial state.
    """
    torques: Torques | None = None
    """Torques that drove the joints; None for a free swing."""
    arm: ArmMotion | None = None
    """Motion of the arm if it is prescribed; None if it was clamped, free or driven."""
    inner: ArmMotion | None = None
    """Motion of the inner rod if joint 1 is prescribed; its torque is then that of `inner_torques`."""
    arm_moves: bool = False
    """Whether the arm moved by itself or by a drive, so that its angle is a reading and part of the state."""

    @property
    def alone(self) -> bool:
        """Whether a single rod was mounted, so that the readings of joint 2 have no meaning."""
        return self.mounting in ("inner", "outer")

    @property
    def one_degree(self) -> bool:
        """Whether both rods turn together: one rod, or a clamped elbow."""
        return self.mounting != "both"

    @property
    def weighs(self) -> bool:
        """Whether a known mass or torque makes the scale of all torques identifiable."""
        return self.added is not None or (self.torques is not None and self.torques.scaled)

    @property
    def free(self) -> bool:
        """Whether there is no known input: no torque, and no moving arm."""
        return self.torques is None and self.arm is None

    @property
    def held(self) -> bool:
        """Whether all parts on joint 1 turn as one body."""
        return self.mounting != "both"

    @property
    def starts(self) -> int:
        """Number of initial-state variables: two angles and two speeds, or one angle and one speed."""
        return {"both": 4, "clamped": 3}.get(self.mounting, 2) + 2 * self.arm_moves


BOTH = Setup()
"""Both rods mounted, without an attached mass."""


def only_inner(setups: Iterable[Setup]) -> bool:
    """Whether the inner rod swings alone in every run, so that results are relative to its own inertia a."""
    return all(setup.mounting == "inner" for setup in setups)
