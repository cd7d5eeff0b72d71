"""Test whether an arm that is described as free was driven.

The energy E of rods and arm is linear in their parameters. It contains the mass matrix M of `dpr_lab.dynamics.arm`, the
gravity of the rods, and a spring of the arm with stiffness k0 and any rest angle f0 / k0:

    E = omega^T M(theta) omega / 2 + e1 cos theta1 + e2 cos theta2 + k0 theta0^2 / 2 - f0 theta0

Without a drive the energy only decreases. The test computes the sum of the increases of E, and minimises this sum over
all positive parameters. As in `identification.misread.energy`, the minimum is computed by linear programming, without a
fit of the motion.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.identification.misread.balance import periods
from dpr_lab.identification.misread.energy import ENERGY, interval_means, relative_rise
from dpr_lab.identification.misread.local_motion import LocalMotionSettings, local_motion
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.shown import percent


@dataclass(frozen=True, slots=True)
class ArmEnergySettings:
    """Settings of the test of an arm, in addition to `EnergyRiseSettings`."""

    motion: LocalMotionSettings = field(
        default_factory=lambda: LocalMotionSettings(degree=3, window_share=0.15, window=(7, 101))
    )
    """Settings of the local polynomials for the speeds."""
    entering: float = 0.2
    """Minimum sum of energy increases of a driven arm, relative to the range of the energy.

    For 59 free arms with an effect the ratio is at most 0.03, and 0.16 with cogging. It exceeds this limit for 37 of 54
    driven arms.
    """


ARM_ENERGY = ArmEnergySettings()


def undescribed_drive(runs: Sequence[Run], rig: Rig) -> str:
    """Return a message if an arm described as free gains energy, otherwise an empty text."""
    parts = [part for run in runs if run.arm_mode == "free" and (part := _terms(run, rig)) is not None]
    inertias_and_gravity = [(ENERGY.least_ratio, None)] * (parts[0].shape[1] - 3 if parts else 0)
    rise = relative_rise(parts, parts, [*inertias_and_gravity, (0.0, None), (None, None)])
    if rise < ARM_ENERGY.entering:
        return ""
    return (
        f"the arm is described as free, but the energy of rods and arm rises by {percent(rise)} of its range, which"
        " friction and springs cannot cause: its motor was on, or another force pushed it. Import or capture with"
        " --arm driven and the input of the motor, or with --arm prescribed if the input is unknown"
    )


def _terms(run: Run, rig: Rig) -> Array | None:
    """Return interval means (intervals, 5 or 7) of the energy terms of a run.

    The terms are those of the parameters a, [b, d,] e1, A, k0 and f0. The result is None if the speeds are unknown.
    """
    swing = run.swing
    motion = local_motion(swing.t, swing.theta, min(periods(rig)), ARM_ENERGY.motion)
    if motion is None:
        return None
    (q, theta1, theta2), (w0, w1, w2) = motion.rods.T, motion.omega.T
    sin1, cos1, sin2, cos2 = np.sin(theta1), np.cos(theta1), np.sin(theta2), np.cos(theta2)
    of_a = (w1**2 + sin1**2 * w0**2) / 2
    of_e1 = cos1 * (1.0 + rig.L0 / rig.g * w0 * w1)
    of_both = []
    if rig.rods.mounting == "both":
        coupled = np.cos(theta1 - theta2) * w1 * w2 + sin1 * sin2 * w0**2
        of_both = [(w2**2 + sin2**2 * w0**2) / 2, coupled + cos2 / rig.L1 * (rig.g + rig.L0 * w0 * w2)]
    terms = np.stack([of_a, *of_both, of_e1, w0**2 / 2, q**2 / 2, -q], axis=1)
    return interval_means(terms, motion.t)
