"""Air drag, springs and detents in forms that the library does not contain."""

import math

import numpy as np

from dpr_lab.effects.air_drag import AIR_DRAG_BOTH, AIR_DRAG_OUTER
from dpr_lab.effects.detent import DETENT_JOINT1, DETENT_JOINT2
from dpr_lab.effects.spring import SPRING
from sim_device.plant.foreign.effect import OutOfLibraryEffect, Size, Values
from sim_device.plant.foreign.engine import Body, EquationOfMotion, at_joint1, at_joint2, under

_NODES, _WEIGHTS = (array.tolist() for array in np.polynomial.legendre.leggauss(6))


def drag_on_outer_rod(
    body: Body,
    size: float,
    exponent: float,
    theta1: float,
    theta2: float,
    omega1: float,
    omega2: float,
    wind: float = 0.0,
) -> tuple[float, float]:
    """Compute the torques on theta1 and theta2 by drag on the outer rod, N m.

    The drag is K |v|^(n-1) v per metre, with the speed v of the rod through the air, m/s. With v(s) = L1 omega1
    cos(theta1 - theta2) + s omega2 - wind, the torques are the integrals over s of the drag times dv/domega, by Gauss'
    rule on six nodes.
    """
    lever = body.L1 * math.cos(theta1 - theta2)
    tau1 = tau2 = 0.0
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        s = body.L2 * (1 + node) / 2
        v = lever * omega1 + s * omega2 - wind
        drag = -size * abs(v) ** (exponent - 1) * v * weight * body.L2 / 2
        tau1 += drag * lever
        tau2 += drag * s
    return tau1, tau2


def power_drag_outer(body: Body, values: Values) -> EquationOfMotion:
    """Add drag of the outer rod with an exponent of the speed other than two."""
    size, exponent = values["drag_N_per_m"], values["exponent"]

    def torques(t: float, theta1: float, theta2: float, omega1: float, omega2: float) -> tuple[float, float]:
        return drag_on_outer_rod(body, size, exponent, theta1, theta2, omega1, omega2)

    return under(body, torques)


def tip_drag_outer(body: Body, values: Values) -> EquationOfMotion:
    """Add quadratic drag of a wide body at the tip of the outer rod: F = -K |v| v, with the velocity v of the tip."""
    size = values["drag_N_s2_per_m2"]

    def torques(t: float, theta1: float, theta2: float, omega1: float, omega2: float) -> tuple[float, float]:
        inner, outer = body.L1 * omega1, body.L2 * omega2
        meet = math.cos(theta1 - theta2)
        speed = math.sqrt(max(inner * inner + outer * outer + 2 * inner * outer * meet, 0.0))
        return (
            -size * speed * body.L1 * (inner + outer * meet),
            -size * speed * body.L2 * (outer + inner * meet),
        )

    return under(body, torques)


def softening_spring_joint1(body: Body, values: Values) -> EquationOfMotion:
    """Add a cable that softens: tau1 = -T tanh((q - q0) / Q), q the angle from the hanging position."""
    torque, width, rest = values["torque_Nm"], values["width_rad"], values["rest_rad"]
    return under(body, at_joint1(lambda angle, omega: -torque * math.tanh((angle - rest) / width)))


def hardening_spring_joint2(body: Body, values: Values) -> EquationOfMotion:
    """Add a cable that stiffens as it winds up: tau2 = -K q sqrt(1 + (q / Q)^2), q the relative angle."""
    stiffness, width = values["stiffness_Nm_per_rad"], values["width_rad"]
    return under(body, at_joint2(lambda angle, omega: -stiffness * angle * math.hypot(1.0, angle / width)))


def loose_spring_joint2(body: Body, values: Values) -> EquationOfMotion:
    """Add a loop of cable with slack on both sides: tau2 = -K (|q| - Q) sign(q) for |q| > Q.

    q is the relative angle.
    """
    stiffness, slack = values["stiffness_Nm_per_rad"], values["slack_rad"]
    return under(body, at_joint2(lambda angle, omega: -stiffness * math.copysign(max(abs(angle) - slack, 0.0), angle)))


def slack_spring_joint1(body: Body, values: Values) -> EquationOfMotion:
    """Add a cable that pulls only when it is taut: tau1 = -K (q - q0) for q > q0, q from the hanging position."""
    stiffness, taut = values["stiffness_Nm_per_rad"], values["taut_rad"]
    return under(body, at_joint1(lambda angle, omega: -stiffness * max(angle - taut, 0.0)))


def sawtooth_detent_joint1(body: Body, values: Values) -> EquationOfMotion:
    """Add a detent torque with an asymmetric waveform: tau1 = -A atan2(S sin u, 1 + S cos u), u = N (q - q0)."""
    size, lean = values["torque_Nm"], values["lean"]
    number, start = round(values["number"]), values["start_rad"]

    def torque(angle: float, omega: float) -> float:
        u = number * (angle - start)
        return -size * math.atan2(lean * math.sin(u), 1 + lean * math.cos(u))

    return under(body, at_joint1(torque))


def narrow_detent_joint2(body: Body, values: Values) -> EquationOfMotion:
    """Add narrow detents: tau2 = -A sin(u) exp(K (cos(u) - 1)), u = N (q - q0), q the relative angle."""
    size, narrow = values["torque_Nm"], values["narrowness"]
    number, start = round(values["number"]), values["start_rad"]

    def torque(angle: float, omega: float) -> float:
        u = number * (angle - start)
        return -size * math.sin(u) * math.exp(narrow * (math.cos(u) - 1))

    return under(body, at_joint2(torque))


TORQUES = (
    OutOfLibraryEffect(
        "power_drag_outer",
        "air drag of the outer rod, proportional to speed to the power 1.6 to 1.8",
        Size("drag_N_per_m", 2e-3, 1e-2),
        shape=(Size("exponent", 1.6, 1.8),),
        motion=power_drag_outer,
        dissipative=True,
        family=(AIR_DRAG_OUTER, AIR_DRAG_BOTH),
    ),
    OutOfLibraryEffect(
        "tip_drag_outer",
        "air drag of a wide plate at the tip of the outer rod",
        Size("drag_N_s2_per_m2", 5e-4, 2e-3),
        motion=tip_drag_outer,
        dissipative=True,
        family=(AIR_DRAG_OUTER, AIR_DRAG_BOTH),
        held_back=True,
    ),
    OutOfLibraryEffect(
        "softening_spring_joint1",
        "a cable on joint 1 that gives way",
        Size("torque_Nm", 2e-3, 1e-2),
        shape=(Size("width_rad", 1.5, 3.0), Size("rest_rad", -0.5, 0.5)),
        motion=softening_spring_joint1,
        family=SPRING[:1],
        held_back=True,
    ),
    OutOfLibraryEffect(
        "hardening_spring_joint2",
        "a cable on joint 2 that winds up",
        Size("stiffness_Nm_per_rad", 1e-4, 1e-3),
        shape=(Size("width_rad", 4.0, 10.0),),
        motion=hardening_spring_joint2,
        family=SPRING[1:],
    ),
    OutOfLibraryEffect(
        "loose_spring_joint2",
        "a loop of cable on joint 2 with slack",
        Size("stiffness_Nm_per_rad", 1e-4, 1e-3),
        shape=(Size("slack_rad", 0.2, 0.6),),
        motion=loose_spring_joint2,
        family=SPRING[1:],
        held_back=True,
    ),
    OutOfLibraryEffect(
        "slack_spring_joint1",
        "a cable on joint 1 that pulls on one side only",
        Size("stiffness_Nm_per_rad", 1e-3, 1e-2),
        shape=(Size("taut_rad", -1.5, -0.3),),
        motion=slack_spring_joint1,
        family=SPRING[:1],
    ),
    OutOfLibraryEffect(
        "sawtooth_detent_joint1",
        "magnetic detents of joint 1 with an asymmetric wave",
        Size("torque_Nm", 1e-3, 4e-3),
        shape=(Size("lean", 0.5, 0.8), Size("number", 4, 12), Size("start_rad", -0.4, 0.4)),
        motion=sawtooth_detent_joint1,
        family=(DETENT_JOINT1,),
    ),
    OutOfLibraryEffect(
        "narrow_detent_joint2",
        "narrow magnetic detents of joint 2",
        Size("torque_Nm", 5e-4, 2e-3),
        shape=(Size("narrowness", 0.5, 1.5), Size("number", 4, 12), Size("start_rad", -0.4, 0.4)),
        motion=narrow_detent_joint2,
        family=(DETENT_JOINT2,),
        held_back=True,
    ),
)
