"""Outliers and lasting steps, detected by their deviations from a local polynomial.

A swing is smooth over a few milliseconds. A single wrong reading, or a step of all later readings, is a discontinuity.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers, neighbours


@dataclass(frozen=True, slots=True)
class LocalFaultSettings:
    """Limits of the detection of local faults."""

    half_window_s: float = 0.014
    """Half the length of the local polynomial, s."""
    fewest_half: int = 5
    """Minimum number of samples in half a window; the polynomial has six coefficients.

    The limit applies below 360 Hz.
    """
    most_half: int = 16
    """Maximum number of samples in half a window; the limit applies above 1.1 kHz."""
    degree: int = 5
    """Degree of the polynomial; over 28 ms it fits a rotation at 5 Hz to 1e-5 rad."""
    stands_out: float = 6.0
    """Minimum size of a fault, in standard deviations of its estimate.

    Three runs contain 6e4 readings. Noise alone exceeds the threshold in about one of 1e4 such sets.
    """
    above_surroundings: float = 4.0
    """Minimum ratio of the significance of a fault to the usual level of its surroundings.

    Fast motion increases the residuals of the whole neighbourhood, a fault only those nearby.
    """
    usual: float = 0.9
    """Quantile of the significance that defines the usual level of the surroundings.

    The surroundings are the readings at a distance of 2 to 10 half windows.
    """
    reach: int = 3
    """Maximum distance of a fault from the peak of the significance, in samples."""
    least_seen: float = 1e-3
    """Minimum squared norm of a unit step or outlier after the fit of the polynomial, for a detectable fault."""
    smooth: int = 4
    """Number of samples on either side for the estimate of the speed; one wrong instant then has little influence."""
    bends: float = 1 / 23040
    """Coefficient of (speed times half a window)^6 in the residual of the best polynomial of degree 5, rad.

    The coefficient is derived from the residual for cos(w t) (Chebyshev).
    """


LOCAL_FAULTS = LocalFaultSettings()


def local_faults(
    t: Array,
    angle: Array,
    keep: Flags,
    noise: tuple[float, float],
    period: float,
) -> tuple[list[int], list[tuple[int, float]]]:
    """Detect the outliers and steps of one encoder.

    Args:
        t: (n,) times, s
        angle: (n,) readings, rad
        keep: (n,) mask of the plausible readings
        noise: standard deviation of a reading at rest (rad) and of an instant (s)
        period: nominal sampling interval, s

    Returns:
        indices of the isolated outliers, and index of the first reading after each step with its size, rad
    """
    half = int(np.clip(round(LOCAL_FAULTS.half_window_s / period), LOCAL_FAULTS.fewest_half, LOCAL_FAULTS.most_half))
    outliers: list[int] = []
    steps: list[tuple[int, float]] = []
    if keep.sum() >= 4 * half:
        grid = np.arange(t[0], t[-1] + 0.5 * period, period)
        z = _significance(_interpolated(grid, t[keep], angle[keep]), half, noise, period)
        for instant_near in grid[_peaks(z, half)]:
            window = (half + 0.5) * period
            first, last = (
                np.searchsorted(t, instant_near - window, side="right"),
                np.searchsorted(t, instant_near + window),
            )
            near = first + np.flatnonzero(keep[first:last])
            if len(near) < half:
                continue
            instant, size = _step_or_outlier(t[near], angle[near], instant_near, period)
            if size is None:
                outliers.append(int(near[instant]))
            else:
                steps.append((int(near[instant]), size))
    return outliers, steps


def _interpolated(grid: Array, t: Array, angle: Array) -> Array:
    """Return the readings at the instants of an even grid, interpolated unless they were taken at these instants."""
    if len(t) == len(grid) and np.allclose(t, grid, rtol=0.0):
        return angle
    from scipy.interpolate import CubicSpline  # its import takes a tenth of a short diagnosis

    return np.asarray(CubicSpline(t, angle)(grid))


def _significance(even: Array, half: int, noise: tuple[float, float], period: float) -> Array:
    """Return the (n,) significance of a step or outlier, in standard deviations.

    The residual of the polynomial in a fast swing is treated as additional noise. The significance is 0 at the ends.
    """
    level = neighbours(even, LOCAL_FAULTS.smooth).mean(axis=1)
    speed = neighbours(np.abs(np.gradient(level, period)), half).max(axis=1)[half:-half]
    responses = [np.abs(np.convolve(even, filter_[::-1], mode="valid")) for filter_ in _filters(half)]
    bent = LOCAL_FAULTS.bends * (speed * half * period) ** (LOCAL_FAULTS.degree + 1) * np.sqrt(2 * half + 1)
    return np.pad(np.maximum(*responses) / np.sqrt(noise[0] ** 2 + (noise[1] * speed) ** 2 + bent**2), half)


@cache
def _filters(half: int) -> tuple[Array, Array]:
    """Return two filters, which estimate a step before the middle sample and an outlier at the middle sample.

    Both estimates have unit variance for unit white noise.
    """
    positions = np.arange(-half, half + 1) / half
    smooth = np.linalg.qr(np.vander(positions, LOCAL_FAULTS.degree + 1))[0]
    filters = []
    for shape in ((positions >= 0).astype(float), (np.arange(2 * half + 1) == half).astype(float)):
        remainder = shape - smooth @ (smooth.T @ shape)
        filters.append(remainder / np.linalg.norm(remainder))
    return filters[0], filters[1]


def _peaks(z: Array, half: int) -> Integers:
    """Return the indices of significant local maxima far above their surroundings."""
    highest = np.flatnonzero((z > LOCAL_FAULTS.stands_out) & (z >= neighbours(z, half).max(axis=1)))
    usual = np.array([_usual(z, centre, half) for centre in highest.tolist()])
    return highest[z[highest] > LOCAL_FAULTS.above_surroundings * usual]


def _usual(z: Array, centre: int, half: int) -> float:
    """Return a quantile of the values at a distance of 2 to 10 half windows from a centre; zero without such values."""
    before, after = z[: max(centre - 2 * half, 0)], z[centre + 2 * half + 1 :]
    around = np.concatenate([before[-8 * half :], after[: 8 * half - 1]])
    return float(np.quantile(around, LOCAL_FAULTS.usual)) if len(around) else 0.0


def _step_or_outlier(t: Array, angle: Array, centre: float, period: float) -> tuple[int, float | None]:
    """Return the sample that is most likely an outlier or the beginning of a step.

    Args:
        t: (n,) times, s
        angle: (n,) readings, rad
        centre: instant of the detected deviation, s
        period: sampling interval, s

    Returns:
        index of the sample, and size of the step, rad; the size of an outlier is None
    """
    away, candidates = np.abs(t - centre), np.arange(len(t))[:, None]
    near = int((away < (LOCAL_FAULTS.reach + 0.5) * period).sum())
    places = np.argsort(away, kind="stable")[: max(near, 1)]
    smooth = np.linalg.qr(np.vander((t - centre) / np.ptp(t), LOCAL_FAULTS.degree + 1))[0]
    shapes = np.hstack([candidates == places, candidates >= places]).astype(np.float64)
    shapes -= smooth @ (smooth.T @ shapes)
    power, projections = (shapes**2).sum(axis=0), (angle - smooth @ (smooth.T @ angle)) @ shapes
    detectable = power > LOCAL_FAULTS.least_seen
    explained = np.where(detectable, projections**2, 0.0) / np.where(detectable, power, 1.0)
    # A single reading on one side of a step is also an outlier, and few readings contain no more information: among
    # equally likely faults, the nearest is chosen.
    best = int(np.argmax(explained >= (1 - 1e-9) * explained.max()))
    size = float(projections[best] / power[best]) if best >= len(places) else None
    return int(places[best % len(places)]), size
