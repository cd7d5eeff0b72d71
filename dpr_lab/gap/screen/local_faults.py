"""Outliers, and steps that stay: what stands out from a local polynomial.

A swing is smooth over a few milliseconds; a reading off its neighbours, or all readings from one on, are not.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class LocalFaultSettings:
    """From where on a fault stands out."""

    half_window_s: float = 0.014
    """Half the length of the local polynomial."""
    fewest_half: int = 5
    """Samples in half a window at least, below 360 Hz: the polynomial has six numbers."""
    most_half: int = 16
    """Samples in half a window at most, above 1.1 kHz."""
    degree: int = 5
    """Of the polynomial: over 28 ms a 5 Hz tumble is one to 1e-5 rad."""
    stands_out: float = 6.0
    """Standard deviations: three runs hold 6e4 readings; noise alone lifts one so far in about 1e4 such sets."""
    above_surroundings: float = 4.0
    """Times what is usual about it: a violent stretch lifts every residual, a fault only its own."""
    usual: float = 0.9
    """Quantile of the surroundings, 2 to 10 half windows away, that is usual."""
    reach: int = 3
    """Samples about a peak among which the fault is looked for."""
    least_seen: float = 1e-3
    """Share of a step or spike that a polynomial must leave."""
    smooth: int = 4
    """Samples on either side over which a speed is taken, so that one jittered instant does not make it."""
    bends: float = 1 / 23040
    """Of (speed times half a window)^6 rad: what is left of cos(w t) by the best polynomial of degree 5 (Chebyshev)."""


LOCAL_FAULTS = LocalFaultSettings()


@dataclass(frozen=True, slots=True)
class LocalFaults:
    """What one encoder did wrong, by indices of its readings."""

    outliers: Indices
    """Single readings that are off."""
    steps: tuple[tuple[int, float], ...]
    """First reading after each step, and its size, rad."""


def local_faults(
    t: Array,
    angle: Array,
    keep: NDArray[np.bool_],
    noise: tuple[float, float],
    period: float,
    settings: LocalFaultSettings = LOCAL_FAULTS,
) -> LocalFaults:
    """Outliers and steps of one encoder.

    Args:
        t: (n,) instants, s
        angle: (n,) readings, rad
        keep: (n,) which of them are plausible at all
        noise: standard deviation of a reading at rest (rad) and of an instant (s)
        period: nominal time between samples, s
        settings: from where on a fault stands out
    """
    half = int(np.clip(round(settings.half_window_s / period), settings.fewest_half, settings.most_half))
    outliers: list[int] = []
    steps: list[tuple[int, float]] = []
    if keep.sum() >= 4 * half:
        grid = np.arange(t[0], t[-1] + 0.5 * period, period)
        z = _standing_out(_spline(t[keep], angle[keep], grid), half, noise, period, settings)
        for about in grid[_peaks(z, half, settings)]:
            window = (half + 0.5) * period
            first, last = np.searchsorted(t, about - window, side="right"), np.searchsorted(t, about + window)
            near = first + np.flatnonzero(keep[first:last])
            if len(near) < half:
                continue
            at, size = _step_or_outlier(t[near], angle[near], about, period, settings)
            if size is None:
                outliers.append(int(near[at]))
            else:
                steps.append((int(near[at]), size))
    return LocalFaults(np.array(outliers, dtype=np.int64), tuple(steps))


def _standing_out(
    even: Array, half: int, noise: tuple[float, float], period: float, settings: LocalFaultSettings
) -> Array:
    """(n,) by how many standard deviations a step before a sample, or the sample alone, stands out; 0 at the ends.

    A swing too fast for the polynomial leaves residuals of its own, and nothing less is believed.
    """
    reach = settings.smooth
    level = np.convolve(np.pad(even, reach, mode="edge"), np.full(2 * reach + 1, 1 / (2 * reach + 1)), mode="valid")
    speed = _highest(np.abs(np.gradient(level, period)), half)[half:-half]
    seen = [np.abs(np.convolve(even, one[::-1], mode="valid")) for one in _filters(half, settings.degree)]
    bent = settings.bends * (speed * half * period) ** (settings.degree + 1) * np.sqrt(2 * half + 1)
    return np.pad(np.maximum(*seen) / np.sqrt(noise[0] ** 2 + (noise[1] * speed) ** 2 + bent**2), half)


@cache
def _filters(half: int, degree: int) -> tuple[Array, Array]:
    """Weights that read a step before the sample in the middle, and the middle sample alone, off a polynomial.

    Both are scaled to unit variance on unit white noise.
    """
    at = np.arange(-half, half + 1) / half
    smooth = np.linalg.qr(np.vander(at, degree + 1))[0]
    filters = []
    for shape in ((at >= 0).astype(float), (np.arange(2 * half + 1) == half).astype(float)):
        rest = shape - smooth @ (smooth.T @ shape)
        filters.append(rest / np.linalg.norm(rest))
    return filters[0], filters[1]


def _highest(values: Array, half: int) -> Array:
    """(n,) highest of (n,) positive values among so many neighbours on either side."""
    found, width = np.pad(values, half), 1
    while width <= 2 * half:
        shift = min(width, 2 * half + 1 - width)
        found, width = np.maximum(found[:-shift], found[shift:]), width + shift
    return found


def _peaks(z: Array, half: int, settings: LocalFaultSettings) -> Indices:
    """Local maxima that stand out from zero and from their surroundings."""
    highest = np.flatnonzero((z > settings.stands_out) & (z >= _highest(z, half)))
    return highest[z[highest] > settings.above_surroundings * _usual(z, highest, half, settings.usual)]


def _usual(z: Array, at: Indices, half: int, share: float) -> Array:
    """(places,) quantile of what lies 2 to 10 half windows from each place; zero where nothing does."""
    reach = 10 * half
    away = np.concatenate([np.arange(-reach, -2 * half), np.arange(2 * half + 1, reach)])
    around = np.sort(np.pad(z, reach, constant_values=np.inf)[reach + at[:, None] + away], axis=1)
    last = np.maximum(np.isfinite(around).sum(axis=1) - 1, 0)
    below = np.floor(share * last).astype(np.int64)
    low, high = (np.take_along_axis(around, i[:, None], axis=1)[:, 0] for i in (below, np.minimum(below + 1, last)))
    return np.where(np.isfinite(low), low + (high - low) * (share * last - below), 0.0)


def _step_or_outlier(
    t: Array, angle: Array, about: float, period: float, settings: LocalFaultSettings
) -> tuple[int, float | None]:
    """What a polynomial lacks most in a few samples: one reading that is off (its index), or a step from one on.

    Args:
        t: (n,) instants, s
        angle: (n,) readings, rad
        about: where something is wrong, s
        period: time between samples, s
        settings: the polynomial, and how far from there a fault is looked for

    Returns:
        index of the sample, and the size of the step, rad; no size for a single reading
    """
    away, at = np.abs(t - about), np.arange(len(t))[:, None]
    near = int((away < (settings.reach + 0.5) * period).sum())
    places = np.argsort(away, kind="stable")[: max(near, 1)]
    smooth = np.linalg.qr(np.vander((t - about) / np.ptp(t), settings.degree + 1))[0]
    shapes = np.hstack([at == places, at >= places]).astype(np.float64)
    shapes -= smooth @ (smooth.T @ shapes)
    power, along = (shapes**2).sum(axis=0), (angle - smooth @ (smooth.T @ angle)) @ shapes
    seen = power > settings.least_seen
    explained = np.where(seen, along**2, 0.0) / np.where(seen, power, 1.0)
    # A reading alone on its side of a step is an outlier too, and few readings say no more: of equals, the nearest.
    best = int(np.argmax(explained >= (1 - 1e-9) * explained.max()))
    size = float(along[best] / power[best]) if best >= len(places) else None
    return int(places[best % len(places)]), size


def _spline(t: Array, y: Array, at: Array, sweeps: int = 40) -> Array:
    """Values at some instants of the cubic spline through readings, whose two pieces at either end are one cubic.

    Its slopes s at the readings make the curvature continuous. With spacings h and difference quotients d,

        s_i = 1.5 (w d_i-1 + (1 - w) d_i) - 0.5 (w s_i-1 + (1 - w) s_i+1),    w = h_i / (h_i-1 + h_i)

    Each sweep through these halves the error. This is scipy's CubicSpline, which takes longer to import than a run to
    screen.
    """
    h = np.diff(t)
    d = np.diff(y) / h
    w = h[1:] / (h[:-1] + h[1:])
    left, right, known = 0.5 * w, 0.5 * (1 - w), 1.5 * (w * d[:-1] + (1 - w) * d[1:])
    # The slopes at both ends follow from s_1 and s_n-2, and are eliminated from their equations.
    first = d[0] * (3 - w[0]) + d[1] * (1 - w[0]) ** 2 / w[0]
    last = d[-1] * (2 + w[-1]) + d[-2] * w[-1] ** 2 / (1 - w[-1])
    left[0], right[0], known[0] = 0.0, 1 - w[0], 2 * known[0] - w[0] * first
    left[-1], right[-1], known[-1] = w[-1], 0.0, 2 * known[-1] - (1 - w[-1]) * last
    s = np.gradient(y, t)
    for _ in range(sweeps):
        s[1:-1] = known - left * s[:-2] - right * s[2:]
    s[0], s[-1] = first - s[1] / w[0], last - s[-2] / (1 - w[-1])
    i = np.clip(np.searchsorted(t, at, side="right") - 1, 0, len(h) - 1)
    x, square, cube = at - t[i], (3 * d - 2 * s[:-1] - s[1:]) / h, (s[:-1] + s[1:] - 2 * d) / h**2
    return y[i] + x * (s[i] + x * (square[i] + x * cube[i]))
