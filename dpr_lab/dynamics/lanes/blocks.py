"""Data of the lanes as arrays for compiled code: segments, candidates, outputs, and buffers."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.dynamics.lanes.driving import Drive
from dpr_lab.dynamics.lanes.samples import LaneSamples
from dpr_lab.dynamics.lanes.workspace import one_workspace
from dpr_lab.effects.effect_kernels import AT_RELEASE
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.effects.stages import Requirements


class SegmentArrays(NamedTuple):
    """Segments, mounted parts and drives, as arrays for compiled code."""

    t: Array
    """(N,) sampling instants of all segments in sequence, s."""
    offsets: Integers
    """(S + 1,) index of the first sample of each segment, then N."""
    run: Integers
    """(S,) index of the run to which each segment belongs."""
    step: Array
    """(S,) length of the Runge-Kutta steps, s."""
    parts: Array
    """(runs, 5) L1 and L2, m, and m1, m2 and mb, kg, of the mounted parts."""
    drive: Drive
    """Known torques and arm motions."""


class Candidates(NamedTuple):
    """Candidates whose readings are predicted."""

    bases: Array
    """(n, runs, 6) base parameters of the mounted parts."""
    params: Array
    """(n, runs or 1, SIZE) parameters of the effects."""
    initial: Array
    """(n, S, 6) initial state theta1, theta2, omega1, omega2, theta0, omega0, rad and rad/s.

    theta0 and omega0 are nan if they are internal states.
    """
    internal: Array
    """(n, S, internal) initial values of the internal states; nan: those at the end of the previous segment."""


class LaneBlock(NamedTuple):
    """Data that all lanes of a block have in common."""

    segments: SegmentArrays
    candidates: Candidates
    rig: RigConstants
    active: Flags
    """(effects,) mask of the active effects."""
    required: Requirements


class Piece(NamedTuple):
    """Indices of a candidate and of one of its segments."""

    candidate: int
    segment: int


class Buffers(NamedTuple):
    """Outputs and work arrays of the kernel."""

    angles: Array
    """(n, N, 2 or 3) predicted readings, rad: joint 1, joint 2 and optionally the arm."""
    initial_internal: Array
    """(n, S, internal) internal states at the start of each segment."""
    w: Any
    """Workspace of the lanes, a `LaneWorkspace`; `allocate` returns an array that contains one workspace."""
    after: Array
    """(lanes, internal) internal states at the end of the previous segment."""
    run: Integers
    """(lanes,) run of the current segment."""
    knot: Integers
    """(2, lanes) intervals that were last used to interpolate the known torques: of the rod joints, and of the arm."""
    samples: LaneSamples


def allocate(segments: SegmentArrays, candidates: int, columns: int, lanes: int) -> Buffers:
    """Allocate the outputs and buffers of the kernel.

    Args:
        segments: segments of all runs
        candidates: number of candidates
        columns: number of columns of the readings: 2, or 3 with the arm
        lanes: number of lanes
    """
    longest, indices = int(np.diff(segments.offsets).max()), partial(np.zeros, lanes, dtype=np.int64)
    # every reading of joints 1 and 2 is written, that of the arm only if it moves
    angles = (np.empty if columns == 2 else np.zeros)((candidates, len(segments.t), columns))
    samples = LaneSamples(
        t1=np.empty((lanes, longest)),
        t2=np.empty((lanes, longest)),
        out=angles.reshape(-1),
        columns=columns,
        first=indices(),
        next1=indices(),
        next2=indices(),
        size=indices(),
    )
    return Buffers(
        angles,
        initial_internal=np.zeros((candidates, len(segments.run), len(AT_RELEASE))),
        w=one_workspace(lanes),
        after=np.zeros((lanes, len(AT_RELEASE))),
        run=indices(),
        knot=np.zeros((2, lanes), dtype=np.int64),
        samples=samples,
    )
