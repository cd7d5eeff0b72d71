"""Disturbances of the rods that are no property of the rig: a kick in mid-swing, a hand that pushes.

Both are visible after the bare model has been fitted to short segments with free initial states.

kick        A single segment fits far worse than all others. If it is cut where the speed jumps, both parts fit as well
            as the other segments. An effect of the rig acts along the whole segment; a cut then leaves at least a
            sixteenth of its chi2.
hold        The first segment fits worse than all others, but not without its first readings: a hand or a latch still
            acts.
push        A segment fits worse by orders of magnitude and no cut helps, or the energy of the rods, computed with the
            fitted ratios, rises at the beginning: without a drive the energy only decreases.

No segment spans a kick. Readings under a push are excluded.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import base_of_run
from dpr_lab.effects import effect_params
from dpr_lab.fitting.cut import MIN_SAMPLES
from dpr_lab.fitting.estimate import SCALE, Estimate, whole_of
from dpr_lab.fitting.gauss_newton import Fit, descend, fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.spread import NORMAL_MAD
from dpr_lab.gap.screen.record import Record
from dpr_lab.gap.screen.recordings import LENGTHS, Recordings
from dpr_lab.gap.screen.sensor_faults import Finding


@dataclass(frozen=True, slots=True)
class DisturbanceRules:
    """Thresholds of the detection of disturbances."""

    outstanding: float = 8.0
    """Minimum ratio of chi2 of a kicked segment to that of the worst undisturbed one."""
    pushed: float = 100.0
    """Minimum of this ratio if no cut reduces chi2: an effect of the rig may then be the cause."""
    visible: float = 25.0
    """Minimum chi2 per reading of a disturbed segment."""
    most: float = 0.1
    """Maximum fraction of the segments of a recording that may be disturbed."""
    cut_off: float = 25.0
    """Factor by which a cut at the kick must reduce chi2; an effect along the whole segment falls by 16."""
    rises: float = 0.05
    """Minimum rise of the energy, relative to its maximum, that indicates a push by hand."""
    first: float = 3.0
    """Limit of the chi-square per reading of the first segment, and of its ratio to the worst other one. Above both,
    something else than gravity and friction acts in it.
    """
    at_rest: float = 0.3
    """Maximum speed of rods that a hand holds, relative to their maximum speed: a record may begin in mid-swing."""
    held: float = 0.8
    """Maximum part of the first segment in which the rods may still be held."""
    scatters: float = 5.0
    """Minimum rise of the energy in standard deviations of its noise."""
    smoothed: int = 5
    """Number of segments of the running median by which the energy is smoothed."""
    early: float = 0.3
    """Fraction of the recording within which the rise must occur; later the energy must not rise by half as much."""
    alike: float = 1.5
    """Maximum chi2 per reading on both sides of a kick, relative to that of the worst undisturbed segment."""
    iterations: int = 15
    """Iterations of a fit of initial states."""


DISTURBANCE = DisturbanceRules()


def without_disturbances(recordings: Recordings, ratios: Array) -> Recordings:
    """Split recordings at kicks, and exclude the readings under a push at the beginning.

    Only free swings are tested, because known torques and a moving arm supply energy.

    Args:
        recordings: the runs
        ratios: (7,) of a robust fit in short segments

    Returns:
        the same object if there are no disturbances
    """
    records = [_undisturbed(recordings, recording, ratios) for recording in recordings.records]
    unchanged = all(before is recording for before, recording in zip(records, recordings.records, strict=True))
    return recordings if unchanged else replace(recordings, records=tuple(records))


def _undisturbed(recordings: Recordings, recording: Record, ratios: Array) -> Record:
    if not recording.run.setup.free or recording.encoder0_moves:
        return recording
    alone = replace(recordings, ratios=None).only([recording])
    until = _pushed_until(alone, *_followed(alone, ratios))
    if until is not None:
        evidence = f"the rods gain energy until {until:.2g} s: a hand still pushes, so these readings are excluded"
        return _without_readings(
            recording.only(recording.t >= until), [Disturbed(float(recording.t[0]), until, evidence)]
        )
    until = _held_until(alone, ratios)
    if until is not None:
        evidence = f"until {until:.2g} s the rods do not move as free rods: a hand or a latch still acts; excluded"
        held = Disturbed(float(recording.t[0]), until, evidence)
        recording = _without_readings(recording.only(recording.t >= until), [held])
        alone = alone.only([recording])
    disturbed = _outstanding(alone, ratios)
    # A kick at the start of a segment is not visible in any segment, so the recording is also cut at other instants.
    later = recording.only(recording.t >= recording.t[0] + 0.5 * LENGTHS.first)
    for other in _outstanding(alone.only([later]), ratios):
        if all(abs(other.since - earlier.since) > LENGTHS.first for earlier in disturbed):
            disturbed.append(other)
    return _without_readings(recording, disturbed) if disturbed else recording


@dataclass(frozen=True, slots=True)
class Disturbed:
    """Interval of a disturbance; that of a kick has no length."""

    since: float
    until: float
    evidence: str


def _followed(recordings: Recordings, ratios: Array) -> tuple[Problem, Fit]:
    """One recording in short segments, fitted with given ratios."""
    short, initial = recordings.cut(LENGTHS.first)
    return short, fit(short, Estimate.of(ratios, effect_params({}), initial), (), iterations=DISTURBANCE.iterations)


def _without_readings(recording: Record, disturbed: Sequence[Disturbed]) -> Record:
    """A recording without its disturbed readings, with breaks at the disturbances."""
    findings = [
        Finding("disturbance", recording.run.name, None, disturbance.since, disturbance.evidence)
        for disturbance in disturbed
    ]
    outside = np.all(
        [(recording.t < disturbance.since) | (recording.t >= disturbance.until) for disturbance in disturbed], axis=0
    )
    instants = np.array([disturbance.since for disturbance in disturbed])
    cut = replace(
        recording.only(outside),
        breaks=np.sort(np.append(recording.breaks, instants)),
        kicks=np.append(recording.kicks, instants),
    )
    return replace(cut, screened=replace(recording.screened, findings=(*recording.screened.findings, *findings)))


def energies(problem: Problem, estimate: Estimate) -> Array:
    """(segments,) energy at the start of each segment of one run, above that of hanging rods, over b, 1/s^2."""
    constants, (setup,) = problem.model.constants, problem.segments.setups
    base = base_of_run(whole_of(estimate.ratios), setup, constants.L1, constants.g)
    a, b, d, e1, *_ = (base / estimate.ratios[SCALE]).tolist()
    th1, th2, w1, w2 = estimate.initial.T
    w2 = w1 if setup.held else w2
    kinetic = 0.5 * a * w1**2 + 0.5 * b * w2**2 + d * np.cos(th1 - th2) * w1 * w2
    return np.asarray(kinetic + e1 * (1 + np.cos(th1)) + d * constants.g / constants.L1 * (1 + np.cos(th2)))


def _pushed_until(recordings: Recordings, problem: Problem, fit: Fit) -> float | None:
    """Start of the first segment from which the energy only decreases, if it rose before; otherwise None."""
    energy = energies(problem, fit.estimate)
    begins = problem.t[problem.segments.offsets[:-1]]
    if len(energy) < 4 or not np.isfinite(energy).all():
        return None
    level = fit.linear.chi2_by_segment / np.diff(problem.segments.offsets)
    top = int(np.argmax(energy))
    if _only_rose_before(energy, energy, top, begins, 0.0):
        return float(begins[_first_followed(level, top)])
    if len(energy) < 2 * DISTURBANCE.smoothed:
        return None
    if level[0] > max(DISTURBANCE.first, DISTURBANCE.first * float(level[1:].max())):
        # Free rods do not follow the readings under a push, so that only the readings show their speed.
        energy[0] = energies(problem, fit.estimate.changed(initial=recordings.cut(LENGTHS.first)[1]))[0]
    smooth, scatter = _smoothed(energy), _scatter(energy)
    top = int(np.argmax(energy >= smooth.max() - 2 * scatter))
    if not _only_rose_before(energy, smooth, top, begins, scatter):
        return None
    return float(begins[_first_followed(level, top)])


def _first_followed(level: Array, top: int) -> int:
    """First segment from `top` on that free rods follow.

    The energy of a segment that contains the push is not the energy at its start.

    Args:
        level: (segments,) chi2 per reading
        top: segment with the maximum energy
    """
    usual = max(float(np.median(level[top:])), 1.0)
    followed = np.flatnonzero(level[top:] < DISTURBANCE.outstanding * usual)
    return top + int(followed[0]) if len(followed) else top


def _held_until(recordings: Recordings, ratios: Array) -> float | None:
    """Instant in the first segment from which free rods follow the readings as well as elsewhere; None: its start."""
    (recording,) = recordings.records
    problem, followed = _followed(recordings, ratios)
    level = followed.linear.chi2_by_segment / np.diff(problem.segments.offsets)
    if len(level) < 4 or not np.isfinite(level).all():
        return None
    usual = max(float(level[1:].max()), 1.0)
    # Free rods do not follow the readings of held ones, so that only the readings show their speed.
    speed = np.abs(recordings.cut(LENGTHS.first)[1][:, 2:]).max(axis=1)
    if level[0] < DISTURBANCE.first * usual or speed[0] > DISTURBANCE.at_rest * speed.max():
        return None
    duration = float(problem.t[problem.segments.offsets[1]] - problem.t[0])  # at a low rate longer than LENGTHS.first
    first = np.flatnonzero(recording.t < recording.t[0] + DISTURBANCE.held * duration)[1:]
    for i in first.tolist():
        begin = float(recording.t[i])
        free = recording.only((recording.t >= begin) & (recording.t < begin + duration))
        if len(free.t) < MIN_SAMPLES:
            return None
        part, fitted = _followed(recordings.only([free]), ratios)
        if float(fitted.linear.chi2_by_segment.sum()) < usual * len(part.t):
            return begin
    return None


def _only_rose_before(energy: Array, later: Array, top: int, begins: Array, scatter: float) -> bool:
    """Whether the energy rises until the segment `top`, early in the recording, and then only decreases."""
    most = float(later[top:].max())
    rise = (most - float(energy[: top + 1].min())) / most
    if top == 0 or rise < max(DISTURBANCE.rises, DISTURBANCE.scatters * scatter / most):
        return False
    after = later[top:]
    second_rise = float(np.max(after - np.minimum.accumulate(after))) / most
    early = begins[top] - begins[0] <= DISTURBANCE.early * (begins[-1] - begins[0])
    return bool(early and second_rise < 0.5 * rise and second_rise < max(DISTURBANCE.rises, 2 * scatter / most))


def _smoothed(energy: Array) -> Array:
    """Running medians; at the ends over the nearest segments."""
    half = DISTURBANCE.smoothed // 2
    padded = np.pad(energy, half, mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, DISTURBANCE.smoothed), axis=1))


def _scatter(energy: Array) -> float:
    """Standard deviation of the noise of the energy, from its second differences, which no slow decay has."""
    variance = 1.0 + 4.0 + 1.0  # of a second difference of white noise
    return float(NORMAL_MAD * np.median(np.abs(np.diff(energy, 2))) / np.sqrt(variance))


def _outstanding(recordings: Recordings, ratios: Array) -> list[Disturbed]:
    """Kicks and pushes, detected by segments that fit far worse than all others."""
    short, followed = _followed(recordings, ratios)
    edges, chi2 = short.segments.offsets, followed.linear.chi2_by_segment
    level = np.where(np.isfinite(chi2), chi2, np.inf) / np.diff(edges)
    order = np.argsort(-level)
    most = min(max(1, int(DISTURBANCE.most * len(level))), len(level) - 1)
    worse = [k for k in range(1, most + 1) if level[order[k - 1]] > DISTURBANCE.outstanding * level[order[k]]]
    if not worse:
        return []
    others, disturbed = max(float(level[order[worse[-1]]]), 1.0), []
    for s in sorted(order[: worse[-1]].tolist()):
        if level[s] < DISTURBANCE.visible:
            continue
        kick = _kick(recordings, short, followed, s, others)
        if kick is not None:
            disturbed.append(Disturbed(kick, kick, "the speed jumps as after a kick: no segment contains this instant"))
        elif level[s] > DISTURBANCE.pushed * others:
            first, last = float(short.t[edges[s]]), float(short.t[edges[s + 1] - 1])
            evidence = f"until {last:.2g} s the rods move as if a hand pushed them, not as free rods: excluded"
            disturbed.append(Disturbed(first, float(np.nextafter(last, np.inf)), evidence))
    return disturbed


def _kick(recordings: Recordings, short: Problem, followed: Fit, s: int, others: float) -> float | None:
    """Instant at which a segment must be divided for both parts to fit as well as the others; None if there is none."""
    (recording,) = recordings.records
    first, last = (int(i) for i in short.segments.offsets[s : s + 2])
    begin, end = np.searchsorted(recording.t, [short.t[first], short.t[last - 1]]).tolist()
    near = recording.only(slice(max(begin - MIN_SAMPLES, 0), end + 1 + MIN_SAMPLES))
    best, best_instant = np.inf, 0.0
    for i in range(MIN_SAMPLES, len(near.t) - MIN_SAMPLES + 1):
        instant = 0.5 * float(near.t[i - 1] + near.t[i])
        halves, initial = recordings.only([replace(near, breaks=np.array([instant]))]).cut(np.inf)
        cut = descend(halves, followed.estimate.changed(initial=initial), (), iterations=DISTURBANCE.iterations)
        chi2 = float(halves.chi2_by_segment(halves.predict(cut.estimate)).sum())
        if chi2 < best:
            best, best_instant = chi2, instant
    enough = float(followed.linear.chi2_by_segment[s]) / DISTURBANCE.cut_off
    return best_instant if best < enough and best < DISTURBANCE.alike * others * len(near.t) else None
