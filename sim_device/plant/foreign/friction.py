"""Coulomb, load-dependent and presliding friction in forms that the library does not contain."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.coulomb import COULOMB
from dpr_lab.effects.friction_curve import FRICTION_CURVE
from dpr_lab.effects.friction_drift import FRICTION_DRIFT
from dpr_lab.effects.hysteresis import HYSTERESIS
from dpr_lab.effects.load_friction import LOAD_FRICTION
from dpr_lab.effects.stribeck import STRIBECK
from sim_device.plant.foreign.effect import OutOfLibraryEffect, Size, Values
from sim_device.plant.foreign.engine import Body, EquationOfMotion, at_joint1, at_joint2, sticking, under

DRY_JOINT1, DRY_JOINT2 = zip(COULOMB, STRIBECK, FRICTION_CURVE, HYSTERESIS, strict=True)


def asymmetric_joint1(body: Body, values: Values) -> EquationOfMotion:
    """Add Coulomb friction that is larger in one direction.

    tau1 = -F s (1 + A s) with s = (2/pi) atan(omega1 / v).
    """
    force, asymmetry, speed = values["torque_Nm"], values["asymmetry"], values["speed_rad_per_s"]

    def torque(angle: float, omega: float) -> float:
        direction = 2 / math.pi * math.atan(omega / speed)
        return -force * direction * (1 + asymmetry * direction)

    return under(body, at_joint1(torque))


def rounded_joint2(body: Body, values: Values) -> EquationOfMotion:
    """Add Coulomb friction that is rounded algebraically: tau2 = -F w / sqrt(w^2 + v^2), w = omega2 - omega1."""
    force, speed = values["torque_Nm"], values["speed_rad_per_s"]
    return under(body, at_joint2(lambda angle, omega: -force * omega / math.hypot(omega, speed)))


def lorentzian_stribeck_joint1(body: Body, values: Values) -> EquationOfMotion:
    """Add friction that decreases with speed as a Lorentzian: tau1 = -F (1 + R / (1 + (w/v)^2)) sgn(w).

    The joint sticks at rest.
    """
    force, rise, speed = values["torque_Nm"], values["rise"], values["speed_rad_per_s"]

    return sticking(body, 1, lambda x: force * (1 + rise / (1 + (float(x[2]) / speed) ** 2)))


def root_joint2(body: Body, values: Values) -> EquationOfMotion:
    """Add friction proportional to the root of the speed, smooth at rest: tau2 = -K w / (w^2 + 0.05^2)^(1/4)."""
    size = values["torque_at_1rad_per_s_Nm"]
    return under(body, at_joint2(lambda angle, omega: -size * omega / (omega * omega + 0.0025) ** 0.25))


def lugre_joint2(body: Body, values: Values) -> EquationOfMotion:
    """Add LuGre friction (elastic bristles) without damping of the bristles.

        z' = w - |w| z / (Z g(w)),    tau2 = -F z / Z,    g = 1 + R exp(-(w/v)^2),    w = omega2 - omega1

    z / Z stays within +-(1 + R). Over a closed cycle the bristles only dissipate energy.

    Source: Canudas de Wit, Olsson, Astrom & Lischinsky (1995), A new model for control of systems with friction, IEEE
    Transactions on Automatic Control 40(3), 419-425.
    """
    force, stroke = values["torque_Nm"], values["stroke_rad"]
    rise, speed = values["rise"], values["speed_rad_per_s"]

    def slope(t: float, x: NDArray[np.float64]) -> Sequence[float]:
        theta1, theta2, omega1, omega2, bent = x.tolist()
        omega = omega2 - omega1
        tau = -force * bent
        alphas = body.accelerations(theta1, theta2, omega1, omega2, -tau, tau)
        grip = 1 + rise * math.exp(-((omega / speed) ** 2))
        return omega1, omega2, *alphas, (omega - abs(omega) * bent / grip) / stroke

    return EquationOfMotion(slope, memory=(0.0,))


def joint_force(
    body: Body, moment: float, mass: float, theta1: float, theta2: float, omega1: float, omega2: float
) -> float:
    """Compute the force on a joint that supports `mass`, N.

    `moment` is the first moment of the part that rotates with the inner rod, kg m. The force follows from the
    accelerations without friction, because friction is smaller by orders of magnitude.
    """
    alpha1, alpha2 = body.accelerations(theta1, theta2, omega1, omega2)
    sin1, cos1, sin2, cos2 = math.sin(theta1), math.cos(theta1), math.sin(theta2), math.cos(theta2)
    outer = body.e2 / body.g
    across = moment * (cos1 * alpha1 - sin1 * omega1**2) + outer * (cos2 * alpha2 - sin2 * omega2**2)
    up = mass * body.g - moment * (sin1 * alpha1 + cos1 * omega1**2) - outer * (sin2 * alpha2 + cos2 * omega2**2)
    return math.hypot(across, up)


def hertzian_joint1(body: Body, values: Values) -> EquationOfMotion:
    """Add rolling friction with Hertzian contact: tau1 = -K (|F| / 1 N)^(4/3) sgn(omega1), F the force on joint 1."""
    size, moment = values["torque_at_1N_Nm"], body.e1 / body.g

    return sticking(body, 1, lambda x: size * joint_force(body, moment, body.mass, *x.tolist()) ** (4 / 3))


def plastic_load_joint2(body: Body, values: Values) -> EquationOfMotion:
    """Add the friction of a plastic bush by its contact area: tau2 = -K (|F| / 1 N)^(2/3) sgn(w).

    F is the force on joint 2 and w the speed of the joint. The joint sticks at rest.

    Source: Bowden & Tabor (1950), The friction and lubrication of solids, on contacts that yield elastically.
    """
    size, moment = values["torque_at_1N_Nm"], body.outer_mass * body.L1

    return sticking(body, 2, lambda x: size * joint_force(body, moment, body.outer_mass, *x.tolist()) ** (2 / 3))


def warming_joint1(body: Body, values: Values) -> EquationOfMotion:
    """Add grease that warms up to a constant temperature: tau1 = C (1 - exp(-t / T)) omega1, in addition to c1."""
    size, lasts = values["damping_Nms_per_rad"], values["lasts_s"]

    def torques(t: float, theta1: float, theta2: float, omega1: float, omega2: float) -> tuple[float, float]:
        return size * (1 - math.exp(-max(t, 0.0) / lasts)) * omega1, 0.0

    return under(body, torques)


def seizing_joint2(body: Body, values: Values) -> EquationOfMotion:
    """Add a seal that becomes dry in a short time: tau2 = -C w (1 + tanh((t - t0) / T)) / 2, w = omega2 - omega1."""
    size, begin_s, lasts = values["damping_Nms_per_rad"], values["at_s"], values["lasts_s"]

    def torques(t: float, theta1: float, theta2: float, omega1: float, omega2: float) -> tuple[float, float]:
        tau = -size * (omega2 - omega1) * (1 + math.tanh((t - begin_s) / lasts)) / 2
        return -tau, tau

    return under(body, torques)


FRICTION = (
    OutOfLibraryEffect(
        "asymmetric_friction_joint1",
        "Coulomb friction of joint 1, stronger in one direction",
        Size("torque_Nm", 1e-3, 3e-3),
        shape=(Size("asymmetry", 0.15, 0.4), Size("speed_rad_per_s", 0.05, 0.3)),
        motion=asymmetric_joint1,
        dissipative=True,
        family=DRY_JOINT1,
    ),
    OutOfLibraryEffect(
        "rounded_friction_joint2",
        "Coulomb friction of joint 2, rounded at rest",
        Size("torque_Nm", 3e-4, 1e-3),
        shape=(Size("speed_rad_per_s", 0.2, 1.0),),
        motion=rounded_joint2,
        dissipative=True,
        family=DRY_JOINT2,
        held_back=True,
    ),
    OutOfLibraryEffect(
        "lorentzian_stribeck_joint1",
        "friction of joint 1 that falls with speed",
        Size("torque_Nm", 1e-3, 3e-3),
        shape=(Size("rise", 0.5, 2.0), Size("speed_rad_per_s", 0.5, 2.0)),
        motion=lorentzian_stribeck_joint1,
        dissipative=True,
        family=DRY_JOINT1,
        held_back=True,
    ),
    OutOfLibraryEffect(
        "root_friction_joint2",
        "friction of joint 2 that increases with the square root of speed",
        Size("torque_at_1rad_per_s_Nm", 3e-4, 1e-3),
        motion=root_joint2,
        dissipative=True,
        family=DRY_JOINT2,
    ),
    OutOfLibraryEffect(
        "lugre_friction_joint2",
        "bristles between the rods that bend before they slip",
        Size("torque_Nm", 3e-4, 1e-3),
        shape=(Size("stroke_rad", 0.02, 0.2), Size("rise", 0.1, 0.5), Size("speed_rad_per_s", 0.3, 1.0)),
        motion=lugre_joint2,
        family=DRY_JOINT2,
    ),
    OutOfLibraryEffect(
        "hertzian_load_friction_joint1",
        "rolling friction of joint 1, proportional to the 4/3 power of its load",
        Size("torque_at_1N_Nm", 5e-5, 3e-4),
        motion=hertzian_joint1,
        dissipative=True,
        family=LOAD_FRICTION[:1],
        held_back=True,
    ),
    OutOfLibraryEffect(
        "plastic_load_friction_joint2",
        "friction of a plastic bush in joint 2, proportional to the 2/3 power of its load",
        Size("torque_at_1N_Nm", 5e-5, 3e-4),
        motion=plastic_load_joint2,
        dissipative=True,
        family=LOAD_FRICTION[1:],
    ),
    OutOfLibraryEffect(
        "warming_friction_joint1",
        "viscous friction of joint 1 that decreases while its grease warms up",
        Size("damping_Nms_per_rad", 5e-5, 2e-4),
        shape=(Size("lasts_s", 2.0, 6.0),),
        motion=warming_joint1,
        family=FRICTION_DRIFT[:1],
    ),
    OutOfLibraryEffect(
        "seizing_friction_joint2",
        "friction of joint 2 that increases within a few seconds, as of a dry seal",
        Size("damping_Nms_per_rad", 2e-5, 1e-4),
        shape=(Size("at_s", 2.0, 5.0), Size("lasts_s", 0.5, 2.0)),
        motion=seizing_joint2,
        dissipative=True,
        family=FRICTION_DRIFT[1:],
        held_back=True,
    ),
)
