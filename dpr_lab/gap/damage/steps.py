"""Detection of lasting steps of an encoder reading.

Steps are detected by the screening or in the residuals. A step must be visible in the readings themselves, not only in
the residual of a fit. A residual can also change like a step if the zero of an encoder differs between recordings, or
if friction holds a rod away from the vertical. In these cases, however, the readings before and after the instant lie
on one smooth curve.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import islice, pairwise
from typing import NamedTuple

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.effects.effect import Recorded
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.fitting.gauss_newton import Fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.uncompiled import NORMAL_MAD
from dpr_lab.gap.screen.record import Record


@dataclass(frozen=True, slots=True)
class StepSettings:
    """Settings of the search for steps."""

    kept: int = 3
    """Maximum number of steps of a residual that are tried. A recording with more lost counts is unsuitable for a
    fit."""
    before_s: float = 1e-4
    """Time between a step and the first reading that contains it, s; shorter than any sample period."""
    seen: float = 1e-6
    """Minimum fraction of the squared norm of a visible change of the readings that remains after the projection."""
    side: int = 8
    """Number of readings on either side of a step to which a polynomial is fitted."""
    degree: int = 5
    """Degree of the polynomial that is fitted to the readings around a step."""
    reach: int = 3
    """Maximum number of readings by which the residual may misplace a step."""
    part: float = 0.5
    """Minimum ratio of the step in the readings to the step of the residual."""
    errors: float = 3.0
    """Number of standard errors by which the step in the readings may be smaller than the step of the residual.

    A visible step in the readings exceeds the same number of standard errors.
    """
    sharp: float = 2.0
    """Minimum ratio of half a step of the residual to the scatter of apparent steps at all instants of the recording.

    A smaller step cannot be distinguished from a zero that moves gradually or irregularly.
    """
    counts: float = 1.5
    """Maximum size, in counts, of a step that is due to the resolution of an encoder.

    An encoder counts an edge at the same angle in both directions. Readings taken at edges therefore change by one
    count at a reversal.
    """


STEPS = StepSettings()


class ReadingStep(NamedTuple):
    """A step that would explain a part of a residual."""

    gain: float
    """Reduction of chi2 of the segment that contains the step."""
    joint: int
    run: int
    at: float
    """Instant of the step, s."""
    size: float
    """Size of the step, rad."""


def recorded_properties(records: Sequence[Record], problem: Problem, fit: Fit) -> Recorded:
    """Collect the properties of the recordings from which shapes of effects are proposed."""
    screened = [(axis, run, instant) for run, record in enumerate(records) for instant, axis in record.screened.breaks]
    return Recorded(
        arm_moves=tuple(record.encoder0_moves for record in records),
        steps=lambda: screened or visible_steps(records, _steps(problem, fit), problem.model.constants),
    )


def visible_steps(
    records: Sequence[Record], steps: list[ReadingStep], rig: RigConstants
) -> list[tuple[int, int, float]]:
    """Return joint, run and time of each step that the readings can contain, best first.

    Only the readings of an encoder with counts are considered.
    """
    least = [2 * np.pi * STEPS.counts / abs(counts) for counts in (rig.counts_per_rev1, rig.counts_per_rev2)]
    possible = (
        step for step in steps if records[step.run].screened.on_grid[step.joint] and abs(step.size) > least[step.joint]
    )
    shown = (step for step in possible if shows_step(records[step.run], step.joint, step.at, step.size))
    return [(step.joint, step.run, step.at) for step in islice(shown, STEPS.kept)]


def shows_step(record: Record, joint: int, instant: float, size: float) -> bool:
    """Return whether a step significantly improves a polynomial through the readings.

    The step in the readings must be visible, and must not be far smaller than the step of the residual. By chance,
    readings without a step may resemble a small part of the residual's step. The step in the readings must therefore be
    nearer to the step of the residual than to zero. If too few readings lie before or after the instant, the step
    counts as a zero error of the recording.

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
    """Return a step in the middle of (2 side,) readings, with the polynomial projected out."""
    around = np.arange(-STEPS.side, STEPS.side)
    smooth = np.linalg.qr(np.vander((around + 0.5) / STEPS.side, STEPS.degree + 1))[0]
    shape = (around >= 0).astype(np.float64)
    return shape - smooth @ (smooth.T @ shape)


_STEP_SHAPE = _step_shape()
_STEP_POWER = float(_STEP_SHAPE @ _STEP_SHAPE)


def _steps(problem: Problem, fit: Fit) -> list[ReadingStep]:
    """Find the best step of each segment, largest gain first.

    The nonlinear fit determines the exact sizes. A segment that lies entirely after the step contains a constant, which
    its initial state nearly absorbs.
    """
    segments, steps = problem.segments, list[ReadingStep]()
    e, ends = problem.by_sample(fit.linear.e), segments.offsets[problem.owner + 1]
    Q = np.stack([problem.by_sample(column) for column in np.moveaxis(fit.linear.Q, 2, 0)], axis=2)
    run_of = segments.run[problem.owner]
    for joint in range(2):
        weight = problem.weight[:, joint]
        gain, size = step_gains(weight, e[:, joint], Q[:, joint], ends)
        residual = np.divide(e[:, joint], weight, out=np.full(len(weight), np.nan), where=weight > 0)
        apparent = apparent_steps(residual, segments.offsets[problem.owner], ends)
        samples = {run: run_of == run for run in set(segments.run.tolist())}
        recordings = {
            run: (int(np.argmax(mask)), apparent[mask], typical_step(apparent[mask])) for run, mask in samples.items()
        }
        for run, (first, last) in zip(segments.run.tolist(), pairwise(segments.offsets.tolist()), strict=True):
            i = first + 1 + int(np.argmax(gain[first + 1 : last]))
            begin, of_run, typical = recordings[run]
            if not is_sharp(of_run, i - begin, float(size[i]), typical):
                continue
            steps.append(ReadingStep(float(gain[i]), joint, run, float(problem.t[i]) - STEPS.before_s, float(size[i])))
    return sorted(steps, reverse=True)


def apparent_steps(residual: Array, begins: Integers, ends: Integers) -> Array:
    """Fit a polynomial with a step to the residual around each sample.

    Args:
        residual: (samples,) residual, rad; NaN where a reading is missing
        begins: (samples,) index of the first sample of the segment
        ends: (samples,) index of the first sample of the next segment

    Returns:
        (samples,) step before each sample, rad; NaN where the samples of the polynomial are not all readings of one
        segment
    """
    side, place = STEPS.side, np.arange(len(residual))
    apparent = np.full(len(residual), np.nan)
    if len(residual) >= 2 * side:
        apparent[side : len(residual) - side + 1] = np.correlate(residual, _STEP_SHAPE, "valid") / _STEP_POWER
    return np.where((place - begins >= side) & (ends - place >= side), apparent, np.nan)


def typical_step(apparent: Array) -> float:
    """Return the standard deviation of apparent steps (samples,), by their median; zero without any."""
    tested = apparent[np.isfinite(apparent)]
    return NORMAL_MAD * float(np.median(np.abs(tested))) if len(tested) else 0.0


def is_sharp(apparent: Array, place: int, size: float, typical: float) -> bool:
    """Return whether a step of the residual is sharp.

    The step must exceed the apparent steps at the other instants of the recording, and must be visible in the residual.
    Otherwise the zero may have moved gradually or irregularly. Next to the end of a segment, only the size is tested.

    Args:
        apparent: (samples,) apparent steps of one joint in one recording, rad
        place: index of the first sample after the step
        size: size of the step, rad
        typical: `typical_step` of this joint and recording, rad
    """
    near = apparent[max(place - STEPS.reach, 0) : place + STEPS.reach + 1] * np.sign(size)
    least = STEPS.part * abs(size)
    return least >= STEPS.sharp * typical and not np.fmax.reduce(near) < least


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
