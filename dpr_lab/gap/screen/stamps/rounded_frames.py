"""Even time stamps of film frames that are unevenly spaced.

A program exports a film at a rate that does not divide its frame rate, for example eight rows per second of a film with
30 frames per second. Row i then shows the frame floor(i q + p) for q frames per row and a constant p, so that the rows
are three or four frames apart, but the time stamps are even. The error of an angle is up to half a frame multiplied by
its speed. The sixth differences of the angles are much smaller at the instants of the frames than at the time stamps.
"""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dpr_lab.arrays import Array
from dpr_lab.estimation.noise import ORDER, difference_weights


@dataclass(frozen=True, slots=True)
class RoundedFrameSettings:
    """Limits for the detection of rounded frames."""

    films: tuple[float, ...] = (24.0, 25.0, 30.0, 50.0, 60.0, *(rate / 1.001 for rate in (24.0, 30.0, 60.0)))
    """Usual frame rates of films, Hz."""
    fewest: int = 48
    """Minimum number of readings."""
    fast: float = 0.4
    """Fraction of the windows that are compared: those with the fastest motion."""
    even: float = 0.05
    """Maximum deviation of a time stamp from an even clock, in periods."""
    rows: float = 1.1
    """Maximum number of rows, including missing rows, divided by the rows of the table."""
    whole: float = 0.02
    """Minimum distance of the number of frames per row from an integer."""
    phases: int = 32
    """Number of values of the phase that are compared."""
    ratio: float = 2.0
    """Minimum ratio of the differences on even times to those on frames. Correct time stamps of one of 1265
    simulated films exceed both limits (decision 131)."""
    quantile: float = 0.7
    """Quantile of the differences that is compared. In contrast to an rms, it is insensitive to a single outlier."""
    likelihood: float = 4.0
    """Minimum log-likelihood ratio for the frames, nats."""


ROUNDED = RoundedFrameSettings()


@dataclass(frozen=True, slots=True)
class RoundedFrames:
    """Rows that are unevenly spaced frames of a film."""

    film_hz: float
    """Frame rate of the film, Hz."""
    frames: tuple[int, int]
    """Smallest and largest number of frames from one row to the next."""
    instants: Array
    """(n,) instants of the frames, s, with the mean of the time stamps."""


def rounded_frames(t: Array, joints: Array) -> RoundedFrames | None:
    """Return the film frames that explain the angles better than the even time stamps, or None.

    Args:
        t: (n,) time stamps, s, in which rows may be missing
        joints: (n, m) angles, rad
    """
    if len(t) < ROUNDED.fewest:
        return None
    steps = np.diff(t)
    index = np.concatenate([[0.0], np.cumsum(np.round(steps / np.median(steps)))])
    period, start = np.polyfit(index, t, 1)
    if np.abs(t - start - index * period).max() > ROUNDED.even * period or index[-1] > ROUNDED.rows * len(t):
        return None
    angles = sliding_window_view(joints, ORDER + 1, axis=0)
    moved = np.abs(joints[ORDER:] - joints[:-ORDER]) / (index[ORDER:] - index[:-ORDER])[:, None]
    fast = (moved > 0.0) & (moved >= np.quantile(moved, 1 - ROUNDED.fast, axis=0))

    def size(instants: Array) -> Array:
        weights = difference_weights(sliding_window_view(instants, ORDER + 1), period)
        differences = np.abs(np.einsum("wmj,wj->wm", angles, weights))
        used = zip(differences.T, fast.T, strict=True)
        return np.array([np.quantile(x[rows], ROUNDED.quantile) if rows.any() else 0.0 for x, rows in used])

    tiny = np.finfo(float).tiny
    stamped, independent = size(t), fast.sum(axis=0) / (ORDER + 1)
    best, most = None, ROUNDED.likelihood
    for film_hz, phase in ((film, k / ROUNDED.phases) for film in ROUNDED.films for k in range(ROUNDED.phases)):
        per_row = film_hz * period
        if per_row < 1.0 or abs(per_row - round(per_row)) < ROUNDED.whole:
            continue
        numbers = np.floor(index * per_row + phase)
        apart, instants = np.diff(numbers)[np.diff(index) == 1.0], numbers / film_hz
        gains = np.log(np.maximum(stamped, tiny) / np.maximum(size(instants), tiny))
        likelihood = float(independent @ gains)
        if likelihood > max(most, np.log(ROUNDED.ratio) * independent.sum()):
            frames = int(apart.min()), int(apart.max())
            best, most = RoundedFrames(film_hz, frames, instants + np.mean(t - instants)), likelihood
    return best
