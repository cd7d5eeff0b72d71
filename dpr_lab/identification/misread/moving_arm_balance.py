"""Torque balance of the last rod, which tests the description of a moving arm.

The last rod is the outer rod, or the only rod. th is the angle of this rod, w its speed and al its acceleration. q is
the angle of the arm. If there are two rods, th1, w1 and al1 belong to the inner rod; otherwise, these terms are
omitted. The equation of motion is (docs/theory.md, three coordinates)

    al = k1 sin(th) + k2 cos(th) q'' + k3 sin(th) cos(th) q'^2 + k4 w + k5 s(w)
         + k6 cos(th1 - th) al1 + k7 sin(th1 - th) w1^2 + k8 w1 + k9 sin(th1) cos(th) q'^2

for any torque that moves the arm, where s is the sign, smoothed near w = 0. The equation is linear in the coefficients
k1 to k9, which are fitted without the rig file. Errors of half a turn in the zero, and errors in the signs of the
angles, only change signs of coefficients. An incorrect unit of the rod angles violates the equation. If the true angle
of the arm is f q instead of q, then k2 / k1 = -f L0 / g and k3 = f^2. Both equations determine the scale f of the arm's
angle.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from math import log, sqrt

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.identification.misread.balance import periods
from dpr_lab.identification.misread.local_motion import local_motion
from dpr_lab.identification.misread.scaled_readings import ScaledReadings, per_degree
from dpr_lab.identification.misread.torque_balance import TORQUES
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class ArmBalanceSettings:
    """Thresholds of the torque balance of a rod on a moving arm."""

    broken: float = 0.2
    """Maximum relative residual for which the unit of the rods is not doubted.

    On 33 simulated rigs the residual was at most 0.15 in the right unit, at least 0.92 for degrees declared as rad, and
    at least 0.27 for rad declared as degrees.
    """
    better: float = 4.0
    """Minimum factor by which the relative residual decreases in the other unit."""
    scaled: float = 1.5
    """Minimum factor by which the scale of the arm's angle must deviate from 1 to be doubted."""
    agree: float = 1.2
    """Maximum ratio of the two estimates of the scale for which they agree.

    The estimates differ if the arm hardly moves, because noise reduces them by different amounts, or if L0 is
    incorrect, which changes only one of them.
    """
    sure: float = 3.0
    """Minimum difference between the squared scale and a limit, in standard deviations."""
    degrees: float = 1.4
    """Maximum factor between a scale and that of degrees for which the readings are in degrees.

    Noise reduces an estimated scale by a factor of up to 1.3.
    """
    simple: float = 1.15
    """Maximum factor between a scale and 1/2 or 2 for which the scale counts as this value."""


ARM_BALANCE = ArmBalanceSettings()


@dataclass(frozen=True, slots=True)
class ArmBalance:
    """Result of a fit of the equation of motion of the last rod."""

    residual: float
    """Relative residual: rms of the residual over rms of the acceleration; NaN with too few rows."""
    gravity: float = 0.0
    """Coefficient of gravity, 1/s^2; positive unless the zero of the rod is off by half a turn."""
    coupled: float = 1.0
    """Estimate of the scale f of the arm's angle from the coupling with the arm's acceleration."""
    squared: float = 1.0
    """Estimate of f^2 from the coupling with the squared speed of the arm."""
    squared_std: float = np.inf

    @property
    def arm_scale(self) -> float | None:
        """True arm angle divided by its reading, or None if the two estimates disagree.

        The ratio is 1 unless it differs significantly from 1.
        """
        limits, reach = ARM_BALANCE, ARM_BALANCE.sure * self.squared_std
        if not (self.residual < limits.broken and self.squared > reach and self.coupled != 0.0):
            return None
        if abs(log(abs(self.coupled) / sqrt(self.squared))) > log(limits.agree):
            return None
        off = self.squared + reach < limits.scaled**-2 or self.squared - reach > limits.scaled**2
        return abs(self.coupled) if off else 1.0

    @property
    def is_right(self) -> bool:
        """Whether the coefficients agree with the rig, so that signs, zeros and scales are correct."""
        near_one = self.gravity > 0.0 < self.coupled and abs(log(self.coupled)) < log(ARM_BALANCE.scaled)
        return near_one and self.arm_scale == 1.0


def arm_balance(t: Array, theta: Array, rig: Rig) -> ArmBalance:
    """Fit the equation of motion of the last rod to a recording.

    Args:
        t: (n,) s
        theta: (n, 3) angles of arm and rods, rad
        rig: mounted rods, lengths and gravity
    """
    if not len(t):
        return ArmBalance(np.nan)
    last, period_s = 2 if rig.rods.mounted == "both" else 1, min(periods(rig))
    motion = local_motion(t, theta[:, [0, 1, last]], period_s, TORQUES.motion)
    if motion is None:
        return ArmBalance(np.nan)
    (_, inner, th), (speed, w1, w), (rise, al1, al) = motion.rods.T, motion.omega.T, motion.alpha.T
    centrifugal = np.cos(th) * speed**2
    columns = [
        np.sin(th), np.cos(th) * rise, np.sin(th) * centrifugal, w, np.tanh(w / TORQUES.slipping),
        *([np.cos(inner - th) * al1, np.sin(inner - th) * w1**2, w1, np.sin(inner) * centrifugal] if last == 2 else []),
    ]  # fmt: skip
    matrix = np.column_stack(columns)
    sizes, size = np.linalg.norm(matrix, axis=0), float(np.sqrt(np.mean(al**2)))
    if not (size > 0 and (sizes[:3] > 0).all()):
        return ArmBalance(np.nan)
    scaled = matrix / np.where(sizes > 0, sizes, 1.0)
    k = np.linalg.lstsq(scaled, al, rcond=None)[0]
    variance = float(np.mean((al - scaled @ k) ** 2))
    std = np.sqrt(variance * np.diag(np.linalg.pinv(scaled.T @ scaled)))
    k1, k2, k3 = (k[:3] / sizes[:3]).tolist()
    coupled = -k2 / k1 * rig.g / rig.L0 if k1 else 0.0
    return ArmBalance(sqrt(variance) / size, k1, coupled, k3, float(std[2] / sizes[2]))


def angles_are_right(runs: Iterable[Run], rig: Rig) -> bool:
    """Check whether any recording shows that signs, zeros and scales of the angles are right.

    Args:
        runs: recordings of a moving arm
        rig: mounted rods, lengths and gravity
    """
    return any(arm_balance(run.t, run.theta, rig).is_right for run in (run.swing for run in runs))


def wrong_unit(residual: float, converted: float) -> bool:
    """Check whether the residual is large in the stated unit of angles, and much smaller in the other unit."""
    return residual > ARM_BALANCE.broken and ARM_BALANCE.better * converted < residual


def is_unit(scale: float | None, factor: float) -> bool:
    """Check whether a scale is, within the noise, the conversion factor of a unit."""
    return scale is not None and abs(log(scale / factor)) < log(ARM_BALANCE.degrees)


def wrong_scale(t: Array, theta: Array, rig: Rig) -> ScaledReadings | None:
    """Detect a wrong scale of the arm's angle, or degrees declared as rad.

    The result is None if the readings indicate neither. If the rods are in degrees and the scale of the arm is
    undetermined, the arm is assumed to be in degrees as well.

    Args:
        t: (n,) times, s
        theta: (n, 3) angles of arm and rods in the stated interpretation, rad
        rig: mounted rods, lengths and gravity
    """
    balance, rods = arm_balance(t, theta, rig), 1.0
    if balance.residual > ARM_BALANCE.broken:
        factors = np.array([1.0, per_degree(), per_degree()])
        converted = (arm_balance(t, zero + (theta - zero) * factors, rig) for zero in (0.0, np.pi))
        best = min(converted, key=lambda other: other.residual)
        if wrong_unit(balance.residual, best.residual):
            balance, rods = best, per_degree()
    arm = per_degree() if is_unit(balance.arm_scale, per_degree()) else balance.arm_scale or rods
    arm = next((factor for factor in (0.5, 2.0) if abs(log(arm / factor)) < log(ARM_BALANCE.simple)), arm)
    return None if arm == rods == 1.0 else ScaledReadings(arm, rods)
