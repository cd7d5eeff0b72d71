"""An arm that gives: its brake or servo holds it like a spring with damping, and the rods shake it."""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Effect, EffectParameter, shape
from dpr_lab.effects.quantities import Known, Mount
from dpr_lab.kernels import njit


@njit
def compliant(known: Known, vector: NDArray[np.float64], at: int) -> Mount:
    """The arm of the whole rig's equation: A = L0^2 / coupling, k0 = A w^2, c0 = 2 zeta A w, w = 2 pi f."""
    inertia = known.L0 * known.L0 / vector[at]
    speed = 2.0 * math.pi * vector[at + 1]
    return Mount(inertia, known.L0 / known.g, 2.0 * vector[at + 2] * inertia * speed, inertia * speed * speed)


ARM_COMPLIANCE = Effect(
    name="arm_compliance",
    equation=(
        "the three-coordinate equation of `dpr_lab.dynamics.arm` with theta0 on a spring: A = L0^2 / coupling (inertia"
        " of the arm with all masses at its tip), k0 = A (2 pi f)^2, c0 = 2 zeta A 2 pi f; held fast before the release"
    ),
    parameters=(
        EffectParameter("coupling_per_kg", "1/kg", 0.1, "positive"),
        shape("frequency_hz", "Hz", 8.0, tuple(round(2.0 * 15.0 ** (k / 48.0), 4) for k in range(49))),
        shape("damping_ratio", "1", 0.05, (0.02, 0.05, 0.12, 0.3)),
    ),
    site="base",
    stage="arm",
    kernel=compliant,
    bench_check=(
        "Read the arm's encoder while the rods swing, clamp the arm to the table and repeat; tap the arm with the rods"
        " at rest and look for its frequency."
    ),
    source="Lagrange's equations of the whole rig, `dpr_lab.dynamics.arm`.",
)
