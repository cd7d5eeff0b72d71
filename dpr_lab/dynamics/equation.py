"""Equation of motion (1): two rods on a clamped arm.

    [ a             d cos(t1-t2) ] [alpha1]   [ -d sin(t1-t2) w2^2 - c1 w1 - c2 (w1-w2) + e1 sin t1 + tau1 ]
    [ d cos(t1-t2)  b            ] [alpha2] = [  d sin(t1-t2) w1^2 - c2 (w2-w1)         + e2 sin t2 + tau2 ]

The angles t1 = theta1 and t2 = theta2 are absolute, rad, with 0 = upright and pi = hanging. w1 and w2 are the speeds of
the rods. The base parameters may have any common scale. tau1 and tau2 must have the same scale (N m at scale 1).
"""

import math

from dpr_lab.kernels import subroutine


@subroutine
def coupled(
    sin1: float,
    cos1: float,
    sin2: float,
    cos2: float,
    omega1: float,
    omega2: float,
    d: float,
    e1: float,
    e2: float,
    c1: float,
    c2: float,
) -> tuple[float, float, float]:
    """Compute coupling inertia d cos(theta1 - theta2) and right-hand sides of equation (1).

    The torques tau1 and tau2 are not included.
    """
    sin12 = sin1 * cos2 - cos1 * sin2
    cos12 = cos1 * cos2 + sin1 * sin2
    whirl = d * sin12
    drag = c2 * (omega1 - omega2)
    torque1 = e1 * sin1 - whirl * omega2 * omega2 - c1 * omega1 - drag
    torque2 = e2 * sin2 + whirl * omega1 * omega1 + drag
    return d * cos12, torque1, torque2


@subroutine
def solved(a: float, b: float, coupling: float, torque1: float, torque2: float) -> tuple[float, float]:
    """Solve for both accelerations, rad/s^2, with the mass matrix [[a, coupling], [coupling, b]]."""
    scale = 1.0 / (a * b - coupling * coupling)
    return (b * torque1 - coupling * torque2) * scale, (a * torque2 - coupling * torque1) * scale


@subroutine
def accelerations(
    theta1: float,
    theta2: float,
    omega1: float,
    omega2: float,
    a: float,
    b: float,
    d: float,
    e1: float,
    e2: float,
    c1: float,
    c2: float,
    tau1: float,
    tau2: float,
) -> tuple[float, float]:
    """Return the angular accelerations (alpha1, alpha2) of the rods, rad/s^2.

    Args:
        theta1: angle of the inner rod, rad
        theta2: angle of the outer rod, rad
        omega1: speed of the inner rod, rad/s
        omega2: speed of the outer rod, rad/s
        a: inertia about joint 1, kg m^2
        b: inertia about joint 2, kg m^2
        d: coupling inertia, kg m^2
        e1: gravity torque of the inner rod and the parts on it, N m
        e2: gravity torque of the outer rod, d g / L1, N m
        c1: viscous friction of joint 1, N m s/rad
        c2: viscous friction of joint 2, N m s/rad
        tau1: generalised torque on theta1, N m
        tau2: generalised torque on theta2, N m
    """
    coupling, torque1, torque2 = coupled(
        math.sin(theta1), math.cos(theta1), math.sin(theta2), math.cos(theta2), omega1, omega2, d, e1, e2, c1, c2
    )
    return solved(a, b, coupling, torque1 + tau1, torque2 + tau2)
