"""Coulomb friction of joints, which holds a joint at rest up to a limit torque.

Let u = (omega1, omega2 - omega1) be the speeds of the joints, tau the torques on them, A their mass matrix, and F_j the
friction limit of joint j. Then

    A u' = tau - lambda,    lambda_j = F_j sgn(u_j) if u_j is not 0,    |lambda_j| <= F_j otherwise.

A is positive definite, so u' is the unique minimum of u' A u' / 2 - tau u' + sum F_j |u'_j| over the joints at rest.
`slides` finds this minimum among nine cases: each joint stays at rest or slides in either direction. Between two events
each joint keeps its direction, and the motion is smooth.
"""

from dpr_lab.dynamics.arm import CLAMPED, FREE, ReducedRods, push_on_arm, reduced_rods
from dpr_lab.dynamics.equation import solved
from dpr_lab.effects.quantities import ArmModel, BaseParameters, Motion, Terms
from dpr_lab.kernels import subroutine

Limits = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]


@subroutine
def direction_of(speed: float) -> float:
    """Return the direction in which a joint slides: 1, -1, or 0 at rest."""
    return 1.0 if speed > 0.0 else (-1.0 if speed < 0.0 else 0.0)


@subroutine
def held(rods: ReducedRods, direction1: float, direction2: float) -> tuple[float, float, float]:
    """Return the accelerations of arm and rods, rad/s^2, while friction holds the joints at rest.

    A joint at rest has the direction 0.
    """
    free1, free2 = solved(rods.inertia1, rods.inertia2, rods.coupling, rods.torque1, rods.torque2)
    together = (rods.torque1 + rods.torque2) / (rods.inertia1 + rods.inertia2 + 2.0 * rods.coupling)
    outer = rods.torque2 / rods.inertia2
    rest1, rest2 = direction1 == 0.0, direction2 == 0.0
    alpha1 = 0.0 if rest1 else (together if rest2 else free1)
    alpha2 = (0.0 if rest2 else outer) if rest1 else (together if rest2 else free2)
    return rods.push0 - rods.reach1 * alpha1 - rods.reach2 * alpha2, alpha1, alpha2


@subroutine
def pushes(rods: ReducedRods, direction1: float, direction2: float) -> tuple[float, float]:
    """Return the torques of friction that hold joints 1 and 2 at rest, N m.

    The value of a joint that slides (direction not 0) is meaningless.
    """
    across = rods.inertia2 + rods.coupling
    of_both, outer = rods.torque1 + rods.torque2, rods.torque2
    rest1, rest2 = direction1 == 0.0, direction2 == 0.0
    push1 = of_both - (0.0 if rest2 else across / rods.inertia2 * outer)
    push2 = outer - (0.0 if rest1 else across / (rods.inertia1 + across + rods.coupling) * of_both)
    return push1, push2


@subroutine
def _beyond(push: float, forward: float, backward: float) -> float:
    """Return the direction in which a joint at rest starts to slide, or 0 if friction holds it."""
    return 1.0 if push > forward else (-1.0 if push < -backward else 0.0)


@subroutine
def slides(
    rods: ReducedRods, directions: tuple[float, float], forward: tuple[float, float], backward: tuple[float, float]
) -> tuple[float, float]:
    """Return the direction in which each joint continues: 1, -1, or 0 for a joint that stays at rest.

    Args:
        rods: equations of the rods with all torques except the friction of joints at rest
        directions: present direction of each joint, 1, -1, or 0 at rest
        forward: limits of friction against sliding in the direction 1, N m
        backward: limits of friction against sliding in the direction -1, N m
    """
    if directions[0] != 0.0 and directions[1] != 0.0:
        return directions
    push1, push2 = pushes(rods, directions[0], directions[1])
    give1, give2 = _beyond(push1, forward[0], backward[0]), _beyond(push2, forward[1], backward[1])
    if directions[0] != 0.0:
        return directions[0], give2
    if directions[1] != 0.0:
        return give1, directions[1]
    across = rods.inertia2 + rods.coupling
    whole, outer = rods.inertia1 + across + rods.coupling, rods.inertia2
    if give1 == 0.0 and give2 == 0.0:
        return 0.0, 0.0
    left1 = push1 - give1 * (forward[0] if give1 > 0.0 else backward[0])
    if give1 != 0.0 and _beyond(push2 - across * left1 / whole, forward[1], backward[1]) == 0.0:
        return give1, 0.0
    left2 = push2 - give2 * (forward[1] if give2 > 0.0 else backward[1])
    if give2 != 0.0 and _beyond(push1 - across * left2 / outer, forward[0], backward[0]) == 0.0:
        return 0.0, give2
    for side1 in (1.0, -1.0):
        for side2 in (1.0, -1.0):
            left1 = push1 - side1 * (forward[0] if side1 > 0.0 else backward[0])
            left2 = push2 - side2 * (forward[1] if side2 > 0.0 else backward[1])
            if side1 * (outer * left1 - across * left2) > 0.0 and side2 * (whole * left2 - across * left1) > 0.0:
                return side1, side2
    return give1, give2


@subroutine
def _with_sliding_friction(
    terms: Terms, before: tuple[float, float], after: tuple[float, float], limits: Limits
) -> Terms:
    """Add the sliding friction of joints that have just started to slide."""
    _, forward, backward = limits
    torque1, torque2 = terms.torque1, terms.torque2
    if before[0] == 0.0 and after[0] != 0.0:
        torque1 -= forward[0] if after[0] > 0.0 else -backward[0]
    if before[1] == 0.0 and after[1] != 0.0:
        friction = forward[1] if after[1] > 0.0 else -backward[1]
        torque1, torque2 = torque1 + friction, torque2 - friction
    return Terms(terms.a, terms.b, terms.coupling, torque1, torque2)


@subroutine
def slides_with_arm(
    motion: Motion,
    base: BaseParameters,
    terms: Terms,
    arm: ArmModel,
    torque0: float,
    directions: tuple[float, float],
    limits: Limits,
) -> tuple[float, float, float]:
    """Return the directions in which an arm at rest, joint 1 and joint 2 continue.

    There are three cases: the arm stays at rest, or slides in either direction. In each case `slides` gives the
    directions of the rod joints. Exactly one of the three cases is consistent.

    Args:
        motion: motion with the arm at rest
        base: base parameters
        terms: contributions of all effects except the friction of joints at rest
        arm: model of the arm
        torque0: torque of drive and effects on the arm, without its friction at rest, N m
        directions: directions of the rod joints, as for `slides`
        limits: friction limits of the arm (forward, backward), of both joints forward and of both backward, N m
    """
    limits0, forward, backward = limits
    still = slides(reduced_rods(motion, base, terms, arm, CLAMPED, 0.0), directions, forward, backward)
    rods = reduced_rods(motion, base, _with_sliding_friction(terms, directions, still, limits), arm, CLAMPED, 0.0)
    _, alpha1, alpha2 = held(rods, still[0], still[1])
    push = push_on_arm(motion, base, arm, torque0, (alpha1, alpha2))
    side = _beyond(push, limits0[0], limits0[1])
    if side == 0.0:
        return 0.0, still[0], still[1]
    for direction in (side, -side):
        driven = torque0 - (limits0[0] if direction > 0.0 else -limits0[1])
        moving = slides(reduced_rods(motion, base, terms, arm, FREE, driven), directions, forward, backward)
        rods = reduced_rods(motion, base, _with_sliding_friction(terms, directions, moving, limits), arm, FREE, driven)
        alpha0, _, _ = held(rods, moving[0], moving[1])
        if direction * alpha0 > 0.0:
            return direction, moving[0], moving[1]
    return side, still[0], still[1]
