"""Compute the gap of a plant: residual of a model without effects in segments of 0.5 s, in units of the noise."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import RATIOS
from dpr_lab.dynamics.segments import segments
from dpr_lab.dynamics.sensitivity import sensitivities
from dpr_lab.rig import Rig
from sim_device.plant.config import PlantConfig


@dataclass(frozen=True, slots=True)
class GapMeasure:
    """Settings of the measurement of a gap."""

    rate_hz: float = 200.0
    duration: float = 10.0
    """Duration of each release, s."""
    window: float = 0.5
    """Length of a segment with its own initial state, s."""
    step: float = 2.5e-3
    """Step of the integrator, s."""
    rounds: int = 3
    """Number of Gauss-Newton iterations. From the true values, two suffice for any effect that does not dominate the
    first second."""


MEASURE = GapMeasure()

HANGING = np.array([np.pi, np.pi, 0.0, 0.0])

Array = NDArray[np.float64]


def gap_size(
    ratios: Array, frame: tuple[float, float], period: float, readings: Sequence[Array], noise: Array, relative: bool
) -> float:
    """Return the rms residual of noiseless readings after the best fit without effects, in units of the noise."""
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
        remaining = ((wanted - expected) / noise).reshape(len(pieces), -1)
        shift, start_shifts, left = eliminated(remaining, columns.reshape(len(pieces), 2 * length, -1), len(RATIOS))
        values, starts = values + shift, starts + start_shifts
    return float(np.sqrt(np.mean(left**2)))


def reading_noise(config: PlantConfig, rig: Rig) -> Array:
    """Return the standard deviation (3,) of encoders 1, 2 and 0, from noise and rounding, rad."""
    noise = np.broadcast_to(np.asarray(config.encoders.noise_counts, dtype=np.float64), 3)
    sigma = np.abs(rig.radians_per_count) * np.sqrt(noise**2 + config.encoders.step_counts**2 / 12)
    return sigma[[1, 2, 0]]


def _start(readings: Array, period: float, relative: bool) -> Array:
    """Return the approximate state (4,) at the first reading of a piece."""
    theta = readings[:3].copy()
    theta[:, 1] += relative * theta[:, 0]
    omega = (-3 * theta[0] + 4 * theta[1] - theta[2]) / (2 * period)
    return np.concatenate([theta[0] + np.pi, omega])


def _as_read(columns: Array, relative: bool) -> Array:
    """Convert rows of theta1 and theta2 (axis 1) to the angles that the encoders of the joints read."""
    read = columns[:, :2].copy()
    if relative:
        read[:, 1] -= read[:, 0]
    return read


def eliminated(residual: Array, slope: Array, common: int, rcond: float | None = None) -> tuple[Array, Array, Array]:
    """Solve a least-squares problem by elimination of the initial states.

    Returns the changes of parameters and of initial states, and the remaining residual.

    Args:
        residual: (segments, m) residual
        slope: (segments, m, common + states) derivatives of the residual with respect to parameters and initial state
        common: number of parameters
        rcond: singular value, relative to the largest one, below which a direction counts as undetermined
    """
    Q, R = np.linalg.qr(slope[:, :, common:])
    shared, free = slope[:, :, :common], np.einsum("smk,sm->sk", Q, residual)
    crossed = np.einsum("smk,smj->skj", Q, shared)
    projected = shared - np.einsum("smk,skj->smj", Q, crossed)
    within = residual - np.einsum("smk,sk->sm", Q, free)
    shift = np.zeros(common)
    if common:
        shift, *_ = np.linalg.lstsq(projected.reshape(-1, common), within.ravel(), rcond=rcond)
    start_shifts = np.linalg.solve(R, (free - crossed @ shift)[:, :, None])[:, :, 0]
    return shift, start_shifts, within - projected @ shift
