"""Base vibration: horizontal acceleration of the base at one frequency."""

import math

from dpr_lab.effects.effect import BenchQuantity, Effect, EffectParameter, shape
from dpr_lab.effects.elementary import sincos
from dpr_lab.effects.quantities import BaseParameters, Motion, RigConstants, Terms, torques
from dpr_lab.kernels import inlined


@inlined
def shaken(
    motion: Motion,
    base: BaseParameters,
    constants: RigConstants,
    cos_m_per_s2: float,
    sin_m_per_s2: float,
    frequency_hz: float,
) -> Terms:
    """Return the torques -(e_i / g) cos(theta_i) u(t) of a base acceleration u, N m.

    The unit of u is m/s^2.
    """
    phase = 2.0 * math.pi * frequency_hz * motion.t
    sine, cosine = sincos(phase)
    shake = (cos_m_per_s2 * cosine + sin_m_per_s2 * sine) / constants.g
    return torques(-base.e1 * motion.cos1 * shake, -base.e2 * motion.cos2 * shake)


BASE_VIBRATION = Effect(
    name="base_vibration",
    words="base vibration",
    equation=(
        "tau_i = -(e_i / g) cos(theta_i) u, u = A cos(2 pi f t) + B sin(2 pi f t), with t the time since the release"
    ),
    parameters=(
        EffectParameter("cos_m_per_s2", "m/s^2", 0.2),
        EffectParameter("sin_m_per_s2", "m/s^2", 0.2),
        shape(
            "frequency_hz",
            "Hz",
            10.0,
            tuple(round(10.0 ** (k / 60.0), 4) for k in range(0, 97)),
            draw=(2.0, 20.0),
            continuous=True,
        ),
    ),
    site="base",
    stage="torque",
    kernel=shaken,
    quantities=(BenchQuantity("peak acceleration of the base", "A", ("cos_m_per_s2", "sin_m_per_s2")),),
    symptom=(
        "Both rods oscillate at one frequency that does not depend on the swing; it is also visible while they hang"
        " at rest."
    ),
    bench_check=(
        "Put the accelerometer of a phone on the base and look for a peak in the spectrum. Switch off machines"
        " nearby (fans, pumps), or put the rig on the floor, and repeat. In a film, follow a fixed point of the"
        " background as well: if it moves, the camera moves."
    ),
    source="Pendulum with a moved pivot: Landau & Lifshitz, Mechanics, sec. 5, problem 3.",
)
