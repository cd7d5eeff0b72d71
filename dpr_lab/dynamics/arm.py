"""Equation of motion of a rotating arm with two rods.

The rods swing in the plane perpendicular to the arm. With s = sin, c = cos, r = L0 / g, A = J0 + (m1 + m2 + mb) L0^2
and phi = theta0, the mass matrix M(theta) is

    M00 = A + a s1^2 + b s2^2 + 2 d s1 s2        M01 = r e1 c1        M02 = r e2 c2
    M11 = a        M12 = d cos(t1 - t2)          M22 = b

and M alpha = f. The components f1 and f2 are those of equation (1) plus the centrifugal torques of the arm:

    f0 = tau0 - c0 phi' - k0 phi - 2 phi' [(a s1 + d s2) c1 w1 + (b s2 + d s1) c2 w2] + r (e1 s1 w1^2 + e2 s2 w2^2)
    f1 += phi'^2 (a s1 + d s2) c1                f2 += phi'^2 (b s2 + d s1) c2

The rods are slender, without inertia about their own axes. J1 and J2 therefore also contribute to the inertia of the
arm, with the squared sine of their angles. mb is a point mass at joint 2. J0 is the inertia of the arm alone about its
axis. Effects add to M11, M22, M12 and to f1, f2 (`dpr_lab.effects.quantities.Terms`).
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.equation import coupled, solved
from dpr_lab.effects.quantities import ArmModel, BaseParameters, Motion, Terms
from dpr_lab.kernels import inlined, subroutine

Mode = Literal["clamped", "free", "driven"]

MODES: tuple[Mode, ...] = ("clamped", "free", "driven")
CLAMPED, FREE, DRIVEN = range(3)


class ArmParameters(NamedTuple):
    """Parameters of the arm alone, and its mode.

    J0 is the inertia about the axis of the arm, kg m^2, c0 its viscous friction, N m s/rad, and k0 the stiffness of a
    spring, N m/rad.
    """

    J0: float = 0.0
    c0: float = 0.0
    k0: float = 0.0
    mode: Mode = "clamped"


def with_gravity(base: ArrayLike, L1: float, g: float) -> BaseParameters:
    """Add e2 to the (6,) base parameters a, b, d, e1, c1, c2, SI."""
    a, b, d, e1, c1, c2 = np.asarray(base, dtype=np.float64).tolist()
    return BaseParameters(a, b, d, e1, d * g / L1, c1, c2)


def mounted(Z: ArrayLike, frame: tuple[float, float, float], arm: ArmParameters) -> tuple[BaseParameters, ArmModel]:
    """Return the base parameters of the rods and the model of the arm.

    Args:
        Z: (9,) parameters of the rods, SI
        frame: L0, L1, g, SI
        arm: parameters of the arm
    """
    L0, L1, g = frame
    m1, m2, mb = np.asarray(Z, dtype=np.float64)[2:5].tolist()
    model = ArmModel(float(arm.J0) + (m1 + m2 + mb) * L0**2, L0 / g, float(arm.c0), float(arm.k0))
    return with_gravity(base_parameters(Z, L1, g), L1, g), model


@subroutine
def mass_matrix(motion: Motion, base: BaseParameters, arm: ArmModel) -> tuple[float, float, float]:
    """Return the first row (M00, M01, M02) of the mass matrix, kg m^2.

    M00 is the inertia of the arm. M01 and M02 couple the arm with the rods.
    """
    turning = arm.inertia + base.a * motion.sin1 * motion.sin1 + base.b * motion.sin2 * motion.sin2
    turning += 2.0 * base.d * motion.sin1 * motion.sin2
    return turning, arm.reach * base.e1 * motion.cos1, arm.reach * base.e2 * motion.cos2


@inlined
def levers(sin1: float, cos1: float, sin2: float, cos2: float, a: float, b: float, d: float) -> tuple[float, float]:
    """Return the centrifugal torques on both rods per squared speed of the arm, kg m^2."""
    return (a * sin1 + d * sin2) * cos1, (b * sin2 + d * sin1) * cos2


@inlined
def push_on_arm(
    motion: Motion, base: BaseParameters, arm: ArmModel, torque0: float, alphas: tuple[float, float]
) -> float:
    """Return the torque that friction must balance to hold the arm at rest, N m.

    `torque0` is the torque of drive and effects on the arm, N m. `alphas` are the accelerations of the rods, rad/s^2.
    """
    pull = base.e1 * (motion.sin1 * motion.omega1 * motion.omega1 - motion.cos1 * alphas[0])
    pull += base.e2 * (motion.sin2 * motion.omega2 * motion.omega2 - motion.cos2 * alphas[1])
    return torque0 - arm.stiffness * motion.theta0 + arm.reach * pull


class ReducedRods(NamedTuple):
    """Equations of motion of both rods after elimination of the arm.

    The acceleration of the arm is push0 - reach1 alpha1 - reach2 alpha2, where alpha1 and alpha2 are the accelerations
    of the rods.
    """

    inertia1: float
    inertia2: float
    coupling: float
    torque1: float
    torque2: float
    push0: float
    reach1: float
    reach2: float


@subroutine
def reduced_rods(
    motion: Motion, base: BaseParameters, terms: Terms, arm: ArmModel, mode: int, drive: float
) -> ReducedRods:
    """Return the equations of motion of both rods after elimination of the arm.

    See `arm_accelerations` for the arguments.
    """
    a, b, d, e1, e2, c1, c2 = base
    sin1, cos1, sin2, cos2 = motion.sin1, motion.cos1, motion.sin2, motion.cos2
    omega0, omega1, omega2 = motion.omega0, motion.omega1, motion.omega2
    coupling, torque1, torque2 = coupled(sin1, cos1, sin2, cos2, omega1, omega2, d, e1, e2, c1, c2)
    coupling += terms.coupling
    torque1 += terms.torque1
    torque2 += terms.torque2
    inertia1, inertia2 = a + terms.a, b + terms.b
    if mode == CLAMPED:
        return ReducedRods(inertia1, inertia2, coupling, torque1, torque2, 0.0, 0.0, 0.0)
    lever1, lever2 = levers(sin1, cos1, sin2, cos2, a, b, d)
    squared = omega0 * omega0
    torque1 += squared * lever1
    torque2 += squared * lever2
    turning, cross1, cross2 = mass_matrix(motion, base, arm)
    if mode != FREE:
        return ReducedRods(
            inertia1, inertia2, coupling, torque1 - cross1 * drive, torque2 - cross2 * drive, drive, 0.0, 0.0
        )
    torque0 = drive - arm.friction * omega0 - arm.stiffness * motion.theta0
    torque0 -= 2.0 * omega0 * (lever1 * omega1 + lever2 * omega2)
    torque0 += arm.reach * (e1 * sin1 * omega1 * omega1 + e2 * sin2 * omega2 * omega2)
    push0, reach1, reach2 = torque0 / turning, cross1 / turning, cross2 / turning
    return ReducedRods(
        inertia1 - cross1 * reach1, inertia2 - cross2 * reach2, coupling - cross1 * reach2,
        torque1 - cross1 * push0, torque2 - cross2 * push0, push0, reach1, reach2,
    )  # fmt: skip


@subroutine
def arm_accelerations(
    motion: Motion, base: BaseParameters, terms: Terms, arm: ArmModel, mode: int, drive: float
) -> tuple[float, float, float]:
    """Return the accelerations (alpha0, alpha1, alpha2), rad/s^2, if friction holds no joint at rest.

    Args:
        motion: angles and speeds
        base: base parameters
        terms: contributions of effects
        arm: the arm, unused while it is clamped
        mode: CLAMPED (alpha0 = 0, equation (1)), FREE (a torque acts) or DRIVEN (alpha0 is prescribed)
        drive: FREE: torque tau0 on the arm, N m; DRIVEN: acceleration u of the arm, rad/s^2; CLAMPED: unused
    """
    rods = reduced_rods(motion, base, terms, arm, mode, drive)
    alpha1, alpha2 = solved(rods.inertia1, rods.inertia2, rods.coupling, rods.torque1, rods.torque2)
    return rods.push0 - rods.reach1 * alpha1 - rods.reach2 * alpha2, alpha1, alpha2
