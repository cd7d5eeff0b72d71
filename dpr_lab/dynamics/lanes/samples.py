"""Encoder readings of all lanes within a step."""

from typing import NamedTuple

import numpy as np

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.dynamics.lanes.effects import hold_angle1, hold_angle2
from dpr_lab.dynamics.lanes.geared_motor import balance_gear, follow
from dpr_lab.dynamics.lanes.interpolation import angle0, angle1, angle2
from dpr_lab.dynamics.lanes.workspace import LaneWorkspace, Row, waits
from dpr_lab.kernels import subroutine


class LaneSamples(NamedTuple):
    """Samples of the current segment of each lane."""

    t1: Array
    """(lanes, longest) instants at which the angle of joint 1 is read, s."""
    t2: Array
    out: Array
    """(n * N * columns,) predicted readings of all candidates in sequence, rad.

    The columns are joint 1, joint 2 and optionally the arm.
    """
    columns: int
    first: Integers
    """(lanes,) index of the segment's first reading in `out`."""
    next1: Integers
    """(lanes,) index of the next sample of joint 1."""
    next2: Integers
    size: Integers
    """(lanes,) number of samples of the segment; 0 for an idle lane."""


@subroutine
def _read_arm(w: LaneWorkspace) -> None:
    """Fill the row `angle0` with theta0 at the fraction `share` of the step.

    A delayed reading of the arm has the value of theta0 at an earlier instant.
    """
    for k in range(len(w.t)):
        w.angle0[k] = angle0(w, k, w.share[k] - w.late0[k] / w.h[k])


@subroutine
def shares(w: LaneWorkspace, due: Row, until: float) -> bool:
    """Fill the row `share` with the instant of the next reading, as a fraction of the step.

    Returns:
        whether any lane has a reading up to the fraction `until`
    """
    count = 0
    for k in range(len(w.t)):
        share = (due[k] - w.old_t[k]) / w.h[k]
        w.share[k] = share
        count += share <= until
    return count > 0


@subroutine
def _after_reading(due: Row, k: int, t: Array, j: int, count: int) -> int:
    """Set the time of the next reading of lane k after sample j, or inf after the last; return j + 1."""
    due[k] = t[k, j + 1] if j + 1 < count else np.inf
    return j + 1


@subroutine
def read_both(w: LaneWorkspace, relative2: float, arm: bool, samples: LaneSamples) -> None:
    """Read joints 1 and 2 at the same times, for each sample in the step."""
    while shares(w, w.due1, 1.0):
        for k in range(len(w.t)):
            w.angle1[k] = angle1(w, k, w.share[k])
            w.angle2[k] = angle2(w, k, w.share[k], relative2)
        if arm:
            _read_arm(w)
        for k in range(len(w.t)):
            if w.share[k] <= 1.0:
                j = samples.next1[k]
                i = samples.first[k] + j * samples.columns
                samples.out[i], samples.out[i + 1] = w.angle1[k], w.angle2[k]
                if arm and samples.columns > 2:
                    samples.out[i + 2] = w.angle0[k]
                samples.next1[k] = _after_reading(w.due1, k, samples.t1, j, samples.size[k])


@subroutine
def read_joint1(w: LaneWorkspace, arm: bool, samples: LaneSamples) -> None:
    """Read joint 1 and the arm for the samples in the step."""
    while shares(w, w.due1, 1.0):
        for k in range(len(w.t)):
            w.angle1[k] = angle1(w, k, w.share[k])
        if arm:
            _read_arm(w)
        for k in range(len(w.t)):
            if w.share[k] <= 1.0:
                j = samples.next1[k]
                i = samples.first[k] + j * samples.columns
                samples.out[i] = w.angle1[k]
                if arm and samples.columns > 2:
                    samples.out[i + 2] = w.angle0[k]
                samples.next1[k] = _after_reading(w.due1, k, samples.t1, j, samples.size[k])


@subroutine
def read_play1(w: LaneWorkspace, arm: bool, geared: bool, parts: int, active: Flags, samples: LaneSamples) -> None:
    """Read joint 1 and the arm through backlash for the samples in the step.

    Args:
        w: workspace of the lanes
        arm: whether the arm moves
        geared: whether the encoder of the arm reads a motor behind the backlash of a gear
        parts: number of parts of the step; the backlash is updated at the end of each
        active: (effects,) mask of the active effects
        samples: samples of the current segments
    """
    for part in range(1, parts + 1):
        until = part / parts
        while shares(w, w.due1, until):
            for k in range(len(w.t)):
                w.angle1[k] = angle1(w, k, w.share[k])
            hold_angle1(w, active)
            if geared:
                follow(w, active, until)
                for k in range(len(w.t)):
                    w.angle0[k] = w.hold0[k] - w.late0[k] * w.motor_speed0[k]
            elif arm:
                _read_arm(w)
            for k in range(len(w.t)):
                if w.share[k] <= until:
                    j = samples.next1[k]
                    i = samples.first[k] + j * samples.columns
                    w.hold1[k] = samples.out[i] = w.angle1[k]
                    if arm and samples.columns > 2:
                        samples.out[i + 2] = w.angle0[k]
                    samples.next1[k] = _after_reading(w.due1, k, samples.t1, j, samples.size[k])
        for k in range(len(w.t)):
            w.share[k], w.angle1[k] = until, angle1(w, k, until)
        hold_angle1(w, active)
        if geared:
            follow(w, active, until)
        for k in range(len(w.t)):
            w.hold1[k] = w.angle1[k]
    if geared:
        balance_gear(w)
    for k in range(len(w.t)):
        w.hold1[k] = angle1(w, k, 1.0) if waits(w, k) else w.hold1[k]


@subroutine
def read_joint2(w: LaneWorkspace, until: float, relative2: float, samples: LaneSamples) -> None:
    """Read joint 2 at all samples up to the fraction `until` of the step."""
    while shares(w, w.due2, until):
        for k in range(len(w.t)):
            w.angle2[k] = angle2(w, k, w.share[k], relative2)
        for k in range(len(w.t)):
            if w.share[k] <= until:
                j = samples.next2[k]
                samples.out[samples.first[k] + j * samples.columns + 1] = w.angle2[k]
                samples.next2[k] = _after_reading(w.due2, k, samples.t2, j, samples.size[k])


@subroutine
def read_play2(w: LaneWorkspace, relative2: float, active: Flags, samples: LaneSamples) -> None:
    """Read joint 2 through its backlash, which is updated every quarter of the step."""
    for quarter in range(1, 5):
        until = 0.25 * quarter
        while shares(w, w.due2, until):
            for k in range(len(w.t)):
                w.angle2[k] = angle2(w, k, w.share[k], relative2)
            hold_angle2(w, active)
            for k in range(len(w.t)):
                if w.share[k] <= until:
                    j = samples.next2[k]
                    w.hold2[k] = w.angle2[k]
                    samples.out[samples.first[k] + j * samples.columns + 1] = w.angle2[k]
                    samples.next2[k] = _after_reading(w.due2, k, samples.t2, j, samples.size[k])
        for k in range(len(w.t)):
            w.angle2[k] = angle2(w, k, until, relative2)
        hold_angle2(w, active)
        for k in range(len(w.t)):
            w.hold2[k] = w.angle2[k]
    for k in range(len(w.t)):
        w.hold2[k] = angle2(w, k, 1.0, relative2) if waits(w, k) else w.hold2[k]
