r"""The whole rig: arm angle theta0 about the vertical, two rods in the vertical plane tangent to the arm's tip.

With s = sin, c = cos, r = L0 / g, A = J0 + (m1 + m2 + mb) L0^2 and phi = theta0, the mass matrix M(theta) is

    M00 = A + a s1^2 + b s2^2 + 2 d s1 s2        M01 = r e1 c1        M02 = r e2 c2
    M11 = a        M12 = d cos(t1 - t2)          M22 = b

and M alpha = f, with the rods' part of f that of equation (1) and

    f0 = tau0 - c0 phi' - k0 phi - 2 phi' [(a s1 + d s2) c1 w1 + (b s2 + d s1) c2 w2] + r (e1 s1 w1^2 + e2 s2 w2^2)
    f1 += phi'^2 (a s1 + d s2) c1                f2 += phi'^2 (b s2 + d s1) c2

The rods are slender: they turn about their own axes without inertia, so that J1 and J2 also resist the arm's rotation
by the square of the sine of their angles. Point mass mb at joint 2; J0 is the arm alone, about its axis.

Effects add to M11, M22, M12 and to f1, f2 (`dpr_lab.effects.quantities.Terms`).
"""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.equation import coupled, solved
from dpr_lab.effects.quantities import Motion, Mount, Rods, Terms
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


def rods_of(base: ArrayLike, L1: float, g: float) -> Rods:
    """The rods from their base parameters (6,) a, b, d, e1, c1, c2, SI."""
    a, b, d, e1, c1, c2 = np.asarray(base, dtype=np.float64).tolist()
    return Rods(a, b, d, e1, d * g / L1, c1, c2)


def mounted(Z: ArrayLike, frame: tuple[float, float, float], arm: Arm) -> tuple[Rods, Mount]:
    """Rods and arm of a rig with the nine parameters Z and frame (L0, L1, g)."""
    L0, L1, g = frame
    m1, m2, mb = np.asarray(Z, dtype=np.float64)[2:5].tolist()
    mount = Mount(float(arm.J0) + (m1 + m2 + mb) * L0**2, L0 / g, float(arm.c0), float(arm.k0))
    return rods_of(base_parameters(Z, L1, g), L1, g), mount


@njit
def mass_matrix(motion: Motion, rods: Rods, mount: Mount) -> tuple[float, float, float]:
    """(M00, M01, M02), kg m^2: how the arm's inertia feels the rods."""
    turning = mount.inertia + rods.a * motion.sin1 * motion.sin1 + rods.b * motion.sin2 * motion.sin2
    turning += 2.0 * rods.d * motion.sin1 * motion.sin2
    return turning, mount.reach * rods.e1 * motion.cos1, mount.reach * rods.e2 * motion.cos2


@njit
def arm_accelerations(
    motion: Motion, rods: Rods, terms: Terms, mount: Mount, mode: int, drive: float
) -> tuple[float, float, float]:
    """Angular accelerations (alpha0, alpha1, alpha2) of arm and rods, rad/s^2.

    Args:
        motion: angles and speeds
        rods: base parameters
        terms: what effects add
        mount: the arm, unused while it is clamped
        mode: CLAMPED (alpha0 = 0, equation (1)), FREE (a torque acts) or DRIVEN (alpha0 is prescribed)
        drive: FREE: torque tau0 on the arm, N m; DRIVEN: acceleration u of the arm, rad/s^2; CLAMPED: unused
    """
    a, b, d, e1, e2, c1, c2 = rods
    sin1, cos1, sin2, cos2 = motion.sin1, motion.cos1, motion.sin2, motion.cos2
    omega0, omega1, omega2 = motion.omega0, motion.omega1, motion.omega2
    coupling, torque1, torque2 = coupled(sin1, cos1, sin2, cos2, omega1, omega2, d, e1, e2, c1, c2)
    coupling += terms.coupling
    torque1 += terms.torque1
    torque2 += terms.torque2
    inertia1, inertia2 = a + terms.a, b + terms.b
    if mode == CLAMPED:
        alpha1, alpha2 = solved(inertia1, inertia2, coupling, torque1, torque2)
        return 0.0, alpha1, alpha2
    lever1, lever2 = (a * sin1 + d * sin2) * cos1, (b * sin2 + d * sin1) * cos2
    whirl = omega0 * omega0
    free1, free2 = solved(inertia1, inertia2, coupling, torque1 + whirl * lever1, torque2 + whirl * lever2)
    turning, cross1, cross2 = mass_matrix(motion, rods, mount)
    carried1, carried2 = solved(inertia1, inertia2, coupling, cross1, cross2)
    alpha0 = drive
    if mode == FREE:
        torque0 = drive - mount.friction * omega0 - mount.stiffness * motion.theta0
        torque0 -= 2.0 * omega0 * (lever1 * omega1 + lever2 * omega2)
        torque0 += mount.reach * (e1 * sin1 * omega1 * omega1 + e2 * sin2 * omega2 * omega2)
        alpha0 = (torque0 - cross1 * free1 - cross2 * free2) / (turning - cross1 * carried1 - cross2 * carried2)
    return alpha0, free1 - carried1 * alpha0, free2 - carried2 * alpha0
