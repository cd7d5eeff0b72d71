r"""Events of Coulomb friction within a step: instants at which a joint stops or starts to slide.

A step of h from t to t + h is divided at its events, here one at te:

    t                       te            t + h
    |-----------------------|-------------|
    |----------- 1 -----------------------|     trial step in unchanged directions; `first_event` finds te in it
    |----------- 2 ---------|                   step repeated up to te; a joint that stops is set to rest (`stopped`)
                            |----- 3 -----|     rest of the step, with new directions: 1 again, up to `EVENTS.most`

1. A joint stops where its speed changes sign in the trial step (`stops_at`). A joint at rest starts to slide where its
   margin, the limit of friction minus the torque on it, becomes negative (`yields_at`). The first event counts.
2. The instant of a stop is corrected by the remaining speed, by at most `EVENTS.farthest` of the step (`correction`).
3. Directions are the signs of the speeds, 0 for a joint at rest; `dpr_lab.dynamics.dry_friction` decides which joints
   at rest start to slide.

`dpr_lab.dynamics.step.advanced` does this for one rig, `dpr_lab.dynamics.lanes.dry_friction` for each lane separately.
Tuples of three numbers have the order joint 1, joint 2, arm.
"""

import math
from typing import NamedTuple

from dpr_lab.kernels import subroutine

Three = tuple[float, float, float]


class EventSettings(NamedTuple):
    """Location of stops and starts within a step."""

    most: int = 8
    """Maximum number of events within one step; afterwards no joint starts to slide before its end, which limits
    chatter.
    """
    late: float = 4.0
    """Delay of the start of sliding after its estimated instant, in steps times seconds, so that the limit is
    certainly exceeded; its effect on the speed is of fourth order.
    """
    shortest: float = 1e-9
    """An event before this fraction of a step is assigned to the start of the step."""
    farthest: float = 0.1
    """Maximum correction of the instant of a stop, as a fraction of the step, if the speed is not exactly zero."""


EVENTS = EventSettings()


class JointMotion(NamedTuple):
    """Directions of the joints, their speeds at start and end of a step, and their accelerations at its end."""

    directions: Three
    """1, -1, 0 at rest, or nan for a joint without Coulomb friction."""
    before: Three
    """rad/s"""
    after: Three
    """rad/s"""
    accelerations: Three
    """rad/s^2"""


@subroutine
def of_joints(values: Three) -> Three:
    """Speeds or accelerations of joint 1, joint 2 and the arm from those of theta0, theta1, theta2."""
    return values[1], values[2] - values[1], values[0]


@subroutine
def first_event(h: float, joints: JointMotion, first: Three, last: Three) -> tuple[float, int]:
    """First event in a step of h.

    Args:
        h: the step, s
        joints: motion of the joints in the trial step
        first: margins (limit minus torque) of the joints at the start of the step, N m; inf for joints not at rest
        last: the same at its end

    Returns:
        its share of the step, 1 without an event; and the joint that stops (3: the arm), 0 if a joint starts to slide
    """
    share, joint = 1.0, 0
    for i in range(3):
        direction = joints.directions[i]
        before, after = direction * joints.before[i], direction * joints.after[i]
        if direction != 0.0 and after < 0.0:
            stops = stops_at(before, after, direction * h * joints.accelerations[i])
            share, joint = (stops, i + 1) if stops < share else (share, joint)
    for i in range(3):
        if last[i] < 0.0:
            yields = yields_at(first[i], last[i], h)
            share, joint = (yields, 0) if yields < share else (share, joint)
    return share, joint


@subroutine
def stopped(
    thetas: Three, omegas: Three, alphas: Three, joint: int, later: float, resting2: bool
) -> tuple[Three, Three]:
    """Angles and speeds (order theta0, theta1, theta2) after a correction of the instant, with a joint set to rest.

    Args:
        thetas: angles, rad
        omegas: speeds, rad/s
        alphas: accelerations, rad/s^2
        joint: the joint that stops; 3 is the arm
        later: correction of the instant, s
        resting2: whether joint 2 was at rest
    """
    omega0 = 0.0 if joint == 3 else omegas[0] + later * alphas[0]
    omega1 = 0.0 if joint == 1 else omegas[1] + later * alphas[1]
    omega2 = omega1 if joint == 2 or resting2 else omegas[2] + later * alphas[2]
    return (
        (thetas[0] + later * omegas[0], thetas[1] + later * omegas[1], thetas[2] + later * omegas[2]),
        (omega0, omega1, omega2),
    )


@subroutine
def stops_at(before: float, after: float, slope: float) -> float:
    """Fraction of a step at which a speed crosses zero, from a parabola with the given slope at the end.

    Args:
        before: speed at the start, positive in the direction of motion; not negative
        after: speed at the end, negative
        slope: derivative at the end with respect to the fraction of the step
    """
    bend = slope - (after - before)
    first = after - before - bend
    if before <= 0.0:
        return -first / bend if first > 0.0 else 0.0
    return 2.0 * before / (math.sqrt(max(first * first - 4.0 * bend * before, 0.0)) - first)


@subroutine
def yields_at(before: float, after: float, h: float) -> float:
    """Fraction of a step of h after which a joint breaks away, from the margins of its limit at start and end."""
    left = max(before, 0.0)
    return left / (left - after) + EVENTS.late * h


@subroutine
def correction(speed: float, acceleration: float, h: float) -> float:
    """Time, s, until a speed near zero is zero; at most a small part of the preceding step h."""
    later = -speed / acceleration if acceleration != 0.0 else 0.0
    return min(max(later, -EVENTS.farthest * h), EVENTS.farthest * h)
