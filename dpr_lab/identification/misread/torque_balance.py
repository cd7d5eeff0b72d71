"""Torque balance of a table, which tests whether its accelerations agree with the rods.

The base parameters are a, b, d and e1 (docs/theory.md). c1 and c2 are viscous coefficients, f1 and f2 torques of
Coulomb friction. th, w and al are the angle, speed and acceleration of a rod, and delta = th1 - th2. s is the sign,
smoothed near zero, and tau1, tau2 are the known torques of the joints. The equations of motion of both rods are

    a al1 + d (cos(delta) al2 + sin(delta) w2^2) - e1 sin(th1) + c1 w1 + f1 s(w1) - c2 (w2 - w1) - f2 s(w2 - w1)
        = tau1 - tau2
    b al2 + d (cos(delta) al1 - sin(delta) w1^2 - g/L1 sin(th2)) + c2 (w2 - w1) + f2 s(w2 - w1) = tau2

The equations are linear in all coefficients, which are fitted within bounds around the values of the rig file. The
balance needs accelerations, and thus more rows than the energy balance (`balance`). The torque balance compares
friction and gravity at every instant. An incorrect zero or scale of one rod is therefore not mistaken for friction.
A clamped elbow, or one rod represented by two equal halves, has one degree of freedom. Only the sum of both equations
is then used, in which the torques of joint 2 cancel.
"""

from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array
from dpr_lab.identification.misread.balance import (
    ENERGY,
    best_zeros,
    coefficient_bounds,
    coefficients,
    mounted_base,
    periods,
)
from dpr_lab.identification.misread.local_motion import LocalMotion, LocalMotionSettings, local_motion
from dpr_lab.rig import Rig


@dataclass(frozen=True, slots=True)
class TorqueBalanceSettings:
    """Settings of the torque balance."""

    motion: LocalMotionSettings = field(default=LocalMotionSettings(degree=4, window_share=1 / 5, window=(7, 101)))
    """Settings of the local polynomials for the accelerations."""
    fewest_a_period: float = 30.0
    """Minimum number of rows per period of the faster oscillation.

    With fewer rows, the smallest window is too long.
    """
    coulomb: float = 1.0
    """Largest Coulomb friction of a joint, relative to the largest gravity torque on its rod."""
    slipping: float = 0.1
    """Speed over which Coulomb friction changes its sign, rad/s: the resolution of the velocities."""


TORQUES = TorqueBalanceSettings()


@dataclass(frozen=True, slots=True)
class TorqueBalance:
    """Equations of motion that are fitted to the accelerations in a table."""

    moving: LocalMotion
    torques: Array | None
    """(k, 2) known torques of the joints, N m; None for a free swing."""
    rig: Rig

    def residual(self, added: Array | tuple[float, float] = (0.0, 0.0)) -> float:
        """Compute the rms error of both equations, relative to the gravity torques.

        The result is infinite if the rods do not move.

        Args:
            added: (2,) angles added to both rods, rad
        """
        return self._solution(*self._equations(self.moving.rods + np.asarray(added)), *self._bounds)[0]

    def zeros(self, *, nearest: bool = False) -> tuple[float, float]:
        """Find the two angles whose addition to the rod angles minimises the residual.

        The angles are less than one turn. If `nearest` is true, the search starts only from added angles of zero and
        ends at the nearest local minimum.
        """
        return best_zeros(self._thinned().residual, self.rig, nearest=nearest)

    def inertias(self) -> tuple[float, Array]:
        """Fit the equations with a free L1; return the residual and the inertias.

        The inertias are relative to gravity torques, in the order of the function `inertias`.
        """
        (columns, target), (least, most) = self._equations(self.moving.rods), self._bounds
        gravity = self._gravity_of_outer(self.moving.rods)
        columns = np.column_stack([*columns.T[:2], columns[:, 2] - gravity, *columns.T[3:], gravity])
        residual, x = self._solution(columns, target, np.append(least, 1 / ENERGY.slack), np.append(most, ENERGY.slack))
        base = mounted_base(self.rig, self.rig.nominal)
        e2 = x[-1] * base[2] * self.rig.g / self.rig.L1
        return residual, inertias(base * [*x[:3], 1.0, 1.0, 1.0], e2, self.rig, self.elbow)

    @property
    def gravity(self) -> tuple[float, float]:
        """Largest gravity torques on joints 1 and 2 according to the rig file, N m."""
        *_, e2 = nominal = self._nominal()
        return nominal[3] + e2, e2

    @property
    def elbow(self) -> float:
        """Angle th2 - th1 of a clamped elbow, rad; unused for two free rods."""
        return float(np.median(self.moving.rods[:, 1] - self.moving.rods[:, 0]))

    def _solution(self, columns: Array, target: Array, least: Array, most: Array) -> tuple[float, Array]:
        """Fit coefficients within bounds, and return the residual and the coefficients.

        The residual is infinite if the rods do not move.
        """
        if not np.std(target) > 0:
            return np.inf, np.ones(len(least))
        x = coefficients(columns.T @ columns, columns.T @ target, least, most)
        return float(np.sqrt(np.sum((columns @ x - target) ** 2) / len(self.moving.t))), x

    @property
    def _bounds(self) -> tuple[Array, Array]:
        return coefficient_bounds(TORQUES.coulomb, self.torques is not None)

    def _thinned(self) -> "TorqueBalance":
        stride, moving = max(1, len(self.moving.t) // ENERGY.zero_rows), self.moving
        names = ("near", "t", "rods", "omega", "alpha")
        thinned = LocalMotion(*(getattr(moving, name)[::stride] for name in names))
        return replace(self, moving=thinned, torques=None if self.torques is None else self.torques[::stride])

    def _equations(self, rods: Array) -> tuple[Array, Array]:
        """Return the regressor matrix and the right-hand side of the equations.

        The coefficients are relative to their values in the rig file.
        """
        a, b, d, e1, c1, c2, e2 = self._nominal()
        (th1, th2), (w1, w2), (al1, al2) = rods.T, self.moving.omega.T, self.moving.alpha.T
        cos, sin, zeros, turning = np.cos(th1 - th2), np.sin(th1 - th2), np.zeros_like(th1), w2 - w1
        slip1, slip2 = np.tanh(w1 / TORQUES.slipping), np.tanh(turning / TORQUES.slipping)
        pairs = [
            (a * al1, zeros),
            (zeros, b * al2),
            (d * (cos * al2 + sin * w2**2), d * (cos * al1 - sin * w1**2) - e2 * np.sin(th2)),
            (c1 * w1, zeros),
            (-c2 * turning, c2 * turning),
            (e1 * slip1, zeros),
            (-e2 * slip2, e2 * slip2),
        ]
        if self.torques is not None:
            pairs.append((self.torques[:, 1] - self.torques[:, 0], -self.torques[:, 1]))
        size = self._size(rods, e1, e2)
        columns = np.stack([self._of_joints(*pair) for pair in pairs], axis=1)
        target = self._of_joints(e1 * np.sin(th1), zeros)
        return columns / size, target / size

    def _of_joints(self, inner: Array, outer: Array) -> Array:
        """Concatenate both equations, or add them if there is only one degree of freedom."""
        return np.concatenate([inner, outer]) if self.rig.rods.mounting == "both" else inner + outer

    def _nominal(self) -> list[float]:
        """Return the base parameters of the rig file, and the gravity torque e2 of the outer rod, N m."""
        base = mounted_base(self.rig, self.rig.nominal).tolist()
        return [*base, base[2] * self.rig.g / self.rig.L1]

    def _size(self, rods: Array, e1: float, e2: float) -> float:
        """Return the rms gravity torque of both rods, N m."""
        std1, std2 = (e1 * np.sin(rods[:, 0])).std(), (e2 * np.sin(rods[:, 1])).std()
        return max(float(np.hypot(std1, std2)), float(np.finfo(float).tiny))

    def _gravity_of_outer(self, rods: Array) -> Array:
        """Return the column of the gravity torque on the outer rod.

        It is a part of the column of d.
        """
        _, _, _, e1, _, _, e2 = self._nominal()
        torque = -e2 * np.sin(rods[:, 1])
        return self._of_joints(np.zeros_like(torque), torque) / self._size(rods, e1, e2)


def inertias(base: Array, e2: ArrayLike, rig: Rig, elbow: float) -> Array:
    """Return the inertias divided by the gravity torques, s^2.

    For two free rods they are a/e1, b/e1 and d/e1. For one degree of freedom with the elbow clamped at an angle x, the
    result is the inertia of both rods divided by their gravity torque:

        (a + b + 2 d cos(x)) / |e1 + e2 exp(i x)|

    Args:
        base: (..., 6) base parameters of the mounted rods
        e2: (...,) gravity torque of the outer rod, N m
        rig: the recorded rig
        elbow: angle th2 - th1, rad; zero for a single rod
    """
    a, b, d, e1, *_ = np.moveaxis(base, -1, 0)
    if rig.rods.mounting == "both":
        return np.stack([a, b, d], axis=-1) / e1[..., None]
    return ((a + b + 2 * d * np.cos(elbow)) / np.abs(e1 + e2 * np.exp(1j * elbow)))[..., None]


def inertia_bounds(rig: Rig, elbow: float) -> tuple[Array, Array]:
    """Return the range of `inertias` within the bounds of the rig file, s^2.

    Only the corners of the bounds are evaluated.
    """
    corners = np.array(list(product(*rig.bounds.T)))
    base = mounted_base(rig, corners)
    ratios = inertias(base, base[:, 2] * rig.g / rig.L1, rig, elbow)
    return ratios.min(axis=0), ratios.max(axis=0)


def torque_balance(t: Array, rods: Array, torques: Array | None, rig: Rig) -> TorqueBalance | None:
    """Return the torque balance of one interpretation of a table.

    The result is None if there are too few rows to estimate accelerations.

    Args:
        t: (n,) times, s
        rods: (n, 2) absolute angles, rad
        torques: (n, 2) known torques of the joints, N m; None for a free swing
        rig: the recorded rig
    """
    fast = periods(rig)[1]
    if len(t) < TORQUES.motion.fewest or not fast >= TORQUES.fewest_a_period * np.median(np.diff(t)):
        return None
    moving = local_motion(t, rods, fast, TORQUES.motion)
    if moving is None:
        return None
    return TorqueBalance(moving, None if torques is None else torques[moving.near], rig)
