"""Divide samples into segments with free initial states, to limit the effect of chaos.

After a release from near upright an initial error grows by a factor of 2e4 within 5 s. Over a segment of 0.25 to 2 s
the growth is small, and the initial state is estimated together with the parameters (multiple shooting).
"""

from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.segments import Segments
from dpr_lab.errors import RunError
from dpr_lab.run import Run

MIN_SAMPLES = 8
"""Minimum number of samples of a segment: twice the number of initial values.

A segment with fewer samples contains no information about a model.
"""


def cut(t: Array, length: float, breaks: Array | None = None) -> list[slice]:
    """Cut samples into segments of about equal length that do not span breaks.

    Too short segments are omitted. If samples are sparse, segments are longer than requested.

    Args:
        t: (n,) increasing times of one run, s
        length: nominal length of a segment, s
        breaks: times that no segment may span, s
    """
    edges = [0, *([] if breaks is None else np.searchsorted(t, breaks).tolist()), len(t)]
    parts: list[slice] = []
    for first, last in pairwise(edges):
        if last - first < MIN_SAMPLES:
            continue
        count = max(1, min(round(float(t[last - 1] - t[first]) / length), (last - first) // MIN_SAMPLES))
        inner = first + np.searchsorted(t[first:last], np.linspace(t[first], t[last - 1], count + 1)[1:-1])
        parts += [slice(i, j) for i, j in pairwise([first, *inner.tolist(), last]) if j - i >= MIN_SAMPLES]
    return parts


def partition(run: Run, length: float) -> list[slice]:
    """Cut a run from the release on into segments of about equal duration.

    Segments may contain interruptions.

    Args:
        run: the run from the release on
        length: nominal length of a segment, s

    Raises:
        RunError: the run has fewer than `MIN_SAMPLES` samples.
    """
    if len(run.t) < MIN_SAMPLES:
        raise RunError(f"{run.name}: {len(run.t)} samples after the release; at least {MIN_SAMPLES} are needed")
    count = max(1, round(run.duration / length))
    edges = [0]
    for edge in np.searchsorted(run.t, np.linspace(run.t[0], run.t[-1], count + 1)[1:-1]).tolist():
        if edge - edges[-1] >= MIN_SAMPLES and len(run.t) - edge >= MIN_SAMPLES:
            edges.append(edge)
    return [slice(i, j) for i, j in pairwise([*edges, len(run.t)])]


def carried(source: Segments, states: Array, other: Segments, otherwise: Array) -> Array:
    """Transfer initial states to a different division of the runs into segments.

    A segment gets the state of the segment with the same first sample.

    Args:
        source: first division of the samples
        states: (segments, 4) initial states of the first division
        other: other division of the same samples
        otherwise: (segments, 4) initial states for the segments of `other` that start at other samples

    Returns:
        (segments, 4) initial states for the other division
    """
    begins = {key: state for key, state in zip(_begins(source), states, strict=True)}
    return np.array([begins.get(key, start) for key, start in zip(_begins(other), otherwise, strict=True)])


def _begins(segments: Segments) -> list[tuple[int, float]]:
    return list(zip(segments.run.tolist(), segments.t[segments.offsets[:-1]].tolist(), strict=True))
