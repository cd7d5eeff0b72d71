r"""Torque balance: whether the accelerations of a table can be those of the rig's rods.

With the base parameters a, b, d, e1 and the viscous coefficients c1, c2 (docs/theory.md), delta = th1 - th2 and the
torques f1, f2 of Coulomb friction, the equations of motion of both rods are

    a al1 + d (cos(delta) al2 + sin(delta) w2^2) - e1 sin(th1) + c1 w1 + f1 s(w1) - c2 (w2 - w1) - f2 s(w2 - w1)
        = tau1 - tau2
    b al2 + d (cos(delta) al1 - sin(delta) w1^2 - g/L1 sin(th2)) + c2 (w2 - w1) + f2 s(w2 - w1) = tau2

They are linear in all coefficients, which are fitted within bounds about the rig file's values. The balance needs
accelerations, and thus more rows than the energy balance (`balance`). It sees friction and gravity at every instant,
so that a wrong zero or scale of one rod does not pass as friction.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.fitting.projection import RIDGE, bounded_solution
from dpr_lab.identification.misread.balance import ENERGY, best_zeros, periods
from dpr_lab.identification.misread.local_motion import LocalMotion, LocalMotionSettings, local_motion
from dpr_lab.rig import Rig

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class TorqueBalanceSettings:
    """Settings of the torque balance."""

    motion: LocalMotionSettings = field(default=LocalMotionSettings(degree=4, window_share=1 / 5, window=(7, 101)))
    """Local polynomials for the accelerations."""
    fewest_a_period: float = 30.0
    """Minimum number of rows per period of the faster oscillation; the smallest window is too long with fewer."""
    coulomb: float = 1.0
    """Largest Coulomb friction of a joint relative to the largest torque of gravity on its rod."""
    slipping: float = 0.1
    """Speed over which Coulomb friction changes its sign, rad/s: the resolution of the velocities."""


TORQUES = TorqueBalanceSettings()


@dataclass(frozen=True, slots=True)
class TorqueBalance:
    """Accelerations of the rods in a table, and the known torques."""

    moving: LocalMotion
    torques: Array | None
    """(k, 2) known torques of the joints, N m; None for a free swing."""
    rig: Rig
    settings: TorqueBalanceSettings

    def residual(self, added: Array | tuple[float, float] = (0.0, 0.0)) -> float:
        """Rms error of both equations relative to the torques of gravity; infinite without motion.

        Args:
            added: (2,) angles added to both rods, rad
        """
        columns, target, least, most = self._equations(self.moving.rods + np.asarray(added))
        if not np.std(target) > 0:
            return np.inf
        H = columns.T @ columns
        x = bounded_solution(H + RIDGE * np.trace(H) * np.eye(len(H)), columns.T @ target, least, most)
        return float(np.sqrt(2 * np.mean((columns @ x - target) ** 2)))

    def zeros(self) -> tuple[float, float]:
        """Angles to add to both rods, within a turn, with the smallest residual."""
        return best_zeros(self._thinned().residual)

    def _thinned(self) -> "TorqueBalance":
        every, moving = max(1, len(self.moving.t) // ENERGY.zero_rows), self.moving
        names = ("near", "t", "rods", "omega", "alpha")
        kept = LocalMotion(*(getattr(moving, name)[::every] for name in names))
        return replace(self, moving=kept, torques=None if self.torques is None else self.torques[::every])

    def _equations(self, rods: Array) -> tuple[Array, Array, Array, Array]:
        """Columns, target, and bounds of the coefficients relative to the values of the rig file."""
        a, b, d, e1, c1, c2 = base_parameters(self.rig.nominal, self.rig.L1, self.rig.g).tolist()
        e2 = d * self.rig.g / self.rig.L1
        (th1, th2), (w1, w2), (al1, al2) = rods.T, self.moving.omega.T, self.moving.alpha.T
        cos, sin, none, turning = np.cos(th1 - th2), np.sin(th1 - th2), np.zeros_like(th1), w2 - w1
        slip1, slip2 = np.tanh(w1 / self.settings.slipping), np.tanh(turning / self.settings.slipping)
        pairs = [
            (a * al1, none),
            (none, b * al2),
            (d * (cos * al2 + sin * w2**2), d * (cos * al1 - sin * w1**2) - e2 * np.sin(th2)),
            (c1 * w1, none),
            (-c2 * turning, c2 * turning),
            (e1 * slip1, none),
            (-e2 * slip2, e2 * slip2),
        ]
        least, most = [1 / ENERGY.slack] * 3 + [0.0] * 4, [ENERGY.slack] * 3 + [ENERGY.friction] * 2
        most += [self.settings.coulomb] * 2
        if self.torques is not None:
            pairs.append((self.torques[:, 1] - self.torques[:, 0], -self.torques[:, 1]))
            least, most = [*least, 1 / ENERGY.slack], [*most, ENERGY.slack]
        columns = np.stack([np.concatenate(pair) for pair in pairs], axis=1)
        target = np.concatenate([e1 * np.sin(th1), none])
        size = max(float(np.hypot(np.std(e1 * np.sin(th1)), np.std(e2 * np.sin(th2)))), np.finfo(float).tiny)
        return columns / size, target / size, np.array(least), np.array(most)


def torque_balance(
    t: Array, rods: Array, torques: Array | None, rig: Rig, settings: TorqueBalanceSettings = TORQUES
) -> TorqueBalance | None:
    """Torque balance of one interpretation of a table; None if its rows are too few for accelerations.

    Args:
        t: (n,) s
        rods: (n, 2) absolute angles, rad
        torques: (n, 2) known torques of the joints, N m; None for a free swing
        rig: the recorded rig
        settings: settings of the balance
    """
    fast = periods(rig)[1]
    if len(t) < settings.motion.fewest or not fast / float(np.median(np.diff(t))) >= settings.fewest_a_period:
        return None
    moving = local_motion(t, rods, fast, settings.motion)
    if moving is None:
        return None
    return TorqueBalance(moving, None if torques is None else torques[moving.near], rig, settings)
