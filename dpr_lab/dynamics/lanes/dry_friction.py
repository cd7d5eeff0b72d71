r"""Coulomb friction in the lanes: a step is divided at the instants at which a joint stops or starts to slide.

The scheme applies to each lane separately, because each has its own time. The law is that of
`dpr_lab.dynamics.dry_friction`, the scheme that of `dpr_lab.dynamics.step.advanced`. With the end of the whole step,
`until`, and one event at te:

    t                       te            until
    |-----------------------|-------------|
    |------------ 1 ----------------------|    trial step in unchanged directions; `settle` finds an event in it
    |                                          2  `_take_back`: state of the start, length 0; `ahead` = te - t
    |---------- 3 ----------|                  step of length `ahead`; `_end_cut`: the joint that stops is set to rest
                            |----- 4 -----|    rest of the step, with new directions: 1 again, up to `EVENTS.most`

1. A joint stops where its speed changes sign in the trial step (`stops_at`), and starts to slide where the torque
   that it has to withstand exceeds its limit (`yields_at`). The first event of both joints counts.
2. Encoders are read within the step just taken. A step that was taken back has length 0, so that nothing is read in it.
3. `cut` is 1 where a joint starts to slide at te, 2, 3 or 4 where joint 1, joint 2 or the arm stops. A stop is moved to
   the instant at which the speed is zero, by at most `EVENTS.farthest` of the step.
4. `begin_dry` takes directions from the speeds: 0 is a joint at rest. `find_spare` compares its push with its limit at
   the first stage; `let_go` gives it a direction where the limit is exceeded.

The other lanes continue meanwhile. The loops that look for events are vector instructions; an event itself is rare and
is handled in scalar code.
"""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.arm import CLAMPED, FREE, push_on_arm, reduced_rods
from dpr_lab.dynamics.dry_friction import (
    EVENTS,
    correction,
    direction_of,
    held,
    pushes,
    slides,
    slides_with_arm,
    stops_at,
    yields_at,
)
from dpr_lab.dynamics.lanes.effects import add_dry_limit0, add_dry_limits
from dpr_lab.dynamics.lanes.workspace import LANES, At, arm_at, base_at, motion_at, terms_at, waits
from dpr_lab.effects.effect_kernels import STEPPED
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.effects.stages import Requirements
from dpr_lab.kernels import subroutine


@subroutine
def begin_dry(w: NDArray[np.float64], required: Requirements) -> bool:
    """Set length and directions of the next step of each lane; return whether any joint is at rest."""
    for k in range(LANES):
        fresh = w[At.t + k] >= w[At.until + k]
        w[At.until + k] = w[At.t + k] + w[At.step + k] if fresh else w[At.until + k]
        w[At.events + k] = 0.0 if fresh else w[At.events + k]
        ahead = w[At.ahead + k]
        w[At.h + k] = ahead if ahead > 0.0 else w[At.until + k] - w[At.t + k]
        w[At.ahead + k] = 0.0
    count = 0
    for k in range(LANES if required.dry1 else 0):
        w[At.direction1 + k] = direction_of(w[At.omega1 + k])
        count += w[At.direction1 + k] == 0.0
    for k in range(LANES if required.dry2 else 0):
        w[At.direction2 + k] = direction_of(w[At.omega2 + k] - w[At.omega1 + k])
        count += w[At.direction2 + k] == 0.0
    for k in range(LANES if required.dry0 else 0):
        w[At.direction0 + k] = direction_of(w[At.omega0 + k])
        count += w[At.direction0 + k] == 0.0
    return count > 0


@subroutine
def accelerate_held(w: NDArray[np.float64], rig: RigConstants, arm: bool) -> None:
    """Accelerations of a stage with the joints of direction 0 held, and the torques required to hold them."""
    for k in range(LANES):
        mode = _mode(w, k, arm)
        torque0 = w[At.torque0 + k] if arm else 0.0
        rods = reduced_rods(motion_at(w, k), base_at(w, k), terms_at(w, k), arm_at(w, k, rig), mode, torque0)
        direction1, direction2 = w[At.direction1 + k], w[At.direction2 + k]
        w[At.alpha0 + k], w[At.alpha1 + k], w[At.alpha2 + k] = held(rods, direction1, direction2)
        w[At.push1 + k], w[At.push2 + k] = pushes(rods, direction1, direction2)
        if arm:
            alphas = w[At.alpha1 + k], w[At.alpha2 + k]
            w[At.push0 + k] = push_on_arm(motion_at(w, k), base_at(w, k), arm_at(w, k, rig), torque0, alphas)


@subroutine
def _mode(w: NDArray[np.float64], k: int, arm: bool) -> int:
    """Mode of the arm of lane k: held before the release, and where Coulomb friction holds it."""
    return CLAMPED if not arm or waits(w, k) or w[At.direction0 + k] == 0.0 else FREE


@subroutine
def find_spare0(w: NDArray[np.float64], active: NDArray[np.bool_], spare0: int) -> bool:
    """Fill a row with the margins (limit minus torque) of arms at rest, N m; return whether one is negative."""
    for k in range(LANES):
        w[At.limit0 + k] = 0.0
    add_dry_limit0(w, active)
    count = 0
    for k in range(LANES):
        rest = w[At.direction0 + k] == 0.0
        left = max(w[At.limit0 + k], 0.0) - abs(w[At.push0 + k]) if rest else math.inf
        w[spare0 + k] = left
        count += left < 0.0
    return count > 0


@subroutine
def find_spare(w: NDArray[np.float64], active: NDArray[np.bool_], spare1: int, spare2: int) -> bool:
    """Fill two rows with the margins (limit minus torque) of joints at rest, N m; return whether one is negative."""
    for k in range(LANES):
        w[At.limit1 + k], w[At.limit2 + k] = 0.0, 0.0
    add_dry_limits(w, active)
    count = 0
    for k in range(LANES):
        rest1, rest2 = w[At.direction1 + k] == 0.0, w[At.direction2 + k] == 0.0
        left1 = max(w[At.limit1 + k], 0.0) - abs(w[At.push1 + k]) if rest1 else math.inf
        left2 = max(w[At.limit2 + k], 0.0) - abs(w[At.push2 + k]) if rest2 else math.inf
        w[spare1 + k], w[spare2 + k] = left1, left2
        count += (left1 < 0.0) | (left2 < 0.0)
    return count > 0


@subroutine
def let_go(w: NDArray[np.float64], rig: RigConstants, active: NDArray[np.bool_], required: Requirements) -> None:
    """Set the directions of joints at rest whose limits are exceeded at the start of a step."""
    arm = required.arm
    for side in (1.0, -1.0):
        for k in range(LANES):
            w[At.forward1 + k], w[At.forward2 + k] = max(w[At.limit1 + k], 0.0), max(w[At.limit2 + k], 0.0)
            w[At.push1 + k], w[At.push2 + k], w[At.limit1 + k], w[At.limit2 + k] = side, side, 0.0, 0.0
        add_dry_limits(w, active)
        if required.dry0:
            for k in range(LANES):
                w[At.forward0 + k] = max(w[At.limit0 + k], 0.0)
                w[At.push0 + k], w[At.limit0 + k] = side, 0.0
            add_dry_limit0(w, active)
    for k in range(LANES):
        exceeded = w[At.first1 + k] < 0.0 or w[At.first2 + k] < 0.0 or (required.dry0 and w[At.first0 + k] < 0.0)
        if exceeded and w[At.events + k] < EVENTS.most:
            directions = w[At.direction1 + k], w[At.direction2 + k]
            forward = w[At.forward1 + k], w[At.forward2 + k]
            backward = max(w[At.limit1 + k], 0.0), max(w[At.limit2 + k], 0.0)
            motion, base, terms, model = motion_at(w, k), base_at(w, k), terms_at(w, k), arm_at(w, k, rig)
            torque0 = w[At.torque0 + k] if arm else 0.0
            if required.dry0 and w[At.direction0 + k] == 0.0 and not waits(w, k):
                limits0 = w[At.forward0 + k], max(w[At.limit0 + k], 0.0)
                w[At.direction0 + k], w[At.direction1 + k], w[At.direction2 + k] = slides_with_arm(
                    motion, base, terms, model, torque0, directions, (limits0, forward, backward)
                )
            else:
                rods = reduced_rods(motion, base, terms, model, _mode(w, k, arm), torque0)
                w[At.direction1 + k], w[At.direction2 + k] = slides(rods, directions, forward, backward)


@subroutine
def settle(w: NDArray[np.float64], required: Requirements, resting: bool) -> None:
    """Finish a step: accept it, or take it back if a joint stopped or started to slide within it."""
    count = 0
    for k in range(LANES):
        omega1, omega2 = w[At.omega1 + k], w[At.omega2 + k]
        turns = (w[At.direction1 + k] * omega1 < 0.0) | (w[At.direction2 + k] * (omega2 - omega1) < 0.0)
        yields = resting & ((w[At.last1 + k] < 0.0) | (w[At.last2 + k] < 0.0))
        if required.dry0:
            turns |= w[At.direction0 + k] * w[At.omega0 + k] < 0.0
            yields |= resting & (w[At.last0 + k] < 0.0)
        cut = w[At.cut + k] > 0.0
        count += turns | yields | cut
        w[At.t + k] = w[At.t + k] if cut else w[At.until + k]
    if count > 0:
        for k in range(LANES):
            if w[At.cut + k] > 0.0:
                _end_cut(w, k)
            else:
                _look_for_event(w, k, required, resting)


@subroutine
def _end_cut(w: NDArray[np.float64], k: int) -> None:
    """Set to rest the joint whose stop ended the step of lane k."""
    joint = int(w[At.cut + k]) - 1
    if joint > 0:
        alpha1, alpha2 = w[At.alpha1 + k], w[At.alpha2 + k]
        speed, gain = w[At.omega1 + k], alpha1
        if joint == 2:
            speed, gain = w[At.omega2 + k] - w[At.omega1 + k], alpha2 - alpha1
        if joint == 3:
            speed, gain = w[At.omega0 + k], w[At.alpha0 + k]
        later = correction(speed, gain, w[At.h + k])
        later = min(later, w[At.until + k] - w[At.t + k])
        w[At.t + k] += later
        w[At.h + k] += later
        _stop(w, k, joint, later)
    w[At.cut + k] = 0.0


@subroutine
def _stop(w: NDArray[np.float64], k: int, joint: int, later: float) -> None:
    w[At.theta0 + k] += later * w[At.omega0 + k]
    w[At.theta1 + k] += later * w[At.omega1 + k]
    w[At.theta2 + k] += later * w[At.omega2 + k]
    w[At.omega0 + k] += later * w[At.alpha0 + k]
    w[At.omega1 + k] += later * w[At.alpha1 + k]
    w[At.omega2 + k] += later * w[At.alpha2 + k]
    if joint == 3:
        w[At.omega0 + k] = 0.0
    if joint == 1:
        w[At.omega1 + k] = 0.0
    if joint == 2 or w[At.direction2 + k] == 0.0:
        w[At.omega2 + k] = w[At.omega1 + k]


@subroutine
def _look_for_event(w: NDArray[np.float64], k: int, required: Requirements, resting: bool) -> None:
    """Take the step of lane k back if it has an event, and plan the step up to the first one."""
    h, share, joint = w[At.h + k], 1.0, 0
    direction1, direction2 = w[At.direction1 + k], w[At.direction2 + k]
    before, after = direction1 * w[At.old_omega1 + k], direction1 * w[At.omega1 + k]
    if direction1 != 0.0 and after < 0.0:
        share, joint = stops_at(before, after, direction1 * h * w[At.alpha1 + k]), 1
    before = direction2 * (w[At.old_omega2 + k] - w[At.old_omega1 + k])
    after = direction2 * (w[At.omega2 + k] - w[At.omega1 + k])
    if direction2 != 0.0 and after < 0.0:
        stops = stops_at(before, after, direction2 * h * (w[At.alpha2 + k] - w[At.alpha1 + k]))
        share, joint = (stops, 2) if stops < share else (share, joint)
    if required.dry0:
        direction0 = w[At.direction0 + k]
        before, after = direction0 * w[At.old_omega0 + k], direction0 * w[At.omega0 + k]
        if direction0 != 0.0 and after < 0.0:
            stops = stops_at(before, after, direction0 * h * w[At.alpha0 + k])
            share, joint = (stops, 3) if stops < share else (share, joint)
        if resting and w[At.events + k] < EVENTS.most and w[At.last0 + k] < 0.0:
            yields = yields_at(w[At.first0 + k], w[At.last0 + k], h)
            share, joint = (yields, 0) if yields < share else (share, joint)
    if resting and w[At.events + k] < EVENTS.most:
        for first, last in ((w[At.first1 + k], w[At.last1 + k]), (w[At.first2 + k], w[At.last2 + k])):
            if last < 0.0:
                yields = yields_at(first, last, h)
                share, joint = (yields, 0) if yields < share else (share, joint)
    if not share < 1.0:
        return
    _take_back(w, k, required)
    w[At.events + k] += 1.0
    if share >= EVENTS.shortest:
        w[At.ahead + k], w[At.cut + k] = share * h, joint + 1.0
    elif joint > 0:
        _stop(w, k, joint, 0.0)


@subroutine
def _take_back(w: NDArray[np.float64], k: int, required: Requirements) -> None:
    """Return lane k to the start of its step, as if the step had length 0."""
    w[At.t + k], w[At.h + k] = w[At.old_t + k], 0.0
    w[At.theta1 + k], w[At.theta2 + k] = w[At.old_theta1 + k], w[At.old_theta2 + k]
    w[At.omega1 + k], w[At.omega2 + k] = w[At.old_omega1 + k], w[At.old_omega2 + k]
    if required.arm:
        w[At.theta0 + k], w[At.omega0 + k] = w[At.old_theta0 + k], w[At.old_omega0 + k]
    if required.stepped:
        for i in range(len(STEPPED)):
            w[At.internal + i * LANES + k] = w[At.old_internal + i * LANES + k]
