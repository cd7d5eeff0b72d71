"""Vibrations at harmonics of the swing, and recordings of a single decay.

If the model lacks a torque that depends on angle or speed, the residual contains multiples of the swing frequency. This
frequency changes slowly with the amplitude. A vibration of the base at such a multiple can fit this residual of one
release. A good fit at a multiple of the swing frequency is therefore not evidence of a vibration, whose true frequency
is independent of the swing.

Along a single decay, the amplitude is a function of time. A drift of friction then looks like a dissipative torque that
depends on speed.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dpr_lab.effects import EFFECTS, param_index
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.problem import Problem

FREQUENCY = "frequency_hz"
"""Name of the shape parameter for the frequency of a force or of a resonance."""


@dataclass(frozen=True, slots=True)
class LineSettings:
    """Settings for the harmonics of a swing."""

    harmonics: int = 5
    """Highest tested multiple of the frequency of the swing.

    Friction, drag and errors of the readings cause only small components at higher multiples.
    """
    resolution: float = 0.5
    """Half width of a spectral line, multiplied by the duration of the recording."""
    equal: float = 0.1
    """Maximum relative difference of the amplitudes of two releases that count as equal."""
    swings: int = 2
    """Minimum number of half swings for the estimate of a frequency."""


LINES = LineSettings()


def on_swing_line(problem: Problem, effect: str, estimate: Estimate) -> bool:
    """Return whether an effect is a vibration at a harmonic of the swing frequency.

    Args:
        problem: segments of the recordings; the result is False unless they are free swings of a single rod
        effect: name of the effect
        estimate: estimate with the frequency of the effect
    """
    spec = EFFECTS[effect]
    if not any(p.name == FREQUENCY for p in spec.shapes) or len(spec.shapes) > 1:
        return False
    if not all(setup.alone and setup.free for setup in problem.segments.setups):
        return False
    frequency = float(estimate.params[param_index(effect, FREQUENCY)])
    lines = [line for run in np.unique(problem.segments.run) if (line := _line(problem, int(run)))]
    if not lines:
        return False
    lowest, highest, durations = zip(*lines, strict=True)
    low, high, width = min(lowest), max(highest), LINES.resolution / max(durations)
    return any(n * low - width <= frequency <= n * high + width for n in range(1, LINES.harmonics + 1))


def _line(problem: Problem, run: int) -> tuple[float, float, float] | None:
    """Return the lowest and highest swing frequency of one run, Hz, and its duration, s.

    The result is None if the rod crosses its hanging position too rarely.
    """
    offsets = problem.segments.offsets
    segments = [
        slice(a, b) for (a, b), r in zip(pairwise(offsets.tolist()), problem.segments.run, strict=True) if r == run
    ]
    t = np.concatenate([problem.t[samples] for samples in segments])
    from_hanging = np.concatenate([problem.measured[samples, 0] for samples in segments]) - np.pi
    before_crossing = np.flatnonzero(from_hanging[:-1] * from_hanging[1:] < 0)
    crossings = t[before_crossing] - from_hanging[before_crossing] * (t[before_crossing + 1] - t[before_crossing]) / (
        from_hanging[before_crossing + 1] - from_hanging[before_crossing]
    )
    if len(crossings) <= LINES.swings:
        return None
    intervals = crossings[2:] - crossings[:-2]  # whole periods, which a zero error does not change
    usual = float(np.median(intervals))
    periods = intervals[np.abs(intervals - usual) < 0.5 * usual]  # intervals that contain no gap
    return float(1 / periods.max()), float(1 / periods.min()), float(t[-1] - t[0])


def one_decay(problem: Problem) -> bool:
    """Return whether the amplitude of the swings is a function of time alone.

    Influences of amplitude and time are then inseparable. This holds for a single undriven swing (one release or its
    pieces), and for releases of one rod from equal angles.
    """
    segments = problem.segments
    if not all(setup.free for setup in segments.setups):
        return False
    first, last = segments.t[segments.offsets[:-1]], segments.t[segments.offsets[1:] - 1]
    order = np.argsort(first)
    return bool((last[order][:-1] <= first[order][1:]).all()) or _equal_releases(problem)


def _equal_releases(problem: Problem) -> bool:
    """Return whether one rod swings from about the same angle in all runs."""
    segments = problem.segments
    if not all(setup.alone for setup in segments.setups):
        return False
    from_hanging = np.abs(problem.measured[:, 0] - np.pi)
    of_segment = np.maximum.reduceat(from_hanging, segments.offsets[:-1])
    widest = [of_segment[segments.run == run].max() for run in np.unique(segments.run)]
    return min(widest) > (1 - LINES.equal) * max(widest)
