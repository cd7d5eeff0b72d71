"""Detection of a hand or a latch that still acts at the beginning of a recording.

push    The energy of the rods, computed with the fitted ratios, rises at the beginning of the recording and then only
        decreases. Undriven rods never gain energy.
hold    The first segment fits worse than all other segments. Without its first readings, it fits as well as the others.
"""

from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array, neighbours
from dpr_lab.dynamics.base import base_of_run
from dpr_lab.effects import effect_params
from dpr_lab.fitting.cut import MIN_SAMPLES
from dpr_lab.fitting.estimate import SCALE, Estimate, whole_of
from dpr_lab.fitting.gauss_newton import Fit, fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.gap.result.finding import SensorFinding
from dpr_lab.gap.screen.differences import spread
from dpr_lab.gap.screen.record import Record
from dpr_lab.gap.screen.recordings import LENGTHS, Recordings


@dataclass(frozen=True, slots=True)
class HandRules:
    """Thresholds of the detection of a hand."""

    followed: float = 8.0
    """Maximum chi2 per reading of a segment that the model of undriven rods fits, relative to the median segment."""
    rises: float = 0.05
    """Minimum rise of the energy by a push, relative to the maximum of the energy."""
    first: float = 3.0
    """Maximum chi2 per reading of a free first segment, absolute and relative to the worst other segment.

    If both limits are exceeded, a hand or a latch acts in the segment.
    """
    at_rest: float = 0.3
    """Maximum speed of rods that a hand holds, relative to their maximum speed.

    Faster rods are not held: the record begins during the swing.
    """
    held: float = 0.8
    """Maximum time for which the rods are held, as a fraction of the duration of the first segment."""
    scatters: float = 5.0
    """Minimum rise of the energy, in standard deviations of the noise of the energy."""
    smoothed: int = 5
    """Number of segments in the running median that smooths the energy."""
    early: float = 0.3
    """Fraction of the recording within which the rise must occur.

    A later rise must be less than half as large.
    """
    iterations: int = 15
    """Maximum number of iterations of a fit of initial states."""


HAND = HandRules()

HELD = "until {:.2g} s the rods do not swing freely: a hand or a latch still acts; these readings are excluded"
"""Evidence of a hand or a latch at the beginning; the argument is a time, s."""


def without_hand(recordings: Recordings, record: Record, ratios: Array) -> Record:
    """Exclude the readings at the beginning of a run while a hand still acts on the rods.

    Args:
        recordings: the runs
        record: one of the runs, a free swing
        ratios: (7,) ratios of a robust fit in short segments
    """
    alone = replace(recordings, ratios=None).only([record])
    undriven = Estimate.of(ratios, effect_params({}), np.zeros((0, 4)))
    problem, fitted = fitted_initial_states(alone, undriven, LENGTHS.first)
    until = _pushed_until(alone, problem, fitted)
    evidence = "the rods gain energy until {:.2g} s: a hand still pushes, so these readings are excluded"
    if until is None:
        until, evidence = _held_until(alone, problem, fitted), HELD
    if until is None:
        return record
    finding = SensorFinding("disturbance", record.run.name, None, float(record.t[0]), evidence.format(until))
    return record.left_out(float(record.t[0]), until).with_findings([finding])


def fitted_initial_states(recordings: Recordings, estimate: Estimate, length: float) -> tuple[Problem, Fit]:
    """Cut recordings into segments, and fit only the initial states of the segments.

    Ratios and effects keep the values of `estimate`. `length` is the approximate length of a segment, s.
    """
    problem, initial = replace(recordings, ratios=None).cut(length)
    return problem, fit(problem, estimate.changed(initial=initial), (), iterations=HAND.iterations)


def energies(problem: Problem, estimate: Estimate) -> Array:
    """Return the (segments,) energy of the rods at the start of each segment, divided by b, 1/s^2.

    The energy is zero for hanging rods at rest.
    """
    constants, (setup,) = problem.model.constants, problem.segments.setups
    base = base_of_run(whole_of(estimate.ratios), setup, constants.L1, constants.g)
    a, b, d, e1, *_ = (base / estimate.ratios[SCALE]).tolist()
    th1, th2, w1, w2 = estimate.initial.T
    w2 = w1 if setup.held else w2
    kinetic = 0.5 * a * w1**2 + 0.5 * b * w2**2 + d * np.cos(th1 - th2) * w1 * w2
    return kinetic + e1 * (1 + np.cos(th1)) + d * constants.g / constants.L1 * (1 + np.cos(th2))


def _pushed_until(recordings: Recordings, problem: Problem, fitted: Fit) -> float | None:
    """Return the start, s, of the first segment that the model fits after a rise of the energy.

    The result is None if the energy does not rise as by a push.
    """
    energy = energies(problem, fitted.estimate)
    begins = problem.t[problem.segments.offsets[:-1]]
    if len(energy) < 2 * HAND.smoothed or not np.isfinite(energy).all():
        return None
    level = fitted.linear.chi2_by_segment / np.diff(problem.segments.offsets)
    if level[0] > max(HAND.first, HAND.first * float(level[1:].max())):
        # The model of undriven rods does not fit a push, so the speeds are estimated from the readings.
        of_readings = energies(problem, fitted.estimate.changed(initial=recordings.cut(LENGTHS.first)[1]))
        energy = np.concatenate([of_readings[:1], energy[1:]])
    smooth, scatter = np.median(neighbours(energy, HAND.smoothed // 2), axis=1), _scatter(energy)
    top = int(np.argmax(energy >= smooth.max() - 2 * scatter))
    if not _only_rose_before(energy, smooth, top, begins, scatter):
        return None
    return float(begins[_first_followed(level, top)])


def _first_followed(level: Array, top: int) -> int:
    """Return the index of the first segment at or after `top` that the undriven model fits.

    In the segment of the push itself, the fitted energy is wrong, so this segment is excluded.
    """
    usual = max(float(np.median(level[top:])), 1.0)
    followed = np.flatnonzero(level[top:] < HAND.followed * usual)
    return top + int(followed[0]) if len(followed) else top


def _held_until(recordings: Recordings, problem: Problem, fitted: Fit) -> float | None:
    """Return the time, s, until which a hand or a latch holds the rods.

    It lies in the first segment: from this time on, the model of undriven rods fits as well as in the other segments.
    The result is None if there is no such time.
    """
    (recording,) = recordings.records
    level = fitted.linear.chi2_by_segment / np.diff(problem.segments.offsets)
    if len(level) < 4 or not np.isfinite(level).all():
        return None
    usual = max(float(level[1:].max()), 1.0)
    if level[0] < HAND.first * usual:
        return None
    # The model of undriven rods does not fit held rods, so the speeds are estimated from the readings.
    speed = np.abs(recordings.cut(LENGTHS.first)[1][:, 2:]).max(axis=1)
    if speed[0] > HAND.at_rest * speed.max():
        return None
    duration = float(problem.t[problem.segments.offsets[1]] - problem.t[0])  # longer than LENGTHS.first at a low rate
    first = np.flatnonzero(recording.t < recording.t[0] + HAND.held * duration)[1:]
    for i in first.tolist():
        begin = float(recording.t[i])
        free = recording.only((recording.t >= begin) & (recording.t < begin + duration))
        if len(free.t) < MIN_SAMPLES:
            return None
        of_free_rods, from_here = fitted_initial_states(recordings.only([free]), fitted.estimate, LENGTHS.first)
        if float(from_here.linear.chi2_by_segment.sum()) < usual * len(of_free_rods.t):
            return begin
    return None


def _only_rose_before(energy: Array, smooth: Array, top: int, begins: Array, scatter: float) -> bool:
    """Return whether the energy increases only before the segment `top`, and then decreases."""
    most = float(smooth[top:].max())
    rise = (most - float(energy[: top + 1].min())) / most
    if top == 0 or rise < max(HAND.rises, HAND.scatters * scatter / most):
        return False
    after = smooth[top:]
    second_rise = float(np.max(after - np.minimum.accumulate(after))) / most
    early = begins[top] - begins[0] <= HAND.early * (begins[-1] - begins[0])
    return bool(early and second_rise < 0.5 * rise and second_rise < max(HAND.rises, 2 * scatter / most))


def _scatter(energy: Array) -> float:
    """Estimate the standard deviation of the energy from second differences, in which a slow decay cancels."""
    variance = 1.0 + 4.0 + 1.0  # second difference of white noise of unit variance
    return spread(np.diff(energy, 2)) / variance**0.5
