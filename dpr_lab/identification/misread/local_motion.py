"""Estimate angles, velocities and accelerations of a swing by local polynomials, without a model."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial.polynomial import polyvander
from numpy.typing import NDArray

from dpr_lab.arrays import Array


@dataclass(frozen=True, slots=True)
class LocalMotionSettings:
    """Settings of the local polynomials."""

    degree: int
    """Degree of the polynomials, at least 2."""
    window_share: float
    """Length of a window relative to the period of the faster oscillation."""
    window: tuple[int, int]
    """Minimum and maximum number of samples of a window."""
    gap: tuple[float, float] = (0.25, 4.0)
    """Minimum interval between rows that counts as a gap, in periods and in median intervals; both must be exceeded.

    No window contains a gap.
    """
    looked_at_s: float = 10.0
    """Duration of the beginning of a table that is examined, s; it suffices to detect a wrong interpretation."""
    looked_at: int = 2000
    """Minimum number of rows that are examined, because the unit of time may be wrong."""
    fewest: int = 30
    """Minimum number of windows for a result."""
    instants: int = 1500
    """Maximum number of windows, and therefore of instants."""


@dataclass(frozen=True, slots=True)
class TurningSettings:
    """Threshold above which a reversal of the motion is a turning point."""

    back: float = 0.05
    """Minimum motion in both directions at a turning point, relative to the range of the angle."""


TURNING = TurningSettings()


@dataclass(frozen=True, slots=True)
class LocalMotion:
    """Motion of rods, or of arm and rods, at the centres of windows."""

    near: NDArray[np.intp]
    """(k,) indices of the rows at the centres of the windows."""
    t: Array
    """(k,) times, s."""
    rods: Array
    """(k, angles) angles, rad."""
    omega: Array
    """(k, angles) speeds, rad/s."""
    alpha: Array
    """(k, angles) accelerations, rad/s^2."""


def local_motion(t: Array, rods: Array, period_s: float, settings: LocalMotionSettings) -> LocalMotion | None:
    """Estimate angles, speeds and accelerations at the centres of windows.

    The result is None if there are too few rows, or if times are numerically equal.

    Args:
        t: (n,) times, s
        rods: (n, angles) angles of rods, or of arm and rods, rad
        period_s: period of the faster oscillation, s
        settings: settings of the polynomials
    """
    with np.errstate(all="ignore"):
        try:
            motion = _local_motion(t, rods, period_s, settings)
        except np.linalg.LinAlgError:
            return None
    if motion is None or not all(np.isfinite(part).all() for part in (motion.rods, motion.omega, motion.alpha)):
        return None
    return motion


def _local_motion(t: Array, rods: Array, period_s: float, settings: LocalMotionSettings) -> LocalMotion | None:
    from numpy.lib.stride_tricks import sliding_window_view

    rows = max(settings.looked_at, int(np.searchsorted(t, t[0] + settings.looked_at_s)))
    t, rods = t[:rows], rods[:rows]
    if len(t) < settings.fewest:
        return None
    interval = float(np.median(np.diff(t)))
    if interval <= 0.0:
        return None
    window = int(np.clip(period_s * settings.window_share / interval, *settings.window)) // 2 * 2 + 1
    stride = -(-len(t) // settings.instants)
    if len(t) < settings.fewest + window:
        return None
    longest = max(settings.gap[0] * period_s, settings.gap[1] * interval)
    whole = sliding_window_view(np.diff(t), window - 1)[::stride].max(axis=1) <= longest
    if np.count_nonzero(whole) < settings.fewest:
        return None
    times, angles = (sliding_window_view(x, window, axis=0)[::stride][whole] for x in (t, rods))
    times_from_mean = times - times.mean(axis=1, keepdims=True)
    reach = np.abs(times_from_mean).max(axis=1)[:, None]
    powers = polyvander(times_from_mean / reach, settings.degree)
    across = powers.transpose(0, 2, 1)
    coefficients = np.linalg.solve(across @ powers, across @ angles.transpose(0, 2, 1))
    near = np.arange(window // 2, len(t) - window // 2)[::stride][whole]
    return LocalMotion(
        near, times.mean(axis=1), coefficients[:, 0], coefficients[:, 1] / reach, 2 * coefficients[:, 2] / reach**2
    )


def shows_a_period(rods: Array) -> bool:
    """Check whether a rod reverses its direction or makes a full turn.

    `rods` contains the angles (n, rods), rad. A fall in one direction has no period. An error of the time scale is then
    indistinguishable from an unknown initial speed or from friction.
    """
    highest, lowest = np.maximum.accumulate(rods, axis=0), np.minimum.accumulate(rods, axis=0)
    both_ways = np.minimum((highest - rods).max(axis=0), (rods - lowest).max(axis=0))
    extent = np.ptp(rods, axis=0)
    return bool(((both_ways > TURNING.back * extent) | (extent > 2 * np.pi)).any())
