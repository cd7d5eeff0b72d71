"""A table that shakes: horizontal acceleration of the base at one frequency."""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Effect, EffectParameter, shape
from dpr_lab.effects.quantities import Known, Motion, Rods, Terms, torques
from dpr_lab.kernels import njit


@njit
def shaken(motion: Motion, rods: Rods, known: Known, vector: NDArray[np.float64], at: int) -> Terms:
    """tau_i = -(e_i / g) cos(theta_i) u(t); u of amplitudes vector[at], vector[at + 1], m/s^2."""
    phase = 2.0 * math.pi * vector[at + 2] * motion.t
    shake = (vector[at] * math.cos(phase) + vector[at + 1] * math.sin(phase)) / known.g
    return torques(-rods.e1 * motion.cos1 * shake, -rods.e2 * motion.cos2 * shake)


BASE_VIBRATION = Effect(
    name="base_vibration",
    equation=("tau_i = -(e_i / g) cos(theta_i) u, u = A cos(2 pi f t) + B sin(2 pi f t), t the time since the release"),
    parameters=(
        EffectParameter("cos_m_per_s2", "m/s^2", 0.2),
        EffectParameter("sin_m_per_s2", "m/s^2", 0.2),
        shape("frequency_hz", "Hz", 10.0, tuple(round(10.0 ** (k / 60.0), 4) for k in range(0, 97))),
    ),
    site="base",
    stage="torque",
    kernel=shaken,
    bench_check=(
        "Put a phone's accelerometer on the base and look for the line in its spectrum; switch off what runs nearby"
        " (fans, pumps), or put the rig on the floor, and repeat."
    ),
    source="Pendulum with a moved pivot: Landau & Lifshitz, Mechanics, sec. 5, problem 3.",
)
