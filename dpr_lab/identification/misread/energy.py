"""Test whether the rods, or rods and arm, gain energy from a drive that the description does not contain.

The energy E of the rods, divided by the base parameter b, is linear in the ratios of the rods. The work of known
torques, divided by b, is linear in 1/b:

    E/b = a/b omega1^2 / 2 + omega2^2 / 2 + d/b (cos(theta1 - theta2) omega1 omega2 + g/L1 cos theta2) + e1/b cos theta1

The energy of rods without another drive only decreases. The sum of the energy increases is minimised over all positive
ratios. The minimum is therefore zero for a passive rig with any friction. It is computed by linear programming, without
a fit of the motion.

The energy of rods and arm is linear in their parameters. It contains the mass matrix M of `dpr_lab.dynamics.arm`, the
gravity of the rods, and a spring of the arm with stiffness k0 and any rest angle f0 / k0:

    E = omega^T M(theta) omega / 2 + e1 cos theta1 + e2 cos theta2 + k0 theta0^2 / 2 - f0 theta0

If an arm is described as free, the same minimum over all positive parameters shows whether it was driven.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.identification.misread.balance import periods
from dpr_lab.identification.misread.local_motion import LocalMotionSettings, local_motion
from dpr_lab.identification.misread.readings import arm_turned
from dpr_lab.identification.preprocess import PreprocessedRun
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.shown import listed, percent


@dataclass(frozen=True, slots=True)
class EnergyRiseSettings:
    """Settings of the tests for energy increases of the rods, and of rods and arm."""

    apart_s: float = 0.1
    """Interval over which the energy is averaged, s; the noise of the speeds is then negligible."""
    quiet_rad: float = 0.01
    """Maximum standard deviation of a reading for sufficiently accurate speeds, rad."""
    least_ratio: float = 0.01
    """Smallest permitted inertia and gravity torque, relative to one inertia; typical ratios are above 0.3."""
    least_exchange: float = 0.5
    """Minimum range of the energy, relative to the largest range of one of its terms.

    The total energy of rods in good bearings hardly changes. Errors of the speeds at a low sample rate are then a large
    share of its range.
    """
    entering: float = 0.3
    """Minimum sum of energy increases of driven rods, relative to the range of the energy.

    The ratio is up to 1e-4 for free rods, 0.013 with an error of 6 % in L1, and 0.9 or more for driven rods and rods on
    a moving arm.
    """
    motion: LocalMotionSettings = field(
        default_factory=lambda: LocalMotionSettings(degree=3, window_share=0.15, window=(7, 101))
    )
    """Settings of the local polynomials for the speeds of rods and arm."""
    arm_entering: float = 0.2
    """Minimum sum of energy increases of a driven arm, relative to the range of the energy.

    For 59 free arms with an effect the ratio is at most 0.03, and 0.16 with cogging. It exceeds this limit for 37 of 54
    driven arms.
    """


ENERGY = EnergyRiseSettings()


def energy_rise(runs: Sequence[PreprocessedRun], rig: Rig) -> float:
    """Minimise the sum of the energy increases over the ratios; return it relative to the range of the energy.

    The result is 0 for passive rods. Runs with a moving arm, with a single rod, or with much noise are ignored. If no
    other run remains, the result is 0.
    """
    free = [
        prepared
        for prepared in runs
        if prepared.run.arm is None
        and not prepared.run.setup.held
        and prepared.noise.std_joint.max() < ENERGY.quiet_rad
    ]
    parts = [_terms(prepared, rig) for prepared in free]
    means = [interval_means(part, prepared.run.t) for part, prepared in zip(parts, free, strict=True)]
    driven = any(mean[:, 4].any() for mean in means)
    bounds = [(ENERGY.least_ratio, None)] * 3 + [(0.0, None if driven else 0.0)]
    return relative_rise(means, [part[:, :4] for part in parts], bounds)


def energy_remedy(runs: Sequence[Run], rig: Rig) -> str:
    """Describe the probable causes of an energy increase and how to correct them.

    A known torque, a motor in the rig file or a moving encoder 0 indicates the cause. Without such evidence, an
    undescribed drive and wrong readings are both possible.
    """
    runs = [run for run in runs if run.arm is None]
    if any(run.torques is not None for run in runs):
        return "The known torques do not supply this energy: check their unit, sign and joint, and any other drive."
    if geared := rig.joints.geared:
        joints = listed([f"joint {joint}" for joint in geared])
        return f"The rig file describes a motor at {joints}: record or import its torque (without --torque none)."
    if any(map(arm_turned, runs)):
        return "Encoder 0 shows that the arm moves: record or import with --arm prescribed, or clamp the arm."
    drive = "If a drive acts on the rods, record or import its torque (without --torque none)."
    if all(run.counts is not None for run in runs):
        return (
            f"{drive} Otherwise check counts_per_rev in [encoders] of the rig file; an encoder may also have a delay or"
            " backlash."
        )
    arm = "" if all(map(_arm_measured, runs)) else " If the arm moves, import theta0 with --arm prescribed."
    return (
        f"{drive}{arm} Otherwise check the unit and scale of the angles; an encoder may also have a delay or backlash."
    )


def _arm_measured(run: Run) -> bool:
    """Return whether an encoder measured the arm; a constant column contains no reading."""
    return run.arm_read is not False and float(np.ptp(run.theta[:, 0])) > 0.0


def relative_rise(
    means: Sequence[Array], parts: Sequence[Array], bounds: Sequence[tuple[float | None, float | None]]
) -> float:
    """Minimise the sum of the energy increases over k - 1 parameters; return it relative to the range of the energy.

    The minimum is found by linear programming. The result is 0 if the sum cannot be computed.

    Args:
        means: for each run, (intervals, k) means of the terms of the energy; the parameter of the first term is 1
        parts: for each run, (n, at most k) terms that determine the range of the energy, without the work
        bounds: bounds of the k - 1 other parameters
    """
    from scipy.optimize import linprog

    rises = np.concatenate([np.diff(mean, axis=0) for mean in means]) if means else np.empty((0, 1))
    if not len(rises) or not np.isfinite(rises).all():
        return 0.0
    count, free = len(rises), len(bounds)
    solution = linprog(
        np.concatenate([np.zeros(free), np.ones(count)]),
        A_ub=np.hstack([rises[:, 1:], -np.eye(count)]),
        b_ub=-rises[:, 0],
        bounds=[*bounds, *[(0.0, None)] * count],
        method="highs",
    )
    if not solution.success:
        return 0.0
    parameters = np.append(1.0, solution.x[:free])
    spread = 0.0
    for part in parts:
        terms = part * parameters[: part.shape[1]]
        spread += max(float(np.ptp(terms.sum(axis=1))), ENERGY.least_exchange * float(np.ptp(terms, axis=0).max()))
    return float(solution.fun / spread) if spread > 0.0 else 0.0


def _terms(prepared: PreprocessedRun, rig: Rig) -> Array:
    """Return the terms (n, 5) of the energy, divided by the inertia b.

    The columns are the terms of b, a, d and e1, and the negative work of the known torques, which is the term of 1/b.
    """
    theta1, theta2, omega1, omega2 = prepared.states.T
    mixed = np.cos(theta1 - theta2) * omega1 * omega2 + rig.g / rig.L1 * np.cos(theta2)
    work = np.zeros(len(theta1))
    if prepared.run.torques is not None:
        power = prepared.run.torques[:, 0] * omega1 + prepared.run.torques[:, 1] * (omega2 - omega1)
        work[1:] = np.cumsum(power[:-1] * np.diff(prepared.run.t))
    return np.stack([0.5 * omega2**2, 0.5 * omega1**2, mixed, np.cos(theta1), -work], axis=1)


def interval_means(terms: Array, t: Array) -> Array:
    """Return the (intervals, k) means of terms (n, k) over intervals of `ENERGY.apart_s`."""
    edges = np.flatnonzero(np.diff(np.floor((t - t[0]) / ENERGY.apart_s), prepend=-1.0))
    return np.add.reduceat(terms, edges) / np.diff(edges, append=len(t))[:, None]


def undescribed_drive(runs: Sequence[Run], rig: Rig) -> str:
    """Return a message if an arm described as free gains energy, otherwise an empty text."""
    parts = [part for run in runs if run.arm_mode == "free" and (part := _terms_with_arm(run, rig)) is not None]
    inertias_and_gravity = [(ENERGY.least_ratio, None)] * (parts[0].shape[1] - 3 if parts else 0)
    rise = relative_rise(parts, parts, [*inertias_and_gravity, (0.0, None), (None, None)])
    if rise < ENERGY.arm_entering:
        return ""
    return (
        f"the arm is described as free, but the energy of rods and arm rises by {percent(rise)} of its range, which"
        " friction and springs cannot cause: its motor was on, or another force pushed it. Import or capture with"
        " --arm driven and the input of the motor, or with --arm prescribed if the input is unknown"
    )


def _terms_with_arm(run: Run, rig: Rig) -> Array | None:
    """Return interval means (intervals, 5 or 7) of the energy terms of a run.

    The terms are those of the parameters a, [b, d,] e1, A, k0 and f0. The result is None if the speeds are unknown.
    """
    swing = run.swing
    motion = local_motion(swing.t, swing.theta, min(periods(rig)), ENERGY.motion)
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
