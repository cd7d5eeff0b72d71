r"""The whole rig: arm angle theta0 about the vertical, two rods in the vertical plane tangent to the arm's tip.

With s = sin, c = cos, r = L0 / g, A = J0 + (m1 + m2 + mb) L0^2 and phi = theta0, the mass matrix M(theta) is

    M00 = A + a s1^2 + b s2^2 + 2 d s1 s2        M01 = r e1 c1        M02 = r e2 c2
    M11 = a        M12 = d cos(t1 - t2)          M22 = b

and M alpha = f, with the rods' part of f that of equation (1) and

    f0 = tau0 - c0 phi' - k0 phi - 2 phi' [(a s1 + d s2) c1 w1 + (b s2 + d s1) c2 w2] + r (e1 s1 w1^2 + e2 s2 w2^2)
    f1 += phi'^2 (a s1 + d s2) c1                f2 += phi'^2 (b s2 + d s1) c2

The rods are slender: they turn about their own axes without inertia, so that J1 and J2 also resist the arm's rotation
by the square of the sine of their angles. Point mass mb at joint 2; J0 is the arm alone, about its axis.
"""

import math
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.equation import accelerations, coupled, solved
from dpr_lab.kernels import njit

Mode = Literal["clamped", "free", "driven"]

MODES: tuple[Mode, ...] = ("clamped", "free", "driven")
CLAMPED, FREE, DRIVEN = range(3)


class Arm(NamedTuple):
    """The arm: inertia kg m^2, viscous friction N m s/rad, spring N m/rad, and what holds it."""

    J0: float = 0.0
    c0: float = 0.0
    k0: float = 0.0
    mode: Mode = "clamped"


def arm_constants(Z: ArrayLike, frame: tuple[float, float, float], arm: Arm) -> NDArray[np.float64]:
    """(11,) a, b, d, e1, e2, c1, c2, A, r, c0, k0 of a rig with the nine parameters Z and frame (L0, L1, g)."""
    L0, L1, g = frame
    a, b, d, e1, c1, c2 = base_parameters(Z, L1, g)
    m1, m2, mb = np.asarray(Z, dtype=np.float64)[2:5]
    return np.array([a, b, d, e1, d * g / L1, c1, c2, arm.J0 + (m1 + m2 + mb) * L0**2, L0 / g, arm.c0, arm.k0])


@njit
def mass_matrix(theta1: float, theta2: float, constants: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """(M00, M01, M02, M12), kg m^2; M11 = a and M22 = b are constant.

    Args:
        theta1: angle of the inner rod, rad
        theta2: angle of the outer rod, rad
        constants: (11,) of `arm_constants`
    """
    a, b, d, e1, e2, _, _, inertia, reach = constants[:9]
    sin1, sin2 = math.sin(theta1), math.sin(theta2)
    turning = inertia + a * sin1 * sin1 + b * sin2 * sin2 + 2.0 * d * sin1 * sin2
    return turning, reach * e1 * math.cos(theta1), reach * e2 * math.cos(theta2), d * math.cos(theta1 - theta2)


@njit
def arm_accelerations(
    theta0: float,
    theta1: float,
    theta2: float,
    omega0: float,
    omega1: float,
    omega2: float,
    constants: NDArray[np.float64],
    mode: int,
    drive: float,
    tau1: float,
    tau2: float,
) -> tuple[float, float, float]:
    """Angular accelerations (alpha0, alpha1, alpha2) of arm and rods, rad/s^2.

    Args:
        theta0: angle of the arm, rad
        theta1: angle of the inner rod, rad
        theta2: angle of the outer rod, rad
        omega0: speed of the arm, rad/s
        omega1: speed of the inner rod, rad/s
        omega2: speed of the outer rod, rad/s
        constants: (11,) of `arm_constants`
        mode: CLAMPED (alpha0 = 0, equation (1)), FREE (a torque acts) or DRIVEN (alpha0 is prescribed)
        drive: FREE: torque tau0 on the arm, N m; DRIVEN: acceleration u of the arm, rad/s^2; CLAMPED: unused
        tau1: generalised torque on theta1, N m
        tau2: generalised torque on theta2, N m
    """
    a, b, d, e1, e2, c1, c2 = constants[:7]
    if mode == CLAMPED:
        alpha1, alpha2 = accelerations(theta1, theta2, omega1, omega2, a, b, d, e1, e2, c1, c2, tau1, tau2)
        return 0.0, alpha1, alpha2
    sin1, cos1, sin2, cos2 = math.sin(theta1), math.cos(theta1), math.sin(theta2), math.cos(theta2)
    coupling, torque1, torque2 = coupled(sin1, cos1, sin2, cos2, omega1, omega2, d, e1, e2, c1, c2)
    lever1, lever2 = (a * sin1 + d * sin2) * cos1, (b * sin2 + d * sin1) * cos2
    whirl = omega0 * omega0
    free1, free2 = solved(a, b, coupling, torque1 + whirl * lever1 + tau1, torque2 + whirl * lever2 + tau2)
    turning, cross1, cross2, _ = mass_matrix(theta1, theta2, constants)
    carried1, carried2 = solved(a, b, coupling, cross1, cross2)
    alpha0 = drive
    if mode == FREE:
        reach, c0, k0 = constants[8:11]
        torque0 = drive - c0 * omega0 - k0 * theta0 - 2.0 * omega0 * (lever1 * omega1 + lever2 * omega2)
        torque0 += reach * (e1 * sin1 * omega1 * omega1 + e2 * sin2 * omega2 * omega2)
        alpha0 = (torque0 - cross1 * free1 - cross2 * free2) / (turning - cross1 * carried1 - cross2 * carried2)
    return alpha0, free1 - carried1 * alpha0, free2 - carried2 * alpha0
