"""Events of Coulomb friction within a step: a joint stops or starts to slide.

A step of length h from t to t + h is divided at its events, here at one event te:

    t                       te            t + h
    |-----------------------|-------------|
    |----------- 1 -----------------------|     trial step in unchanged directions; `first_event` finds te in it
    |----------- 2 ---------|                   step repeated up to te; a joint that stops is set to rest (`stopped`)
                            |----- 3 -----|     rest of the step, with new directions: 1 again, up to `EVENTS.most`

1. A joint stops when its speed changes sign in the trial step (`stops_at`). A joint at rest starts to slide when its
   margin becomes negative (`yields_at`). The margin is the limit of friction minus the torque on the joint. The
   earliest event is used.
2. The instant of a stop is corrected by the remaining speed, by at most `EVENTS.farthest` of the step (`correction`).
3. Directions are the signs of the speeds, and 0 for a joint at rest. `dpr_lab.dynamics.dry_friction` decides which
   joints at rest start to slide.

`dpr_lab.dynamics.step.advanced` applies this scheme to one rig, and `dpr_lab.dynamics.lanes.dry_friction` to each lane.
Tuples of three numbers are in the order joint 1, joint 2, arm.
"""

import math
from typing import NamedTuple

from dpr_lab.kernels import subroutine

Three = tuple[float, float, float]


class EventSettings(NamedTuple):
    """Settings of the location of stops and starts within a step."""

    most: int = 8
    """Maximum number of events within one step, which limits chatter.

    After this number of events, no joint starts to slide before the end of the step.
    """
    late: float = 4.0
    """Delay of the start of sliding after its estimated instant, divided by the squared step, 1/s.

    The delay ensures that the friction limit is exceeded. It changes the speed by a term of fourth order in the step.
    """
    shortest: float = 1e-9
    """Fraction of a step up to which an event is assigned to the start of the step."""
    farthest: float = 0.1
    """Maximum correction of the instant of a stop, as a fraction of the step, if the speed at this instant is not zero.
    """


EVENTS = EventSettings()


class JointMotion(NamedTuple):
    """Motion of the joints in a step: their directions, speeds and accelerations."""

    directions: Three
    """Direction of each joint: 1, -1, 0 at rest, or nan for a joint without Coulomb friction."""
    before: Three
    """Speeds at the start of the step, rad/s."""
    after: Three
    """Speeds at the end of the step, rad/s."""
    accelerations: Three
    """Accelerations at the end of the step, rad/s^2."""


@subroutine
def of_joints(values: Three) -> Three:
    """Convert values in the order theta0, theta1, theta2 to the order of joints 1, 2 and 0.

    The values are speeds or accelerations.
    """
    return values[1], values[2] - values[1], values[0]


@subroutine
def first_event(h: float, joints: JointMotion, first: Three, last: Three) -> tuple[float, int]:
    """Find the first event in a step of length h.

    Args:
        h: length of the step, s
        joints: motion of the joints in the trial step
        first: margins (limit minus torque) of the joints at the start of the step, N m; inf for joints not at rest
        last: margins at the end of the step, N m

    Returns:
        fraction of the step at the event, 1 if there is no event; and number of the joint that stops (3: the arm), 0 if
        a joint starts to slide
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
    """Return the angles and speeds of theta0, theta1, theta2 at the instant when a joint stops.

    The state is advanced by the time `later`, and the speed of the joint is set to zero.

    Args:
        thetas: angles, rad
        omegas: speeds, rad/s
        alphas: accelerations, rad/s^2
        joint: number of the joint that stops; 3 is the arm
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
    """Return the fraction of a step at which a speed crosses zero.

    The speed is approximated by a parabola with the given slope at the end of the step.

    Args:
        before: speed at the start, positive in the direction of motion; not negative
        after: speed at the end, negative
        slope: derivative of the speed at the end with respect to the fraction of the step
    """
    bend = slope - (after - before)
    first = after - before - bend
    if before <= 0.0:
        return -first / bend if first > 0.0 else 0.0
    return 2.0 * before / (math.sqrt(max(first * first - 4.0 * bend * before, 0.0)) - first)


@subroutine
def yields_at(before: float, after: float, h: float) -> float:
    """Return the fraction of a step at which a resting joint starts to slide.

    The margin, friction limit minus torque, is interpolated linearly within the step.

    Args:
        before: margin at the start of the step, N m
        after: margin at the end of the step, N m; negative
        h: length of the step, s
    """
    left = max(before, 0.0)
    return left / (left - after) + EVENTS.late * h


@subroutine
def correction(speed: float, acceleration: float, h: float) -> float:
    """Return the time until a small speed becomes zero, s.

    Its absolute value is at most `EVENTS.farthest` times the length h of the preceding step, s.

    Args:
        speed: speed, rad/s
        acceleration: acceleration, rad/s^2
        h: length of the preceding step, s
    """
    later = -speed / acceleration if acceleration != 0.0 else 0.0
    return min(max(later, -EVENTS.farthest * h), EVENTS.farthest * h)
