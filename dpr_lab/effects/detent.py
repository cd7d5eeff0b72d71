"""Cogging (detent torque): the magnets of a motor pull a joint towards evenly spaced angles."""

import math
from dataclasses import replace

from dpr_lab.effects.at_arm import at_arm
from dpr_lab.effects.effect import BenchQuantity, EffectParameter, Params, Words, pair, shape
from dpr_lab.effects.elementary import sincos
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import inlined


@inlined
def cogging(joint: Joint, cos1_Nm: float, sin1_Nm: float, cos2_Nm: float, sin2_Nm: float, order: float) -> float:
    """Return the cogging torque on the following rod, N m.

    The torque is the sum of the harmonics of the orders N and 2 N, where N is `order`.
    """
    phase = order * joint.angle
    sin, cos = sincos(phase)
    first = cos1_Nm * cos + sin1_Nm * sin
    return first + cos2_Nm * (cos * cos - sin * sin) + sin2_Nm * 2.0 * sin * cos


def harmonics(params: Params) -> Words:
    """Return the amplitude, order and phase of both harmonics.

    A cos(N q) + B sin(N q) = sqrt(A^2 + B^2) sin(N q + atan2(A, B))
    """
    waves = [(k, params.get(f"cos{k}_Nm", 0.0), params.get(f"sin{k}_Nm", 0.0)) for k in (1, 2)]
    return {"cogging": [(math.hypot(A, B), k * params["order"], math.atan2(A, B)) for k, A, B in waves if A or B]}


_JOINT1, DETENT_JOINT2 = pair(
    "detent",
    words="torque periodic in the angle (cogging or a magnet), joint {j}",
    kernel=cogging,
    exported=harmonics,
    equation="tau = A1 cos(N q) + B1 sin(N q) + A2 cos(2 N q) + B2 sin(2 N q) with q the angle of joint {j}",
    parameters=(
        EffectParameter("cos1_Nm", "N m", 1e-3),
        EffectParameter("sin1_Nm", "N m", 1e-3),
        EffectParameter("cos2_Nm", "N m", 3e-4),
        EffectParameter("sin2_Nm", "N m", 3e-4),
        shape("order", "1", 12.0, tuple(float(order) for order in range(1, 41)), draw=(3.0, 24.0), whole=True),
    ),
    stage="torque",
    potential=True,
    quantities=(BenchQuantity("peak cogging torque, first harmonic", "A1", ("cos1_Nm", "sin1_Nm")),),
    symptom=(
        "The rod rests at one of several evenly spaced angles of joint {j}; the period of small swings depends on"
        " the angle about which they occur."
    ),
    bench_check=(
        "Turn joint {j} slowly by hand with the rod balanced: cogging is felt at evenly spaced angles."
        " Remove the motor and repeat: cogging vanishes, an offset of the centre of mass remains."
    ),
    source="Hanselman (2003), Brushless Permanent Magnet Motor Design, ch. 9 (cogging torque).",
)

DETENT_JOINT1 = replace(
    _JOINT1,
    twins=("com_offset_link1",),
    parameters=tuple(
        replace(parameter, scan=tuple(order for order in parameter.scan if order > 1))
        for parameter in _JOINT1.parameters
    ),
)
"""Cogging torque of joint 1; the scan contains only orders above one.

A torque of order one at joint 1 is indistinguishable from other effects: its sine acts like gravity, and its cosine
like an offset of the centre of mass of the inner rod.
"""

DETENT_JOINT0 = at_arm(
    DETENT_JOINT2,
    symptom="The arm rests at evenly spaced angles, and moves in steps if the input rises slowly.",
    bench_check=(
        "Disconnect the motor and turn the arm slowly by hand: cogging is felt at evenly spaced angles of the"
        " motor's shaft; with a gear, they are closer together at the arm."
    ),
)
