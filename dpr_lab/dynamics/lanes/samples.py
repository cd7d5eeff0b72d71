"""Encoder readings within a step of all lanes, by the cubic polynomial through its ends."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.lanes.driving import Drive, unloaded_motor
from dpr_lab.dynamics.lanes.effects import hold_angle0, hold_angle1, hold_angle2
from dpr_lab.dynamics.lanes.workspace import LANES, LaneWorkspace, Row, waits
from dpr_lab.kernels import subroutine


class LaneSamples(NamedTuple):
    """Samples of the current segment in each lane."""

    t1: NDArray[np.float64]
    """(LANES, longest) instants of the read angle of joint 1, s."""
    t2: NDArray[np.float64]
    out: NDArray[np.float64]
    """(n * N * columns,) readings of all candidates in sequence: joint 1, joint 2 and optionally the arm, rad."""
    columns: int
    first: NDArray[np.int64]
    """(LANES,) first index of the segment's readings in `out`."""
    next1: NDArray[np.int64]
    """(LANES,) next sample of joint 1."""
    next2: NDArray[np.int64]
    size: NDArray[np.int64]
    """(LANES,) number of samples of the segment; 0 for an idle lane."""


@subroutine
def _cubic(u: float, h: float, y0: float, v0: float, y1: float, v1: float) -> float:
    """Cubic polynomial through y0, y1 with derivatives v0, v1 over a step of h, at the share u of the step."""
    v = 1.0 - u
    return v * v * ((1.0 + 2.0 * u) * y0 + u * h * v0) + u * u * ((3.0 - 2.0 * u) * y1 - v * h * v1)


@subroutine
def angle1(w: LaneWorkspace, k: int, u: float) -> float:
    """theta1 of lane k at the share u of its step, rad."""
    return _cubic(u, w.h[k], w.old_theta1[k], w.old_omega1[k], w.theta1[k], w.omega1[k])


@subroutine
def angle2(w: LaneWorkspace, k: int, u: float, relative2: float) -> float:
    """Angle of joint 2 as read by its encoder, at the share u, rad."""
    theta2 = _cubic(u, w.h[k], w.old_theta2[k], w.old_omega2[k], w.theta2[k], w.omega2[k])
    return theta2 - relative2 * angle1(w, k, u)


@subroutine
def angle0(w: LaneWorkspace, k: int, u: float) -> float:
    """theta0 at the share u, rad."""
    return _cubic(u, w.h[k], w.old_theta0[k], w.old_omega0[k], w.theta0[k], w.omega0[k])


@subroutine
def _read_arm(w: LaneWorkspace) -> None:
    """Fill the row `angle0`: theta0 at the share of the step, or earlier if its encoder is late."""
    for k in range(LANES):
        w.angle0[k] = angle0(w, k, w.share[k] - w.late0[k] / w.h[k])


@subroutine
def shares(w: LaneWorkspace, due: Row, until: float) -> bool:
    """Share of the step of the next reading of each lane; whether any lane reads before the share `until`."""
    count = 0
    for k in range(LANES):
        share = (due[k] - w.old_t[k]) / w.h[k]
        w.share[k] = share
        count += share <= until
    return count > 0


@subroutine
def _after_reading(due: Row, k: int, t: NDArray[np.float64], j: int, count: int) -> int:
    """Index of the sample after j, which is the next one."""
    due[k] = t[k, j + 1] if j + 1 < count else np.inf
    return j + 1


@subroutine
def read_both(w: LaneWorkspace, relative2: float, arm: bool, samples: LaneSamples) -> None:
    """Read the samples that fall into the step, both joints at one instant."""
    while shares(w, w.due1, 1.0):
        for k in range(LANES):
            w.angle1[k] = angle1(w, k, w.share[k])
            w.angle2[k] = angle2(w, k, w.share[k], relative2)
        if arm:
            _read_arm(w)
        for k in range(LANES):
            if w.share[k] <= 1.0:
                j = samples.next1[k]
                i = samples.first[k] + j * samples.columns
                samples.out[i], samples.out[i + 1] = w.angle1[k], w.angle2[k]
                if arm and samples.columns > 2:
                    samples.out[i + 2] = w.angle0[k]
                samples.next1[k] = _after_reading(w.due1, k, samples.t1, j, samples.size[k])


@subroutine
def read_joint1(w: LaneWorkspace, arm: bool, samples: LaneSamples) -> None:
    """Read joint 1 and the arm at the samples that fall into the step."""
    while shares(w, w.due1, 1.0):
        for k in range(LANES):
            w.angle1[k] = angle1(w, k, w.share[k])
        if arm:
            _read_arm(w)
        for k in range(LANES):
            if w.share[k] <= 1.0:
                j = samples.next1[k]
                i = samples.first[k] + j * samples.columns
                samples.out[i] = w.angle1[k]
                if arm and samples.columns > 2:
                    samples.out[i + 2] = w.angle0[k]
                samples.next1[k] = _after_reading(w.due1, k, samples.t1, j, samples.size[k])


@subroutine
def read_play1(
    w: LaneWorkspace,
    arm: bool,
    active: NDArray[np.bool_],
    drive: Drive,
    run: NDArray[np.int64],
    knot: NDArray[np.int64],
    samples: LaneSamples,
) -> None:
    """Read joint 1 and the arm through the backlash of their encoders, which is updated at each quarter of the step."""
    for k in range(LANES):
        w.followed0[k] = 0.0
    for quarter in range(1, 5):
        until = 0.25 * quarter
        while shares(w, w.due1, until):
            for k in range(LANES):
                w.angle1[k] = angle1(w, k, w.share[k])
            hold_angle1(w, active)
            if arm:
                _read_arm(w)
                unloaded_motor(w, drive, run, knot)
                hold_angle0(w, active)
            for k in range(LANES):
                if w.share[k] <= until:
                    j = samples.next1[k]
                    i = samples.first[k] + j * samples.columns
                    w.hold1[k] = samples.out[i] = w.angle1[k]
                    if arm:
                        w.hold0[k], w.followed0[k] = w.angle0[k], w.share[k]
                        if samples.columns > 2:
                            samples.out[i + 2] = w.angle0[k]
                    samples.next1[k] = _after_reading(w.due1, k, samples.t1, j, samples.size[k])
        for k in range(LANES):
            w.share[k], w.angle1[k] = until, angle1(w, k, until)
        hold_angle1(w, active)
        if arm:
            for k in range(LANES):
                w.angle0[k] = angle0(w, k, until)
            unloaded_motor(w, drive, run, knot)
            hold_angle0(w, active)
        for k in range(LANES):
            w.hold1[k], w.hold0[k], w.followed0[k] = w.angle1[k], w.angle0[k], until
    for k in range(LANES):
        w.hold1[k] = angle1(w, k, 1.0) if waits(w, k) else w.hold1[k]
        w.hold0[k] = angle0(w, k, 1.0) if waits(w, k) else w.hold0[k]


@subroutine
def read_joint2(w: LaneWorkspace, until: float, relative2: float, samples: LaneSamples) -> None:
    """Read joint 2 at the samples that fall into the step before the share `until` of it."""
    while shares(w, w.due2, until):
        for k in range(LANES):
            w.angle2[k] = angle2(w, k, w.share[k], relative2)
        for k in range(LANES):
            if w.share[k] <= until:
                j = samples.next2[k]
                samples.out[samples.first[k] + j * samples.columns + 1] = w.angle2[k]
                samples.next2[k] = _after_reading(w.due2, k, samples.t2, j, samples.size[k])


@subroutine
def read_play2(w: LaneWorkspace, relative2: float, active: NDArray[np.bool_], samples: LaneSamples) -> None:
    """Read joint 2 through the backlash of its encoder, which is updated at each quarter of the step."""
    for quarter in range(1, 5):
        until = 0.25 * quarter
        while shares(w, w.due2, until):
            for k in range(LANES):
                w.angle2[k] = angle2(w, k, w.share[k], relative2)
            hold_angle2(w, active)
            for k in range(LANES):
                if w.share[k] <= until:
                    j = samples.next2[k]
                    w.hold2[k] = w.angle2[k]
                    samples.out[samples.first[k] + j * samples.columns + 1] = w.angle2[k]
                    samples.next2[k] = _after_reading(w.due2, k, samples.t2, j, samples.size[k])
        for k in range(LANES):
            w.angle2[k] = angle2(w, k, until, relative2)
        hold_angle2(w, active)
        for k in range(LANES):
            w.hold2[k] = w.angle2[k]
    for k in range(LANES):
        w.hold2[k] = angle2(w, k, 1.0, relative2) if waits(w, k) else w.hold2[k]
