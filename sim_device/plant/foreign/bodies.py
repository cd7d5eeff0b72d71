"""Rods with additional degrees of freedom: a bending rod, a rod that leaves the plane, a shaft loose in its bearing."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sim_device.plant.foreign.effect import OutOfLibraryEffect, Size, Values
from sim_device.plant.foreign.engine import Body, EquationOfMotion, undisturbed

State = NDArray[np.float64]

AXIAL = 0.02
"""Inertia of the outer rod about its own axis, relative to the inertia about joint 2."""

RIM_LOSS = 20.0
"""Ratio of damping to spring force of the rim, s/m. The damping is proportional to the depth, so that the force is
continuous."""

RATTLE_ERROR = 1e-6
"""Error tolerance of the integrator. It resolves a shaft that rattles at 100 Hz with an error far below an encoder
step."""


def bending_rod(body: Body, values: Values) -> EquationOfMotion:
    """Add an elastic hinge in the middle of the outer rod.

    q is the angle by which the outer half bends.

        T = T_rods + p w2 q' + r cos(t1-t2) w1 q' + i q'^2/2,    V = V_rods - h q sin t2 + q^2 / (2 C)

    The equation of motion is linearised in q. For a uniform rod p = 5b/16, i = b/8, r = d/4, h = e2/4. The encoder
    is at the inner half.
    """
    compliance, damping = values["compliance_rad_per_Nm"], values["damping_ratio"]
    if compliance == 0.0:
        return undisturbed(body)
    p, i, r, h = 5 / 16 * body.b, body.b / 8, body.d / 4, body.e2 / 4
    loss = 2 * damping * math.sqrt(i / compliance)

    def slope(t: float, x: State) -> Sequence[float]:
        t1, t2, w1, w2, q, u = x.tolist()
        sin12, cos12 = math.sin(t1 - t2), math.cos(t1 - t2)
        slide = body.c2 * (w1 - w2)
        mass = np.array(
            [[body.a, body.d * cos12, r * cos12], [body.d * cos12, body.b, p], [r * cos12, p, i]],
        )
        force = (
            body.e1 * math.sin(t1) - body.d * sin12 * w2 * w2 - r * sin12 * w2 * u - body.c1 * w1 - slide,
            body.e2 * math.sin(t2) + body.d * sin12 * w1 * w1 + r * sin12 * w1 * u + h * q * math.cos(t2) + slide,
            h * math.sin(t2) + r * sin12 * (w1 - w2) * w1 - q / compliance - loss * u,
        )
        alpha1, alpha2, alpha = np.linalg.solve(mass, force).tolist()
        return w1, w2, alpha1, alpha2, u, alpha

    return EquationOfMotion(slope, memory=(0.0, 0.0))


def wobbling_rod(body: Body, values: Values) -> EquationOfMotion:
    """Let the outer rod lean out of the plane by phi, held by a spring; it leans at the release.

    T = a w1^2/2 + b (phi'^2 + cos(phi)^2 w2^2)/2 + d w1 [cos(phi) cos(t1-t2) w2 + sin(phi) sin(t1-t2) phi']
    V = e1 cos t1 + e2 cos t2 cos phi + k phi^2/2,    k = b (2 pi f)^2

    With the spring alone it would oscillate at f; i = AXIAL b is its inertia about its own axis.
    """
    flat = (1 - AXIAL) * body.b
    stiffness = body.b * (2 * math.pi * values["frequency_hz"]) ** 2
    loss = 2 * values["damping_ratio"] * math.sqrt(stiffness * body.b)

    def slope(t: float, x: State) -> Sequence[float]:
        t1, t2, w1, w2, phi, u = x.tolist()
        sin12, cos12, s, c = math.sin(t1 - t2), math.cos(t1 - t2), math.sin(phi), math.cos(phi)
        slide = body.c2 * (w1 - w2)
        cross, lean = body.d * c * cos12, body.d * s * sin12
        mass = np.array([[body.a, cross, lean], [cross, body.b - flat * s * s, 0.0], [lean, 0.0, body.b]])
        whirl = c * sin12 * (w2 * w2 + u * u) - 2 * s * cos12 * u * w2
        force = (
            body.e1 * math.sin(t1) - body.d * whirl - body.c1 * w1 - slide,
            body.e2 * math.sin(t2) * c + 2 * flat * c * s * u * w2 + body.d * c * sin12 * w1 * w1 + slide,
            (body.e2 * math.cos(t2) - body.d * cos12 * w1 * w1 - flat * c * w2 * w2) * s - stiffness * phi - loss * u,
        )
        alpha1, alpha2, alpha = np.linalg.solve(mass, force).tolist()
        return w1, w2, alpha1, alpha2, u, alpha

    return EquationOfMotion(slope, memory=(values["start_rad"], 0.0))


def loose_bearing(body: Body, values: Values) -> EquationOfMotion:
    """Let the shaft of joint 1 move within a clearance and hit its rim.

        T = T_rods + M (x'^2 + z'^2)/2 + x' (p1 c1 w1 + p2 c2 w2) - z' (p1 s1 w1 + p2 s2 w2),    p = e / g

        V = V_rods + M g z

    If the distance of the shaft from the centre exceeds the clearance, the rim pushes it back with the force k depth (1
    + RIM_LOSS v).
    """
    clearance, stiffness = values["clearance_mm"] * 1e-3, values["rim_N_per_mm"] * 1e3
    if clearance == 0.0:
        return undisturbed(body)
    p1, p2, M = body.e1 / body.g, body.e2 / body.g, body.mass

    def slope(t: float, x: State) -> Sequence[float]:
        t1, t2, w1, w2, across, up, v_across, v_up = x.tolist()
        s1, c1, s2, c2 = math.sin(t1), math.cos(t1), math.sin(t2), math.cos(t2)
        sin12, cos12 = s1 * c2 - c1 * s2, c1 * c2 + s1 * s2
        slide = body.c2 * (w1 - w2)
        away = math.hypot(across, up)
        deep = max(0.0, away - clearance)
        push, drag = stiffness * deep / max(away, clearance), RIM_LOSS * stiffness * deep
        mass = np.array(
            [
                [body.a, body.d * cos12, p1 * c1, -p1 * s1],
                [body.d * cos12, body.b, p2 * c2, -p2 * s2],
                [p1 * c1, p2 * c2, M, 0.0],
                [-p1 * s1, -p2 * s2, 0.0, M],
            ]
        )
        force = (
            body.e1 * s1 - body.d * sin12 * w2 * w2 - body.c1 * w1 - slide,
            body.e2 * s2 + body.d * sin12 * w1 * w1 + slide,
            p1 * s1 * w1 * w1 + p2 * s2 * w2 * w2 - push * across - drag * v_across,
            p1 * c1 * w1 * w1 + p2 * c2 * w2 * w2 - M * body.g - push * up - drag * v_up,
        )
        return w1, w2, *_ordered(np.linalg.solve(mass, force).tolist(), v_across, v_up)

    return EquationOfMotion(slope, memory=(0.0, -clearance - M * body.g / stiffness, 0.0, 0.0), error=RATTLE_ERROR)


def _ordered(alphas: list[float], v_across: float, v_up: float) -> tuple[float, ...]:
    alpha1, alpha2, a_across, a_up = alphas
    return alpha1, alpha2, v_across, v_up, a_across, a_up


BODIES = (
    OutOfLibraryEffect(
        "bending_rod",
        "the outer rod bends",
        Size("compliance_rad_per_Nm", 0.1, 0.5),
        shape=(Size("damping_ratio", 0.02, 0.1),),
        motion=bending_rod,
    ),
    OutOfLibraryEffect(
        "wobbling_rod",
        "the outer rod leaves the plane",
        Size("start_rad", 0.05, 0.2),
        most=0.5,
        shape=(Size("frequency_hz", 3.0, 6.0), Size("damping_ratio", 0.01, 0.05)),
        motion=wobbling_rod,
        held_back=True,
    ),
    OutOfLibraryEffect(
        "loose_bearing",
        "the shaft of joint 1 rattles in its bearing",
        Size("clearance_mm", 0.2, 1.0),
        shape=(Size("rim_N_per_mm", 15.0, 40.0),),
        motion=loose_bearing,
    ),
)
