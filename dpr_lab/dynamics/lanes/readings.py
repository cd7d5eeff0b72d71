"""Predict the encoder readings of tracks (candidates on segments), integrated in lanes."""

from typing import Any

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.dynamics.encoder_errors import add_errors
from dpr_lab.dynamics.lanes.blocks import Buffers, Candidates, LaneBlock, Piece, SegmentArrays
from dpr_lab.dynamics.lanes.driving import prescribe_arm, set_torques
from dpr_lab.dynamics.lanes.effects import displaced
from dpr_lab.dynamics.lanes.interpolation import angle0, angle1, angle2, speed0
from dpr_lab.dynamics.lanes.samples import (
    read_both,
    read_joint1,
    read_joint2,
    read_play1,
    read_play2,
    shares,
)
from dpr_lab.dynamics.lanes.starts import begin_segment, load_track, params_row, reads_apart, reset_internal
from dpr_lab.dynamics.lanes.tracks import Tracks, required_in
from dpr_lab.dynamics.lanes.workspace import LaneWorkspace
from dpr_lab.effects.effect_kernels import ARM, LAG0, LAG1, LAG2, STEPPED
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.effects.stages import Requirements
from dpr_lab.kernels import njit, subroutine


@njit(allocates=False)
def predict_tracks(
    advance: Any,
    tracks: Tracks,
    segments: SegmentArrays,
    candidates: Candidates,
    rig: RigConstants,
    buffers: Buffers,
) -> None:
    """Write the readings of tracks, and the internal states at their segment starts, to `buffers`.

    Args:
        advance: step function of `dpr_lab.dynamics.lanes.stepping`
        tracks: tracks to integrate
        segments: segments of all runs
        candidates: candidates to predict
        rig: constants of the rig
        buffers: outputs and work arrays from `allocate`
    """
    work = Buffers(
        buffers.angles, buffers.initial_internal, buffers.w[0],
        buffers.after, buffers.run, buffers.knot, buffers.samples,
    )  # fmt: skip
    for b in range(len(tracks.active)):
        first, last = tracks.edges[b], tracks.edges[b + 1]
        block = LaneBlock(segments, candidates, rig, tracks.active[b], required_in(tracks.required, b))
        rounds = _load_block(first, last, tracks, block, work)
        for turn in range(rounds):
            _begin_round(first, last, turn, tracks, block, work)
            _read(block, advance, work)
            if block.required.encoder or block.required.encoder0:
                for track in range(first, last):
                    if tracks.first[track] + turn < tracks.last[track]:
                        _add_errors(_piece(tracks, track, turn), block, buffers.angles)


@subroutine
def _piece(tracks: Tracks, track: int, turn: int) -> Piece:
    """Return the candidate of a track, and the index of its segment number `turn`."""
    return Piece(int(tracks.candidate[track]), int(tracks.first[track]) + turn)


@subroutine
def _load_block(first: int, last: int, tracks: Tracks, block: LaneBlock, buffers: Buffers) -> int:
    """Load a block of tracks into the lanes; return the largest number of segments of a track.

    Spare lanes are loaded with the last track.
    """
    rounds = 0
    for k in range(len(buffers.w.t)):
        track = min(first + k, last - 1)
        rounds = max(rounds, tracks.last[track] - tracks.first[track])
        run = block.segments.run[tracks.first[track]]
        buffers.run[k], buffers.knot[0, k], buffers.knot[1, k] = run, 0, 0
        load_track(buffers.w, k, int(tracks.candidate[track]), int(run), block)
    return rounds


@subroutine
def _begin_round(first: int, last: int, turn: int, tracks: Tracks, block: LaneBlock, buffers: Buffers) -> None:
    """Start segment number `turn` of each track; a lane without such a segment is idle."""
    w = buffers.w
    for k in range(len(w.t)):
        buffers.samples.size[k], w.due1[k], w.due2[k] = 0, np.inf, np.inf
        if first + k < last and tracks.first[first + k] + turn < tracks.last[first + k]:
            piece = _piece(tracks, first + k, turn)
            if turn == 0:
                initial = block.candidates.initial[piece.candidate, piece.segment]
                reset_internal(block.segments, piece.segment, initial, buffers.after[k])
            begin_segment(k, piece, block, buffers)


@subroutine
def _read(block: LaneBlock, advance: Any, buffers: Buffers) -> None:
    """Step all lanes until each lane has read all samples of its segment."""
    w, samples = buffers.w, buffers.samples
    required, drive, relative2 = block.required, block.segments.drive, block.rig.relative2
    held = _any_held(w)
    while _any_due(w):
        if len(drive.rods.t) > 0 or len(drive.arm.t) > 0:
            set_torques(w, drive, buffers.run, buffers.knot)
        if len(drive.prescribed.t) > 0:
            prescribe_arm(w, drive, buffers.run)
        advance(w, block.rig, block.active, required, held)
        if not reads_apart(required):
            read_both(w, relative2, required.arm, samples)
        else:
            if required.play1 or required.play0:
                # only play1, the backlash of the encoder, needs the turning points of the joint: 4 parts of the step
                read_play1(w, required.arm, required.play0, 4 if required.play1 else 1, block.active, samples)
            else:
                read_joint1(w, required.arm, samples)
            if required.play:
                read_play2(w, relative2, block.active, samples)
            else:
                read_joint2(w, 1.0, relative2, samples)
        if required.internal:
            _hand_over(w, relative2, block.active, required, buffers.after)
        held = held and _any_held(w)


@subroutine
def _any_held(w: LaneWorkspace) -> bool:
    """Return whether the next step of any lane starts before the release."""
    count = 0
    for k in range(len(w.t)):
        count += not w.t[k] > -0.5 * w.step[k]
    return count > 0


@subroutine
def _any_due(w: LaneWorkspace) -> bool:
    count = 0
    for k in range(len(w.t)):
        count += (w.due1[k] < np.inf) | (w.due2[k] < np.inf)
    return count > 0


@subroutine
def _hand_over(
    w: LaneWorkspace,
    relative2: float,
    active: Flags,
    required: Requirements,
    after: Array,
) -> None:
    """Store the internal states for the next segment, if that segment starts in this step.

    The states of the backlash of joints 1 and 2 are those at the end of the step.
    """
    if not shares(w, w.handed, 1.0):
        return
    for k in range(len(w.t)):
        turn1 = w.theta1[k] - w.old_theta1[k]
        turn2 = w.theta2[k] - w.old_theta2[k] - turn1
        w.displacement0[k] = w.share[k] * (w.theta0[k] - w.old_theta0[k])
        w.displacement1[k], w.displacement2[k] = w.share[k] * turn1, w.share[k] * turn2
    displaced(w, active)
    for k in range(len(w.t)):
        u = w.share[k]
        if u <= 1.0:
            if u > 0.0:
                for n, index in enumerate(STEPPED):
                    after[k, index] = w.moved[n, k]
                if required.play0:
                    after[k, LAG0] = (1.0 - u) * (w.old_hold0[k] - w.old_theta0[k]) + u * (w.hold0[k] - w.theta0[k])
                    speed = (1.0 - u) * w.old_motor_speed0[k] + u * w.motor_speed0[k]
                    after[k, LAG0 + 1] = speed - speed0(w, k, u)
                after[k, LAG1] = w.hold1[k] - angle1(w, k, 1.0) if required.play1 else 0.0
                after[k, LAG2] = w.hold2[k] - angle2(w, k, 1.0, relative2) if required.play else 0.0
                after[k, ARM] = angle0(w, k, u)
                after[k, ARM + 1] = speed0(w, k, u)
            w.handed[k] = np.inf


@subroutine
def _add_errors(piece: Piece, block: LaneBlock, angles: Array) -> None:
    """Add the encoder errors to the predicted readings of a candidate on a segment."""
    c, s = piece
    run, segments = int(block.segments.run[s]), block.segments
    params = block.candidates.params[c, params_row(run, block)]
    first, stop = segments.offsets[s], segments.offsets[s + 1]
    add_errors(angles[c], segments.t, first, stop, run, block.rig, params, block.active)
