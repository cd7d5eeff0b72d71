"""Predicted readings of tracks: lanes of candidates and segments with their encoders."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.lanes.driving import Drive, prescribe_arm, set_arm_torque, set_torques
from dpr_lab.dynamics.lanes.effects import displaced
from dpr_lab.dynamics.lanes.samples import (
    LaneSamples,
    angle0,
    angle2,
    read_both,
    read_joint1,
    read_joint2,
    read_play,
    shares,
)
from dpr_lab.dynamics.lanes.tracks import Tracks, required_in
from dpr_lab.dynamics.lanes.workspace import LANES, WORKSPACE, At, constants_at
from dpr_lab.effects.effect_kernels import (
    ARM,
    AT_RELEASE,
    LAG,
    STEPPED,
    arm_delay,
    arm_encoder_error,
    arm_model,
    encoder_errors,
    free_arm_model,
    input_delay,
    internal_sliding,
    reading_shifts,
)
from dpr_lab.effects.quantities import HELD_ARM, RigConstants
from dpr_lab.effects.stages import Requirements
from dpr_lab.kernels import njit, subroutine

PAD = 0.02
"""Time by which a segment starts before its first sample, s: longer than any relevant latency."""


class SegmentArrays(NamedTuple):
    """Segments and mounting, as arrays for compiled code."""

    t: NDArray[np.float64]
    """(N,) sampling instants of all segments in sequence, s."""
    offsets: NDArray[np.int64]
    """(S + 1,) first sample of each segment."""
    run: NDArray[np.int64]
    """(S,) index of the run."""
    step: NDArray[np.float64]
    """(S,) Runge-Kutta step, s."""
    parts: NDArray[np.float64]
    """(runs, 5) L1, L2, m1, m2, mb of the mounted parts."""
    drive: Drive
    """Known torques and arm motions."""


class Buffers(NamedTuple):
    """Work arrays of the kernel."""

    w: NDArray[np.float64]
    """The workspace of the lanes."""
    after: NDArray[np.float64]
    """(LANES, internal) internal states at the end of the previous segment."""
    run: NDArray[np.int64]
    """(LANES,) current segment."""
    knot: NDArray[np.int64]
    """(2, LANES) intervals in which the known torques of the rods' joints and of the arm were looked up last."""
    samples: LaneSamples


def allocate(segments: SegmentArrays, angles: NDArray[np.float64]) -> Buffers:
    """Buffers for segments with predictions (n, N, columns)."""
    longest, indices = int(np.diff(segments.offsets).max()), partial(np.zeros, LANES, dtype=np.int64)
    samples = LaneSamples(
        t1=np.zeros((LANES, longest)),
        t2=np.zeros((LANES, longest)),
        out=angles.reshape(-1),
        columns=angles.shape[2],
        first=indices(),
        next1=indices(),
        next2=indices(),
        size=indices(),
    )
    knots = np.zeros((2, LANES), dtype=np.int64)
    return Buffers(np.zeros(WORKSPACE), np.zeros((LANES, len(AT_RELEASE))), indices(), knots, samples)


class Candidates(NamedTuple):
    """Candidates for prediction."""

    bases: NDArray[np.float64]
    """(n, runs, 6) base parameters of the mounted parts."""
    params: NDArray[np.float64]
    """(n, runs or 1, SIZE) effects."""
    initial: NDArray[np.float64]
    """(n, S, 6) theta1, theta2, omega1, omega2, theta0, omega0; the last two are nan if they are internal states."""
    internal: NDArray[np.float64]
    """(n, S, internal) internal states; nan if they are taken from the previous segment."""


class LaneBlock(NamedTuple):
    """Common data of the lanes of a block."""

    segments: SegmentArrays
    candidates: Candidates
    rig: RigConstants
    active: NDArray[np.bool_]
    """(effects,) mask of the active effects."""
    required: Requirements


@njit(allocates=False)
def predict_tracks(
    blocks: tuple[int, int],
    advance: Any,
    tracks: Tracks,
    segments: SegmentArrays,
    candidates: Candidates,
    rig: RigConstants,
    angles: NDArray[np.float64],
    initial_internal: NDArray[np.float64],
    buffers: Buffers,
) -> None:
    """Compute (n, N, 2 or 3) predicted readings, rad, and (n, S, internal) internal states at starts of segments.

    Args:
        blocks: first block of tracks, and index after the last
        advance: step function of `dpr_lab.dynamics.lanes.stepping`
        tracks: the tracks
        segments: the segments
        candidates: the candidates
        rig: constants of the rig
        angles: output
        initial_internal: output
        buffers: from `allocate`
    """
    w, after, run, _, samples = buffers
    for b in range(blocks[0], blocks[1]):
        first, last = tracks.edges[b], tracks.edges[b + 1]
        block = LaneBlock(segments, candidates, rig, tracks.active[b], required_in(tracks.required, b))
        rounds = 0
        for k in range(LANES):
            track = min(first + k, last - 1)
            rounds = max(rounds, tracks.last[track] - tracks.first[track])
            run[k], buffers.knot[0, k], buffers.knot[1, k] = segments.run[tracks.first[track]], 0, 0
            _load(w, k, int(tracks.candidate[track]), int(run[k]), block)
        for turn in range(rounds):
            for k in range(LANES):
                samples.size[k], w[At.due1 + k], w[At.due2 + k] = 0, np.inf, np.inf
                if first + k < last and tracks.first[first + k] + turn < tracks.last[first + k]:
                    c, s = int(tracks.candidate[first + k]), int(tracks.first[first + k]) + turn
                    if turn == 0:
                        _reset_internal(segments, s, candidates.initial[c, s], after[k])
                    _begin(w, k, c, s, block, samples, after[k], initial_internal[c, s])
            _read(block, advance, buffers)
            if block.required.encoder or block.required.encoder0:
                for k in range(last - first):
                    c, s = int(tracks.candidate[first + k]), int(tracks.first[first + k]) + turn
                    if s < tracks.last[first + k]:
                        _add_errors(c, s, block, angles)


@subroutine
def _load(w: NDArray[np.float64], k: int, c: int, r: int, block: LaneBlock) -> None:
    """Set the data of lane k that are constant along its track: candidate c in run r."""
    parts, base, rig = block.segments.parts, block.candidates.bases, block.rig
    w[At.L1 + k], w[At.L2 + k] = parts[r, 0], parts[r, 1]
    w[At.m1 + k], w[At.m2 + k], w[At.mb + k] = parts[r, 2], parts[r, 3], parts[r, 4]
    w[At.a + k], w[At.b + k], w[At.d + k] = base[c, r, 0], base[c, r, 1], base[c, r, 2]
    w[At.e1 + k], w[At.c1 + k], w[At.c2 + k] = base[c, r, 3], base[c, r, 4], base[c, r, 5]
    w[At.e2 + k] = w[At.d + k] * rig.g / rig.L1
    w[At.step + k], w[At.drive1 + k], w[At.drive2 + k] = block.segments.step[0], 0.0, 0.0
    w[At.direction0 + k], w[At.direction1 + k], w[At.direction2 + k] = np.nan, np.nan, np.nan
    w[At.drive0 + k], w[At.torque0 + k], w[At.displacement0 + k] = 0.0, 0.0, 0.0
    w[At.prescribed + k], w[At.squared + k] = 0.0, 0.0
    params = block.candidates.params[c, _params_row(r, block)]
    for i in range(len(params)):
        w[At.params + i * LANES + k] = params[i]
    arm = arm_model(constants_at(w, k, rig), HELD_ARM, params, block.active)
    arm = free_arm_model(constants_at(w, k, rig), arm, params, block.active)
    w[At.late + k] = input_delay(0.0, params, block.active)
    w[At.late0 + k] = arm_delay(0.0, params, block.active)
    w[At.inertia + k], w[At.friction + k], w[At.stiffness + k] = arm.inertia, arm.friction, arm.stiffness


@subroutine
def _params_row(r: int, block: LaneBlock) -> int:
    """Index of the effects of run r among those of a candidate; kernels without allocation cannot return an array."""
    return r if block.candidates.params.shape[1] > 1 else 0


@njit
def segment_start(first: float, near: float = 0.04) -> float:
    """Start of a segment whose first reading is `first` seconds after the release, s.

    If it would be less than `near` after the release, the segment starts at the release, where all internal states are
    known.
    """
    start = first - PAD
    return 0.0 if 0.0 < start and start < near else start


@subroutine
def _begin(
    w: NDArray[np.float64],
    k: int,
    c: int,
    s: int,
    block: LaneBlock,
    samples: LaneSamples,
    internal: NDArray[np.float64],
    initial_internal: NDArray[np.float64],
) -> None:
    """Set lane k to the start of segment s of candidate c; it stays idle if the sampling instants are not finite.

    Args:
        w: the workspace
        k: the lane
        c: the candidate
        s: the segment
        block: common data of the lanes
        samples: samples of the segment, output
        internal: (internal,) internal states at the end of the previous segment
        initial_internal: (internal,) those at the start of this segment, output
    """
    initial, given = block.candidates.initial[c, s], block.candidates.internal[c, s]
    until = _set_samples(k, c, s, block, samples)
    for n in range(len(initial_internal)):
        initial_internal[n] = internal[n] if np.isnan(given[n]) else given[n]
    last = samples.size[k] - 1
    last1, last2 = samples.t1[k, last], samples.t2[k, last] if block.required.timing else samples.t1[k, last]
    now, t, i = segment_start(samples.t1[k, 0]), block.segments.t, block.segments.offsets[s]
    longest = now + 2.0 * (t[i + last] - t[i]) + 1.0
    if not (last1 < longest and last2 < longest):  # or not a number: an impossible clock
        for n in range(samples.size[k] * samples.columns):
            samples.out[samples.first[k] + n] = np.nan
        for n in range(len(internal)):
            internal[n] = np.nan
        return
    w[At.due1 + k] = samples.t1[k, 0]
    if block.required.timing or block.required.play:
        w[At.due2 + k] = samples.t2[k, 0]
    w[At.handed + k] = min(segment_start(until), last1)
    w[At.t + k], w[At.h + k], w[At.step + k] = now, block.segments.step[s], block.segments.step[s]
    _set_state(w, k, initial, initial_internal, block.rig.relative2)


@subroutine
def _set_samples(k: int, c: int, s: int, block: LaneBlock, samples: LaneSamples) -> float:
    """Set the instants at which lane k reads segment s; return the first sampling instant of the next segment, s."""
    t, required = block.segments.t, block.required
    i, j = block.segments.offsets[s], block.segments.offsets[s + 1]
    count, until = j - i, t[min(j, len(t) - 1)]
    samples.first[k] = (c * len(t) + i) * samples.columns
    samples.next1[k], samples.next2[k], samples.size[k] = 0, 0, count
    for n in range(count):
        samples.t1[k, n] = t[i + n]
    for n in range(count if required.timing or required.play else 0):
        samples.t2[k, n] = t[i + n]
    if required.timing:
        params = block.candidates.params[c, _params_row(int(block.segments.run[s]), block)]
        for n in range(count):
            shift1, shift2 = reading_shifts(t[i + n], params, block.active)
            samples.t1[k, n] += shift1
            samples.t2[k, n] += shift2
        until += reading_shifts(until, params, block.active)[0]
    return float(until)


@subroutine
def _set_state(
    w: NDArray[np.float64], k: int, initial: NDArray[np.float64], internal: NDArray[np.float64], relative2: float
) -> None:
    """Set angles, speeds and internal states of lane k at the instant `t`, with no step or event pending."""
    w[At.until + k], w[At.ahead + k], w[At.cut + k] = w[At.t + k], 0.0, 0.0
    w[At.theta1 + k], w[At.theta2 + k], w[At.omega1 + k], w[At.omega2 + k] = (
        initial[0],
        initial[1],
        initial[2],
        initial[3],
    )
    apart = not np.isnan(initial[4])
    w[At.theta0 + k] = initial[4] if apart else internal[ARM]
    w[At.omega0 + k] = initial[5] if apart else internal[ARM + 1]
    w[At.old_theta0 + k], w[At.old_omega0 + k] = w[At.theta0 + k], w[At.omega0 + k]
    for row in (At.stage_omega0, At.stage_omega1, At.stage_omega2, At.alpha0, At.alpha1, At.alpha2):
        w[row + k] = 0.0
    w[At.hold + k] = initial[1] - relative2 * initial[0] + internal[LAG]
    for n, index in enumerate(STEPPED):
        w[At.internal + n * LANES + k] = internal[index]


@subroutine
def _reset_internal(
    segments: SegmentArrays, s: int, initial: NDArray[np.float64], internal: NDArray[np.float64]
) -> None:
    """Set internal states at the start of a run: those of a rig at rest until the release, or after long sliding."""
    for n in range(len(internal)):
        internal[n] = AT_RELEASE[n]
    if segment_start(float(segments.t[segments.offsets[s]])) > 0.0:
        speed0 = 0.0 if np.isnan(initial[5]) else initial[5]
        for n, value in enumerate(internal_sliding(speed0, initial[2], initial[3] - initial[2])):
            internal[STEPPED[n]] = value


@subroutine
def _read(block: LaneBlock, advance: Any, buffers: Buffers) -> None:
    """Step all lanes until each has read its segment."""
    w, after, run, knot, samples = buffers
    required, drive, relative2 = block.required, block.segments.drive, block.rig.relative2
    held = _any_held(w)
    while _any_due(w):
        if len(drive.t) > 0:
            set_torques(w, drive, run, knot[0])
        if len(drive.torque0_t) > 0:
            set_arm_torque(w, drive, run, knot[1])
        if len(drive.arm_t) > 0:
            prescribe_arm(w, drive, run)
        advance(w, block.rig, block.active, required, held)
        if not (required.timing or required.play):
            read_both(w, relative2, required.arm, samples)
        else:
            read_joint1(w, required.arm, samples)
            if required.play:
                read_play(w, relative2, block.active, samples)
            else:
                read_joint2(w, 1.0, relative2, samples)
        if required.internal:
            _hand_over(w, relative2, block.active, required.play, after)
        held = held and _any_held(w)


@subroutine
def _any_held(w: NDArray[np.float64]) -> bool:
    """Whether the next step of any lane starts before the release."""
    count = 0
    for k in range(LANES):
        count += not w[At.t + k] > -0.5 * w[At.step + k]
    return count > 0


@subroutine
def _any_due(w: NDArray[np.float64]) -> bool:
    count = 0
    for k in range(LANES):
        count += (w[At.due1 + k] < np.inf) | (w[At.due2 + k] < np.inf)
    return count > 0


@subroutine
def _hand_over(
    w: NDArray[np.float64], relative2: float, active: NDArray[np.bool_], play: bool, after: NDArray[np.float64]
) -> None:
    """Store the internal states for the next segment if it starts in this step; backlash as at the end of the step."""
    if not shares(w, At.handed, 1.0):
        return
    for k in range(LANES):
        turn1 = w[At.theta1 + k] - w[At.old_theta1 + k]
        turn2 = w[At.theta2 + k] - w[At.old_theta2 + k] - turn1
        w[At.displacement0 + k] = w[At.share + k] * (w[At.theta0 + k] - w[At.old_theta0 + k])
        w[At.displacement1 + k], w[At.displacement2 + k] = w[At.share + k] * turn1, w[At.share + k] * turn2
    displaced(w, active)
    for k in range(LANES):
        u = w[At.share + k]
        if u <= 1.0:
            if u > 0.0:
                for n, index in enumerate(STEPPED):
                    after[k, index] = w[At.moved + n * LANES + k]
                after[k, LAG] = w[At.hold + k] - angle2(w, k, 1.0, relative2) if play else 0.0
                after[k, ARM] = angle0(w, k, u)
                after[k, ARM + 1] = w[At.old_omega0 + k] + u * (w[At.omega0 + k] - w[At.old_omega0 + k])
            w[At.handed + k] = np.inf


@subroutine
def _add_errors(c: int, s: int, block: LaneBlock, angles: NDArray[np.float64]) -> None:
    """Add the errors of the encoders to the predictions of candidate c on segment s."""
    run, t, rig = int(block.segments.run[s]), block.segments.t, block.rig
    params = block.candidates.params[c, _params_row(run, block)]
    for i in range(block.segments.offsets[s], block.segments.offsets[s + 1]):
        angle1, angle2 = angles[c, i, 0], angles[c, i, 1]
        error1, error2 = encoder_errors(angle1, angle2, t[i], run, rig, params, block.active)
        angles[c, i, 0], angles[c, i, 1] = angle1 + error1, angle2 + error2
        if angles.shape[2] > 2:
            angles[c, i, 2] += arm_encoder_error(angles[c, i, 2], t[i], run, rig, params, block.active)
