"""How much of a plant's effects can be seen: what no undisturbed swing of 0.5 s explains, in units of the noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.sensitivity import sensitivities


@dataclass(frozen=True, slots=True)
class GapMeasure:
    """What a gap is measured on, and how finely."""

    rate_hz: float = 200.0
    duration: float = 10.0
    """Of each release, s."""
    window: float = 0.5
    """Length of a segment with a start state of its own, s."""
    step: float = 2.5e-3
    """Of the integrator, s."""
    rounds: int = 3
    """Of Gauss-Newton; from the truth two are enough for any effect that the first second does not dwarf."""


MEASURE = GapMeasure()

HANGING = np.array([np.pi, np.pi, 0.0, 0.0])

Array = NDArray[np.float64]


def gap_size(
    ratios: Array, frame: tuple[float, float], period: float, readings: Sequence[Array], noise: Array, relative: bool
) -> float:
    """Root mean square of what is left of noiseless readings after the best undisturbed fit, over the noise.

    The fit has the five ratios and, for each segment of `MEASURE.window`, a free start state; it starts at the truth.

    Args:
        ratios: (5,) true ratios of base parameters
        frame: L1 (m), g (m/s^2)
        period: time between readings, s
        readings: for each release (n, 2) what joint encoders 1 and 2 read, rad; hanging is 0
        noise: (2,) standard deviation of the encoders' readings, rad
        relative: whether encoder 2 reads theta2 - theta1

    Returns:
        gap in units of the noise; inf where the fit leaves what can be computed
    """
    length = round(MEASURE.window / period)
    pieces = [release[k : k + length] for release in readings for k in range(0, len(release) - length + 1, length)]
    values, starts = np.array(ratios), np.array([_start(piece, period, relative) for piece in pieces])
    wanted, times = np.array(pieces), [np.arange(length) * period] * len(pieces)
    laid_out, left = segments(times, range(len(pieces)), step=MEASURE.step), np.array([np.inf])
    for _ in range(MEASURE.rounds):
        swings, slopes = sensitivities(values, *frame, laid_out, starts)
        if not (np.isfinite(swings).all() and np.isfinite(slopes).all()):
            return float("inf")
        expected = _as_read(swings - HANGING, relative).reshape(wanted.shape)
        columns = _as_read(slopes, relative).reshape(*wanted.shape, -1) / noise[:, None]
        shift, start_shifts, left = _solved(
            ((wanted - expected) / noise).reshape(len(pieces), -1), columns.reshape(len(pieces), 2 * length, -1)
        )
        values, starts = values + shift, starts + start_shifts
    return float(np.sqrt(np.mean(left**2)))


def _start(readings: Array, period: float, relative: bool) -> Array:
    """(4,) about the state at the first of some readings."""
    theta = readings[:3].copy()
    theta[:, 1] += relative * theta[:, 0]
    omega = (-3 * theta[0] + 4 * theta[1] - theta[2]) / (2 * period)
    return np.concatenate([theta[0] + np.pi, omega])


def _as_read(columns: Array, relative: bool) -> Array:
    """Rows theta1, theta2 (axis 1) as the joint encoders have them."""
    read = columns[:, :2].copy()
    if relative:
        read[:, 1] -= read[:, 0]
    return read


def _solved(rest: Array, slope: Array) -> tuple[Array, Array, Array]:
    """Least squares with the start states eliminated: shift of ratios, of start states, and residual.

    Args:
        rest: (segments, m) residual
        slope: (segments, m, 5 + 4) its slopes in ratios and start state
    """
    common = len(RATIOS)
    Q, R = np.linalg.qr(slope[:, :, common:])
    shared, free = slope[:, :, :common], np.einsum("smk,sm->sk", Q, rest)
    crossed = np.einsum("smk,smj->skj", Q, shared)
    projected = shared - np.einsum("smk,skj->smj", Q, crossed)
    within = rest - np.einsum("smk,sk->sm", Q, free)
    shift, *_ = np.linalg.lstsq(projected.reshape(-1, common), within.ravel(), rcond=None)
    start_shifts = np.linalg.solve(R, (free - crossed @ shift)[:, :, None])[:, :, 0]
    return shift, start_shifts, within - projected @ shift
