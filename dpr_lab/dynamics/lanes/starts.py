"""Tracks and segments in the lanes: constants, sampling times, initial and internal states."""

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.dynamics.lanes.blocks import Buffers, LaneBlock, Piece, SegmentArrays
from dpr_lab.dynamics.lanes.samples import LaneSamples
from dpr_lab.dynamics.lanes.workspace import LaneWorkspace, constants_at
from dpr_lab.effects.effect_kernels import (
    ARM,
    AT_RELEASE,
    LAG0,
    LAG1,
    LAG2,
    STEPPED,
    arm_delay,
    arm_model,
    free_arm_model,
    geared_motor0,
    input_delay,
    internal_sliding,
    reading_shifts,
)
from dpr_lab.effects.quantities import HELD_ARM
from dpr_lab.effects.stages import Requirements
from dpr_lab.kernels import njit, subroutine

PAD = 0.02
"""Time between the start of a segment and its first sample, s: longer than any relevant latency."""


@subroutine
def load_track(w: LaneWorkspace, k: int, c: int, r: int, block: LaneBlock) -> None:
    """Set the constants of lane k for candidate c in run r."""
    parts, base, rig = block.segments.parts, block.candidates.bases, block.rig
    w.L1[k], w.L2[k] = parts[r, 0], parts[r, 1]
    w.m1[k], w.m2[k], w.mb[k] = parts[r, 2], parts[r, 3], parts[r, 4]
    w.a[k], w.b[k], w.d[k] = base[c, r, 0], base[c, r, 1], base[c, r, 2]
    w.e1[k], w.c1[k], w.c2[k] = base[c, r, 3], base[c, r, 4], base[c, r, 5]
    w.e2[k] = w.d[k] * rig.g / rig.L1
    w.step[k], w.drive1[k], w.drive2[k] = block.segments.step[0], 0.0, 0.0
    w.direction0[k], w.direction1[k], w.direction2[k] = np.nan, np.nan, np.nan
    w.drive0[k], w.torque0[k], w.displacement0[k] = 0.0, 0.0, 0.0
    w.prescribed[k], w.squared[k], w.known_until[k] = 0.0, 0.0, np.nan
    params = block.candidates.params[c, params_row(r, block)]
    for i in range(len(params)):
        w.params[i, k] = params[i]
    arm = arm_model(constants_at(w, k, rig), HELD_ARM, params, block.active)
    arm = free_arm_model(constants_at(w, k, rig), arm, params, block.active)
    w.late[k] = input_delay(0.0, params, block.active)
    w.late0[k] = arm_delay(0.0, params, block.active)
    w.inertia[k], w.friction[k], w.stiffness[k] = arm.inertia, arm.friction, arm.stiffness
    w.geared_inertia[k], w.geared_friction[k] = arm.inertia, arm.friction


@subroutine
def reads_apart(required: Requirements) -> bool:
    """Return whether the encoders of joints 1 and 2 are read separately, because of backlash or different times."""
    return required.timing or required.play or required.play1 or required.play0


@subroutine
def params_row(r: int, block: LaneBlock) -> int:
    """Return the index of the row with the effects of run r within a candidate.

    Kernels without allocation cannot return the row itself.
    """
    return r if block.candidates.params.shape[1] > 1 else 0


@njit
def segment_start(first: float, near: float = 0.04) -> float:
    """Return the start of a segment whose first reading is at `first`, s since the release.

    A start less than `near` seconds after the release is moved to the release, where all internal states are known.
    """
    start = first - PAD
    return 0.0 if 0.0 < start and start < near else start


@subroutine
def begin_segment(k: int, piece: Piece, block: LaneBlock, buffers: Buffers) -> None:
    """Set lane k to the start of a segment.

    The lane stays idle if a sampling time is not finite. The initial internal states are those of the candidate, or
    those at the end of the previous segment where the candidate has nan.
    """
    w, samples, (c, s) = buffers.w, buffers.samples, piece
    until = _set_samples(k, piece, block, samples)
    given, previous, internal = block.candidates.internal[c, s], buffers.after[k], buffers.initial_internal[c, s]
    for n in range(len(internal)):
        internal[n] = previous[n] if np.isnan(given[n]) else given[n]
    last = samples.size[k] - 1
    last1, last2 = samples.t1[k, last], samples.t2[k, last] if block.required.timing else samples.t1[k, last]
    start, t, i = segment_start(samples.t1[k, 0]), block.segments.t, block.segments.offsets[s]
    longest = start + 2.0 * (t[i + last] - t[i]) + 1.0
    if not (last1 < longest and last2 < longest):  # the negation also detects NaN
        _leave_idle(k, samples, previous)
        return
    w.due1[k] = samples.t1[k, 0]
    if reads_apart(block.required):
        w.due2[k] = samples.t2[k, 0]
    w.handed[k] = min(segment_start(until), last1)
    w.t[k], w.h[k], w.step[k] = start, block.segments.step[s], block.segments.step[s]
    _set_state(w, k, block.candidates.initial[c, s], internal, block.rig.relative2)
    if block.required.play0:
        _set_motor(w, k, block.candidates.params[c, params_row(int(block.segments.run[s]), block)], block.active)


@subroutine
def _leave_idle(k: int, samples: LaneSamples, after: Array) -> None:
    """Set the readings and internal states of lane k to NaN, because its segment cannot be integrated."""
    for n in range(samples.size[k] * samples.columns):
        samples.out[samples.first[k] + n] = np.nan
    for n in range(len(after)):
        after[n] = np.nan


@subroutine
def _set_samples(k: int, piece: Piece, block: LaneBlock, samples: LaneSamples) -> float:
    """Set the sampling times of lane k.

    Returns:
        the first sampling time of the next segment, s; the last one of this segment if there is no next one
    """
    t, required, (c, s) = block.segments.t, block.required, piece
    i, j = block.segments.offsets[s], block.segments.offsets[s + 1]
    count, until = j - i, t[min(j, len(t) - 1)]
    samples.first[k] = (c * len(t) + i) * samples.columns
    samples.next1[k], samples.next2[k], samples.size[k] = 0, 0, count
    for n in range(count):
        samples.t1[k, n] = t[i + n]
    for n in range(count if reads_apart(required) else 0):
        samples.t2[k, n] = t[i + n]
    if required.timing:
        params = block.candidates.params[c, params_row(int(block.segments.run[s]), block)]
        for n in range(count):
            shift1, shift2 = reading_shifts(t[i + n], params, block.active)
            samples.t1[k, n] += shift1
            samples.t2[k, n] += shift2
        until += reading_shifts(until, params, block.active)[0]
    return float(until)


@subroutine
def _set_state(w: LaneWorkspace, k: int, initial: Array, internal: Array, relative2: float) -> None:
    """Set lane k to the initial state of its segment, with no event pending."""
    w.until[k], w.ahead[k], w.cut[k] = w.t[k], 0.0, 0.0
    w.theta1[k], w.theta2[k], w.omega1[k], w.omega2[k] = (
        initial[0],
        initial[1],
        initial[2],
        initial[3],
    )
    own_arm = not np.isnan(initial[4])
    w.theta0[k] = initial[4] if own_arm else internal[ARM]
    w.omega0[k] = initial[5] if own_arm else internal[ARM + 1]
    w.old_theta0[k], w.old_omega0[k] = w.theta0[k], w.omega0[k]
    for row in (w.stage_omega0, w.stage_omega1, w.stage_omega2, w.alpha0, w.alpha1, w.alpha2):
        row[k] = 0.0
    w.hold0[k], w.hold1[k] = w.theta0[k] + internal[LAG0], initial[0] + internal[LAG1]
    w.hold2[k] = initial[1] - relative2 * initial[0] + internal[LAG2]
    w.motor_speed0[k] = w.omega0[k] + internal[LAG0 + 1]
    w.owed0[k], w.behind0[k], w.bonded0[k] = 0.0, 0.0, 0.0
    for n, index in enumerate(STEPPED):
        w.internal[n, k] = internal[index]


@subroutine
def _set_motor(w: LaneWorkspace, k: int, params: Array, active: Flags) -> None:
    """Set the initial state of the motor of lane k within the backlash of the gear."""
    arm, motor = (w.theta0[k], w.omega0[k]), (w.hold0[k], w.motor_speed0[k])
    w.hold0[k], w.motor_speed0[k], w.motor_inertia0[k], w.loose0[k] = geared_motor0(
        *arm, *motor, 0.0, 0.0, w.geared_inertia[k], w.geared_friction[k], params, active
    )


@subroutine
def reset_internal(segments: SegmentArrays, s: int, initial: Array, internal: Array) -> None:
    """Set the internal states at the start of a run.

    If the run starts with the release, they are the states of a rig at rest. If it starts later, they are the states
    after long sliding.
    """
    for n in range(len(internal)):
        internal[n] = AT_RELEASE[n]
    if segment_start(float(segments.t[segments.offsets[s]])) > 0.0:
        speed0 = 0.0 if np.isnan(initial[5]) else initial[5]
        for n, value in enumerate(internal_sliding(speed0, initial[2], initial[3] - initial[2])):
            internal[STEPPED[n]] = value
