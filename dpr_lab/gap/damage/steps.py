"""Lasting steps of an encoder reading: gain of a step in the residuals, and visibility in the readings.

A residual can also change like a step if the zero of an encoder differs between recordings, or if friction holds a rod
away from the vertical. In these cases, however, the readings before and after the instant lie on one smooth curve. A
step must therefore be visible in the readings themselves.
"""

from dataclasses import dataclass

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.gap.screen.record import Record


@dataclass(frozen=True, slots=True)
class StepSettings:
    """Settings of the tests for a step."""

    seen: float = 1e-6
    """Minimum fraction of the squared norm of a detectable change of the readings that remains after the projection."""
    side: int = 8
    """Number of readings on either side of a step to which a polynomial is fitted."""
    degree: int = 5
    """Degree of the polynomial that is fitted to the readings around a step."""
    reach: int = 3
    """Maximum error of the position of a step in the residual, in readings."""
    part: float = 0.5
    """Minimum ratio of the step in the readings to the step of the residual."""
    errors: float = 3.0
    """Tolerance of the size of the step in the readings, and its minimum size, in standard errors.

    The minimum size is `part` of the step of the residual if this is smaller.
    """


STEPS = StepSettings()


def shows_step(record: Record, joint: int, instant: float, size: float) -> bool:
    """Return whether the readings themselves contain the step of a residual.

    A polynomial with a step is fitted to the readings. Its step must be significant, or at least the part
    `StepSettings.part` of the step of the residual, and must not be significantly smaller than this part. The result is
    False if too few readings lie before or after the instant.

    Args:
        record: the recording
        joint: joint of the reading, 0 or 1
        instant: time of the step, s
        size: step of the residual, rad
    """
    after, side = int(np.searchsorted(record.t, instant)), STEPS.side
    firsts = np.arange(max(after - STEPS.reach, side), min(after + STEPS.reach, len(record.t) - side) + 1)
    if not len(firsts):
        return False
    windows = firsts[:, None] + np.arange(-side, side)
    projection = record.joints[windows, joint] @ _STEP_SHAPE / _STEP_POWER
    error = np.median(record.sigma[windows, joint], axis=1) / _STEP_POWER**0.5
    shown, least, scatter = np.sign(size) * projection, STEPS.part * abs(size), STEPS.errors * error
    return bool(((shown + scatter >= least) & (shown >= np.minimum(least, scatter))).any())


def _step_shape() -> Array:
    """Return a unit step in the middle of (2 side,) readings, with polynomials projected out."""
    around = np.arange(-STEPS.side, STEPS.side)
    smooth = np.linalg.qr(np.vander((around + 0.5) / STEPS.side, STEPS.degree + 1))[0]
    shape = (around >= 0).astype(np.float64)
    return shape - smooth @ (smooth.T @ shape)


_STEP_SHAPE = _step_shape()
_STEP_POWER = float(_STEP_SHAPE @ _STEP_SHAPE)


def step_gains(weight: Array, e: Array, Q: Array, ends: Integers) -> tuple[Array, Array]:
    """Compute gain and size of a step before each sample of one joint.

    The step lasts to the end of its segment.

    Args:
        weight: (samples,) weights of the readings, 1/rad
        e: (samples,) whitened residual, with the columns Q projected out
        Q: (samples, q) orthonormal columns that are projected out
        ends: (samples,) index of the first sample of the next segment

    Returns:
        (samples,) reduction of chi2, (h e)^2 / h^2 with the projected step h, and (samples,) size (h e) / h^2, rad;
        zero where Q spans the step
    """
    score, power = sums_to_end(weight * e, ends), sums_to_end(weight**2, ends)
    remaining = power - np.sum(sums_to_end(weight[:, None] * Q, ends) ** 2, axis=1)
    visible = remaining > STEPS.seen * np.maximum(power, 1.0)
    size = np.where(visible, score / np.where(visible, remaining, 1.0), 0.0)
    return score * size, size


def sums_to_end(values: Array, ends: Integers) -> Array:
    """Sum values (samples, ...) from each sample to the end of its segment."""
    sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    return sums[ends] - sums[:-1]
