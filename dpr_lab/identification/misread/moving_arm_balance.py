r"""Balance of the last rod of a moving arm: whether its acceleration can be that of a rod that the arm moves.

The last rod, the inner one or the outer one of two, with its angle th, the angle q of the arm and, of two rods, the
angle th1 of the inner one, obeys (docs/theory.md, three coordinates)

    al = k1 sin(th) + k2 cos(th) q'' + k3 sin(th) cos(th) q'^2 + k4 w + k5 s(w)
         + k6 cos(th1 - th) al1 + k7 sin(th1 - th) w1^2

whichever torque moves the arm. It is linear in the coefficients k, which are fitted without the rig file. The zero and
the signs of the angles only change signs of coefficients; a wrong unit breaks the equation.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.identification.misread.local_motion import local_motion
from dpr_lab.identification.misread.torque_balance import TORQUES

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ArmBalanceSettings:
    """Limits of the balance of a rod on a moving arm."""

    broken: float = 0.2
    """Share of the acceleration that the equation does not explain from which the unit is doubted: right units of 21
    simulated rigs left at most 0.13, degrees declared as rad at least 0.92, rad declared as degrees at least 0.27.
    """
    better: float = 4.0
    """Factor by which this share must fall in the other unit."""


ARM_BALANCE = ArmBalanceSettings()


def arm_residual(t: Array, theta: Array, mounted: str, period_s: float) -> float:
    """Share of the last rod's acceleration that its equation does not explain, rms; nan with too few rows.

    Args:
        t: (n,) s
        theta: (n, 3) angles of arm and rods, rad
        mounted: mounted rods, as in the rig file
        period_s: period of the rod's small oscillation, s
    """
    last = 2 if mounted == "both" else 1
    rods = local_motion(t, theta[:, [1, last]], period_s, TORQUES.motion)
    arm = local_motion(t, theta[:, [0, 0]], period_s, TORQUES.motion)
    if rods is None or arm is None:
        return float("nan")
    (inner, th), (w1, w), (al1, al) = rods.rods.T, rods.omega.T, rods.alpha.T
    columns = [
        np.sin(th), np.cos(th) * arm.alpha[:, 0], np.sin(2 * th) * arm.omega[:, 0] ** 2,
        w, np.tanh(w / TORQUES.slipping),
        *([np.cos(inner - th) * al1, np.sin(inner - th) * w1**2, w1] if last == 2 else []),
    ]  # fmt: skip
    matrix = np.column_stack(columns)
    size = float(np.sqrt(np.mean(al**2)))
    if not size > 0:
        return float("nan")
    away = al - matrix @ np.linalg.lstsq(matrix, al, rcond=None)[0]
    return float(np.sqrt(np.mean(away**2))) / size


def wrong_unit(residual: float, converted: float, settings: ArmBalanceSettings = ARM_BALANCE) -> bool:
    """Whether the angles have another unit, from the residuals in the stated unit and in the other one."""
    return residual > settings.broken and settings.better * converted < residual
