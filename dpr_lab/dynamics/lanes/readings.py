"""Following tracks: lanes of candidates and segments that go through their steps together and read the encoders."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.lanes.driving import Drive, carry, push
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
from dpr_lab.dynamics.lanes.tracks import Tracks
from dpr_lab.dynamics.lanes.workspace import LANES, WORKSPACE, At, constants_at
from dpr_lab.effects.effect_kernels import (
    ARM,
    AT_RELEASE,
    LAG,
    STEPPED,
    Acting,
    arm_model,
    encoder_errors,
    input_delay,
    internal_sliding,
    reading_shifts,
)
from dpr_lab.effects.quantities import HELD_ARM, RigConstants
from dpr_lab.kernels import njit, subroutine

PAD = 0.02
"""How long before its first sample a segment starts, s: longer than any latency worth fitting."""


class Laid(NamedTuple):
    """Segments and what was clamped on, as compiled code takes them."""

    t: NDArray[np.float64]
    offsets: NDArray[np.int64]
    run: NDArray[np.int64]
    step: NDArray[np.float64]
    parts: NDArray[np.float64]
    """(runs, 5) L1, L2, m1, m2, mb of what hangs there."""
    drive: Drive
    """What drove the joints."""


class Work(NamedTuple):
    """Room to work in."""

    w: NDArray[np.float64]
    """The workspace of the lanes."""
    after: NDArray[np.float64]
    """(LANES, internal) internal states at the end of the segment before."""
    run: NDArray[np.int64]
    """(LANES,)"""
    place: NDArray[np.int64]
    """(LANES,) where known torques were looked up last."""
    samples: LaneSamples


def work(laid: Laid, angles: NDArray[np.float64]) -> Work:
    """Room to work in for segments whose readings, (n, N, columns), are to be filled in."""
    longest, none = int(np.diff(laid.offsets).max()), partial(np.zeros, LANES, dtype=np.int64)
    samples = LaneSamples(
        t1=np.zeros((LANES, longest)),
        t2=np.zeros((LANES, longest)),
        out=angles.reshape(-1),
        columns=angles.shape[2],
        first=none(),
        next1=none(),
        next2=none(),
        size=none(),
    )
    return Work(np.zeros(WORKSPACE), np.zeros((LANES, len(AT_RELEASE))), none(), none(), samples)


class Candidates(NamedTuple):
    """What is to be predicted."""

    bases: NDArray[np.float64]
    """(n, runs, 6) of what hangs there"""
    params: NDArray[np.float64]
    """(n, runs or 1, SIZE)"""
    initial: NDArray[np.float64]
    """(n, S, 4)"""
    internal: NDArray[np.float64]
    """(n, S, internal) nan where it is taken over from the segment before."""


@njit(allocates=False)
def follow(
    blocks: tuple[int, int],
    advance: Any,
    tracks: Tracks,
    laid: Laid,
    asked: Candidates,
    rig: RigConstants,
    angles: NDArray[np.float64],
    begun: NDArray[np.float64],
    room: Work,
) -> None:
    """Fill in (n, N, 2 or 3) readings, rad, and (n, S, internal) internal states at the starts of segments.

    Args:
        blocks: first and one past the last block of tracks
        advance: of `dpr_lab.dynamics.lanes.stepping`
        tracks: what goes together
        laid: the segments
        asked: the candidates
        rig: its constants
        angles: to fill in
        begun: to fill in
        room: of `work`, to work in
    """
    w, after, run, place, samples = room
    for block in range(blocks[0], blocks[1]):
        first, last = tracks.edges[block], tracks.edges[block + 1]
        active, acts = tracks.active[block], _acting(tracks.acts, block)
        rounds = 0
        for k in range(LANES):
            track = min(first + k, last - 1)
            rounds = max(rounds, tracks.last[track] - tracks.first[track])
            run[k], place[k] = laid.run[tracks.first[track]], 0
            _load(w, k, int(tracks.candidate[track]), int(laid.run[tracks.first[track]]), laid, asked, rig, active)
        for turn in range(rounds):
            for k in range(LANES):
                samples.size[k], w[At.due1 + k], w[At.due2 + k] = 0, np.inf, np.inf
                if first + k < last and tracks.first[first + k] + turn < tracks.last[first + k]:
                    c, s = int(tracks.candidate[first + k]), int(tracks.first[first + k]) + turn
                    _begin(w, k, c, s, turn, laid, asked, acts, rig, active, samples, after[k], begun[c, s])
            _read(w, advance, rig, active, acts, samples, after, laid.drive, run, place)
            if acts.errors:
                for k in range(last - first):
                    c, s = int(tracks.candidate[first + k]), int(tracks.first[first + k]) + turn
                    if s < tracks.last[first + k]:
                        _add_errors(c, s, laid, asked, rig, active, angles)


@subroutine
def _acting(acts: Acting, block: int) -> Acting:
    return Acting(
        acts.torques[block], acts.loads[block], acts.arm[block], acts.timing[block], acts.errors[block],
        acts.play[block], acts.drives[block], acts.carried[block], acts.stepped[block], acts.internal[block],
        acts.dry1[block], acts.dry2[block],
    )  # fmt: skip


@subroutine
def _load(
    w: NDArray[np.float64],
    k: int,
    c: int,
    r: int,
    laid: Laid,
    asked: Candidates,
    rig: RigConstants,
    active: NDArray[np.bool_],
) -> None:
    """What lane k keeps along its track: candidate c in run r."""
    w[At.L1 + k], w[At.L2 + k] = laid.parts[r, 0], laid.parts[r, 1]
    w[At.m1 + k], w[At.m2 + k], w[At.mb + k] = laid.parts[r, 2], laid.parts[r, 3], laid.parts[r, 4]
    w[At.a + k], w[At.b + k], w[At.d + k] = asked.bases[c, r, 0], asked.bases[c, r, 1], asked.bases[c, r, 2]
    w[At.e1 + k], w[At.c1 + k], w[At.c2 + k] = asked.bases[c, r, 3], asked.bases[c, r, 4], asked.bases[c, r, 5]
    w[At.e2 + k] = w[At.d + k] * rig.g / rig.L1
    w[At.step + k], w[At.drive1 + k], w[At.drive2 + k] = laid.step[0], 0.0, 0.0
    w[At.direction1 + k], w[At.direction2 + k] = np.nan, np.nan
    w[At.carried + k], w[At.whirl + k] = 0.0, 0.0
    params = asked.params[c, _own(r, asked)]
    for i in range(len(params)):
        w[At.params + i * LANES + k] = params[i]
    arm = arm_model(constants_at(w, k, rig), HELD_ARM, params, active)
    w[At.late + k] = input_delay(0.0, params, active)
    w[At.inertia + k], w[At.friction + k], w[At.stiffness + k] = arm.inertia, arm.friction, arm.stiffness


@subroutine
def _own(r: int, asked: Candidates) -> int:
    """Where the effects of run r are among a candidate's."""
    return r if asked.params.shape[1] > 1 else 0


@njit
def segment_start(first: float, near: float = 0.04) -> float:
    """When a segment starts whose first reading is taken `first` seconds after the release, s.

    One that would start less than `near` after the release starts with it, where nothing is remembered yet.
    """
    start = first - PAD
    return 0.0 if 0.0 < start and start < near else start


@subroutine
def _begin(
    w: NDArray[np.float64],
    k: int,
    c: int,
    s: int,
    turn: int,
    laid: Laid,
    asked: Candidates,
    acts: Acting,
    rig: RigConstants,
    active: NDArray[np.bool_],
    samples: LaneSamples,
    internal: NDArray[np.float64],
    begun: NDArray[np.float64],
) -> None:
    """Put lane k at the start of segment s; leave it idle where the instants of reading make no sense.

    `internal` are the internal states at the end of the segment before, `begun` becomes those at the start of this.
    """
    i, j, x = laid.offsets[s], laid.offsets[s + 1], asked.initial[c, s]
    params, count = asked.params[c, _own(laid.run[s], asked)], j - i
    until = laid.t[min(j, len(laid.t) - 1)]
    samples.first[k] = (c * len(laid.t) + i) * samples.columns
    for n in range(count):
        samples.t1[k, n] = laid.t[i + n]
    for n in range(count if acts.timing or acts.play else 0):
        samples.t2[k, n] = laid.t[i + n]
    if acts.timing:
        for n in range(count):
            shift1, shift2 = reading_shifts(laid.t[i + n], params, active)
            samples.t1[k, n] += shift1
            samples.t2[k, n] += shift2
        until += reading_shifts(until, params, active)[0]
    now = segment_start(samples.t1[k, 0])
    if turn == 0:
        _remember_nothing(x, segment_start(float(laid.t[i])), internal)
    for n in range(len(begun)):
        given = asked.internal[c, s, n]
        begun[n] = internal[n] if np.isnan(given) else given
    last1 = samples.t1[k, count - 1]
    last2 = samples.t2[k, count - 1] if acts.timing else last1
    longest = now + 2.0 * (laid.t[j - 1] - laid.t[i]) + 1.0
    samples.next1[k], samples.next2[k], samples.size[k] = 0, 0, count
    if not (last1 < longest and last2 < longest):  # or not a number: a clock that no rig has
        for n in range(count * samples.columns):
            samples.out[samples.first[k] + n] = np.nan
        for n in range(len(internal)):
            internal[n] = np.nan
        return
    w[At.due1 + k] = samples.t1[k, 0]
    if acts.timing or acts.play:
        w[At.due2 + k] = samples.t2[k, 0]
    w[At.handed + k] = min(segment_start(float(until)), last1)
    w[At.t + k], w[At.h + k], w[At.step + k] = now, laid.step[s], laid.step[s]
    w[At.until + k], w[At.ahead + k], w[At.cut + k] = now, 0.0, 0.0
    w[At.theta1 + k], w[At.theta2 + k], w[At.omega1 + k], w[At.omega2 + k] = x[0], x[1], x[2], x[3]
    w[At.theta0 + k], w[At.omega0 + k] = begun[ARM], begun[ARM + 1]
    w[At.old_theta0 + k], w[At.old_omega0 + k] = begun[ARM], begun[ARM + 1]
    for row in (At.stage_omega0, At.stage_omega1, At.stage_omega2, At.alpha0, At.alpha1, At.alpha2):
        w[row + k] = 0.0
    w[At.hold + k] = x[1] - rig.relative2 * x[0] + begun[LAG]
    for n, place in enumerate(STEPPED):
        w[At.internal + n * LANES + k] = begun[place]


@subroutine
def _remember_nothing(x: NDArray[np.float64], now: float, internal: NDArray[np.float64]) -> None:
    """Internal states at the first start in a run: of a rig at rest until the release, of long sliding after it."""
    for n in range(len(internal)):
        internal[n] = AT_RELEASE[n]
    if now > 0.0:
        for n, value in enumerate(internal_sliding(x[2], x[3] - x[2])):
            internal[STEPPED[n]] = value


@subroutine
def _read(
    w: NDArray[np.float64],
    advance: Any,
    rig: RigConstants,
    active: NDArray[np.bool_],
    acts: Acting,
    samples: LaneSamples,
    after: NDArray[np.float64],
    drive: Drive,
    run: NDArray[np.int64],
    place: NDArray[np.int64],
) -> None:
    """Step all lanes on until each has read its segment."""
    held = _any_held(w)
    while _any_due(w):
        if len(drive.t) > 0:
            push(w, drive, run, place)
        if len(drive.arm_t) > 0:
            carry(w, drive, run)
        advance(w, rig, active, acts, held)
        if not (acts.timing or acts.play):
            read_both(w, rig.relative2, acts.arm, samples)
        else:
            read_joint1(w, acts.arm, samples)
            if acts.play:
                read_play(w, rig.relative2, active, samples)
            else:
                read_joint2(w, 1.0, rig.relative2, samples)
        if acts.internal:
            _hand_over(w, rig.relative2, active, acts.play, after)
        held = held and _any_held(w)


@subroutine
def _any_held(w: NDArray[np.float64]) -> bool:
    """Whether the next step of any lane begins before the release."""
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
    """Internal states for the next segment, where it starts in this step; the play's is that of the step's end."""
    if not shares(w, At.handed, 1.0):
        return
    for k in range(LANES):
        turn1 = w[At.theta1 + k] - w[At.old_theta1 + k]
        turn2 = w[At.theta2 + k] - w[At.old_theta2 + k] - turn1
        w[At.displacement1 + k], w[At.displacement2 + k] = w[At.share + k] * turn1, w[At.share + k] * turn2
    displaced(w, active)
    for k in range(LANES):
        u = w[At.share + k]
        if u <= 1.0:
            if u > 0.0:
                for n, place in enumerate(STEPPED):
                    after[k, place] = w[At.moved + n * LANES + k]
                after[k, LAG] = w[At.hold + k] - angle2(w, k, 1.0, relative2) if play else 0.0
                after[k, ARM] = angle0(w, k, u)
                after[k, ARM + 1] = w[At.old_omega0 + k] + u * (w[At.omega0 + k] - w[At.old_omega0 + k])
            w[At.handed + k] = np.inf


@subroutine
def _add_errors(
    c: int,
    s: int,
    laid: Laid,
    asked: Candidates,
    rig: RigConstants,
    active: NDArray[np.bool_],
    angles: NDArray[np.float64],
) -> None:
    """Add the errors of the encoders to what candidate c reads on segment s."""
    params = asked.params[c, _own(laid.run[s], asked)]
    for i in range(laid.offsets[s], laid.offsets[s + 1]):
        angle1, angle2 = angles[c, i, 0], angles[c, i, 1]
        error1, error2 = encoder_errors(angle1, angle2, laid.t[i], laid.run[s], rig, params, active)
        angles[c, i, 0], angles[c, i, 1] = angle1 + error1, angle2 + error2
