"""Coulomb friction in the lanes, which divide their steps at events of their joints.

`dpr_lab.dynamics.dry_friction` describes the friction law, `dpr_lab.dynamics.events` the scheme. All lanes advance
together, so a trial step with an event is undone and repeated in the next step of all lanes:

    t                       te            until
    |------------ 1 ----------------------|    trial step; `settle` finds an event in it
    |---------- 3 ----------|                  next step, of length `ahead`; `_end_cut` sets a joint that stops to rest
                            |----- 4 -----|    rest of the step, with new directions

1. Encoders are read within the step just taken. A step that was undone has the length 0, so no encoder is read in it.
2. `cut` is 1 where a joint starts to slide at te, and 2, 3 or 4 where joint 1, joint 2 or the arm stops.
3. `begin_dry` takes directions from the speeds: 0 is a joint at rest. `find_margins` compares the torque on such a
   joint with its limit at the first stage. `let_go` sets its direction of motion if the limit is exceeded.

The steps of all other lanes are accepted. The compiler converts the loops that look for events to vector instructions.
Events are rare and are handled in scalar code.
"""

import math

from dpr_lab.arrays import Flags
from dpr_lab.dynamics.arm import CLAMPED, FREE, ReducedRods, push_on_arm, reduced_rods
from dpr_lab.dynamics.dry_friction import direction_of, held, pushes, slides, slides_with_arm
from dpr_lab.dynamics.events import EVENTS, JointMotion, Three, correction, first_event, of_joints, stopped
from dpr_lab.dynamics.lanes.effects import add_dry_limit0, add_dry_limits
from dpr_lab.dynamics.lanes.workspace import (
    LaneWorkspace,
    Row,
    arm_at,
    base_at,
    motion_at,
    terms_at,
    waits,
)
from dpr_lab.effects.effect_kernels import STEPPED
from dpr_lab.effects.quantities import HELD_ARM, RigConstants
from dpr_lab.effects.stages import Requirements
from dpr_lab.kernels import inlined, subroutine


@subroutine
def begin_dry(w: LaneWorkspace, required: Requirements) -> bool:
    """Set the length of the next step and the directions of the joints.

    Return whether any joint is at rest.
    """
    for k in range(len(w.t)):
        fresh = w.t[k] >= w.until[k]
        w.until[k] = w.t[k] + w.step[k] if fresh else w.until[k]
        w.events[k] = 0.0 if fresh else w.events[k]
        ahead = w.ahead[k]
        w.h[k] = ahead if ahead > 0.0 else w.until[k] - w.t[k]
        w.ahead[k] = 0.0
    count = 0
    for k in range(len(w.t) if required.dry1 else 0):
        w.direction1[k] = direction_of(w.omega1[k])
        count += w.direction1[k] == 0.0
    for k in range(len(w.t) if required.dry2 else 0):
        w.direction2[k] = direction_of(w.omega2[k] - w.omega1[k])
        count += w.direction2[k] == 0.0
    for k in range(len(w.t) if required.dry0 else 0):
        w.direction0[k] = direction_of(w.omega0[k])
        count += w.direction0[k] == 0.0
    return count > 0


@subroutine
def accelerate_held(w: LaneWorkspace, rig: RigConstants, arm: bool) -> None:
    """Set the accelerations of a stage, and the torques that hold the joints at rest.

    `arm` states whether the arm can move.
    """
    if not arm:
        for k in range(len(w.t)):
            _hold(w, k, reduced_rods(motion_at(w, k), base_at(w, k), terms_at(w, k), HELD_ARM, CLAMPED, 0.0))
        return
    for k in range(len(w.t)):
        motion, base, model = motion_at(w, k), base_at(w, k), arm_at(w, k, rig)
        _hold(w, k, reduced_rods(motion, base, terms_at(w, k), model, _mode(w, k, True), w.torque0[k]))
        w.push0[k] = push_on_arm(motion, base, model, w.torque0[k], (w.alpha1[k], w.alpha2[k]))


@inlined
def _hold(w: LaneWorkspace, k: int, rods: ReducedRods) -> None:
    """Set the accelerations of lane k and the torques of friction that hold its joints at rest."""
    w.alpha0[k], w.alpha1[k], w.alpha2[k] = held(rods, w.direction1[k], w.direction2[k])
    w.push1[k], w.push2[k] = pushes(rods, w.direction1[k], w.direction2[k])


@subroutine
def _mode(w: LaneWorkspace, k: int, arm: bool) -> int:
    """Return the mode of the arm of lane k.

    The arm is clamped before the release and while Coulomb friction holds it; otherwise it is free.
    """
    return CLAMPED if not arm or waits(w, k) or w.direction0[k] == 0.0 else FREE


@subroutine
def find_margin0(w: LaneWorkspace, active: Flags, margin0: Row) -> bool:
    """Fill a row with the margins (limit of friction minus torque) of arms at rest, N m.

    Return whether a margin is negative. The margin of a sliding arm is infinite.
    """
    for k in range(len(w.t)):
        w.limit0[k] = 0.0
    add_dry_limit0(w, active)
    count = 0
    for k in range(len(w.t)):
        resting = w.direction0[k] == 0.0
        left = max(w.limit0[k], 0.0) - abs(w.push0[k]) if resting else math.inf
        margin0[k] = left
        count += left < 0.0
    return count > 0


@subroutine
def find_margins(w: LaneWorkspace, active: Flags, margin1: Row, margin2: Row) -> bool:
    """Fill two rows with the margins (limit of friction minus torque) of joints 1 and 2 at rest, N m.

    Return whether a margin is negative. The margin of a sliding joint is infinite.
    """
    for k in range(len(w.t)):
        w.limit1[k], w.limit2[k] = 0.0, 0.0
    add_dry_limits(w, active)
    count = 0
    for k in range(len(w.t)):
        rest1, rest2 = w.direction1[k] == 0.0, w.direction2[k] == 0.0
        left1 = max(w.limit1[k], 0.0) - abs(w.push1[k]) if rest1 else math.inf
        left2 = max(w.limit2[k], 0.0) - abs(w.push2[k]) if rest2 else math.inf
        margin1[k], margin2[k] = left1, left2
        count += (left1 < 0.0) | (left2 < 0.0)
    return count > 0


@subroutine
def let_go(w: LaneWorkspace, rig: RigConstants, active: Flags, required: Requirements) -> None:
    """Set the sliding directions of joints at rest whose friction limit is exceeded.

    The margins and torques are those of the first stage of the step.
    """
    arm = required.arm
    for side in (1.0, -1.0):
        for k in range(len(w.t)):
            w.forward1[k], w.forward2[k] = max(w.limit1[k], 0.0), max(w.limit2[k], 0.0)
            w.push1[k], w.push2[k], w.limit1[k], w.limit2[k] = side, side, 0.0, 0.0
        add_dry_limits(w, active)
        if required.dry0:
            for k in range(len(w.t)):
                w.forward0[k] = max(w.limit0[k], 0.0)
                w.push0[k], w.limit0[k] = side, 0.0
            add_dry_limit0(w, active)
    for k in range(len(w.t)):
        exceeded = w.first1[k] < 0.0 or w.first2[k] < 0.0 or (required.dry0 and w.first0[k] < 0.0)
        if exceeded and w.events[k] < EVENTS.most:
            directions = w.direction1[k], w.direction2[k]
            forward = w.forward1[k], w.forward2[k]
            backward = max(w.limit1[k], 0.0), max(w.limit2[k], 0.0)
            motion, base, terms, model = motion_at(w, k), base_at(w, k), terms_at(w, k), arm_at(w, k, rig)
            torque0 = w.torque0[k] if arm else 0.0
            if required.dry0 and w.direction0[k] == 0.0 and not waits(w, k):
                limits0 = w.forward0[k], max(w.limit0[k], 0.0)
                w.direction0[k], w.direction1[k], w.direction2[k] = slides_with_arm(
                    motion, base, terms, model, torque0, directions, (limits0, forward, backward)
                )
            else:
                rods = reduced_rods(motion, base, terms, model, _mode(w, k, arm), torque0)
                w.direction1[k], w.direction2[k] = slides(rods, directions, forward, backward)


@subroutine
def settle(w: LaneWorkspace, required: Requirements, resting: bool) -> None:
    """Accept a step, or undo it if a joint stops or starts to slide."""
    count = 0
    for k in range(len(w.t)):
        omega1, omega2 = w.omega1[k], w.omega2[k]
        turns = (w.direction1[k] * omega1 < 0.0) | (w.direction2[k] * (omega2 - omega1) < 0.0)
        yields = resting & ((w.last1[k] < 0.0) | (w.last2[k] < 0.0))
        if required.dry0:
            turns |= w.direction0[k] * w.omega0[k] < 0.0
            yields |= resting & (w.last0[k] < 0.0)
        cut = w.cut[k] > 0.0
        count += turns | yields | cut
        w.t[k] = w.t[k] if cut else w.until[k]
    if count > 0:
        for k in range(len(w.t)):
            if w.cut[k] > 0.0:
                _end_cut(w, k)
            else:
                _look_for_event(w, k, required, resting)


@subroutine
def _omegas(w: LaneWorkspace, k: int) -> Three:
    return w.omega0[k], w.omega1[k], w.omega2[k]


@subroutine
def _alphas(w: LaneWorkspace, k: int) -> Three:
    return w.alpha0[k], w.alpha1[k], w.alpha2[k]


@subroutine
def _end_cut(w: LaneWorkspace, k: int) -> None:
    """Set a joint to rest if it stops at the end of the shortened step of lane k."""
    joint = int(w.cut[k]) - 1
    if joint > 0:
        speed, acceleration = of_joints(_omegas(w, k))[joint - 1], of_joints(_alphas(w, k))[joint - 1]
        later = min(correction(speed, acceleration, w.h[k]), w.until[k] - w.t[k])
        w.t[k] += later
        w.h[k] += later
        _stop(w, k, joint, later)
    w.cut[k] = 0.0


@subroutine
def _stop(w: LaneWorkspace, k: int, joint: int, later: float) -> None:
    thetas = w.theta0[k], w.theta1[k], w.theta2[k]
    thetas, omegas = stopped(thetas, _omegas(w, k), _alphas(w, k), joint, later, w.direction2[k] == 0.0)
    w.theta0[k], w.theta1[k], w.theta2[k] = thetas
    w.omega0[k], w.omega1[k], w.omega2[k] = omegas


@subroutine
def _look_for_event(w: LaneWorkspace, k: int, required: Requirements, resting: bool) -> None:
    """Undo the step of lane k if it contains an event.

    The next step then ends at this event.
    """
    never = math.inf
    first0, last0 = (w.first0[k], w.last0[k]) if required.dry0 else (never, never)
    first, last = (w.first1[k], w.first2[k], first0), (never, never, never)
    if resting and w.events[k] < EVENTS.most:
        last = w.last1[k], w.last2[k], last0
    directions = w.direction1[k], w.direction2[k], w.direction0[k]
    before = of_joints((w.old_omega0[k], w.old_omega1[k], w.old_omega2[k]))
    joints = JointMotion(directions, before, of_joints(_omegas(w, k)), of_joints(_alphas(w, k)))
    share, joint = first_event(w.h[k], joints, first, last)
    if not share < 1.0:
        return
    h = w.h[k]
    _undo(w, k, required)
    w.events[k] += 1.0
    if share >= EVENTS.shortest:
        w.ahead[k], w.cut[k] = share * h, joint + 1.0
    elif joint > 0:
        _stop(w, k, joint, 0.0)


@subroutine
def _undo(w: LaneWorkspace, k: int, required: Requirements) -> None:
    """Undo the step of lane k, and set its length to 0."""
    w.t[k], w.h[k] = w.old_t[k], 0.0
    w.theta1[k], w.theta2[k] = w.old_theta1[k], w.old_theta2[k]
    w.omega1[k], w.omega2[k] = w.old_omega1[k], w.old_omega2[k]
    if required.arm:
        w.theta0[k], w.omega0[k] = w.old_theta0[k], w.old_omega0[k]
    if required.stepped:
        for i in range(len(STEPPED)):
            w.internal[i, k] = w.old_internal[i, k]
