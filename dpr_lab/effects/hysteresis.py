"""Presliding: before it slides, a bearing or a cable gives way like a spring (Dahl)."""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import EffectParameter, shape
from dpr_lab.effects.joints import pair
from dpr_lab.effects.quantities import Joint
from dpr_lab.kernels import njit


@njit
def gripped(grip: float, slip: float, length: float) -> float:
    r"""Presliding after a turn of `slip` one way: the exact solution of Dahl's equation, stable for any step.

        dz/dx = (1 - z sgn(dx)) / length    =>    z = s + (z_0 - s) exp(-|slip| / length),    s = sgn(slip)

    Args:
        grip: z_0, -1 to 1
        slip: turn since z_0, rad
        length: turn over which the joint starts to slide, rad
    """
    side = 1.0 if slip > 0.0 else -1.0
    return side + (grip - side) * math.exp(-abs(slip) / length)


@njit
def dahl(joint: Joint, vector: NDArray[np.float64], at: int) -> float:
    """Torque -F z on the rod beyond the joint, N m; F = vector[at], length = vector[at + 1]."""
    return -vector[at] * gripped(joint.grip, joint.slip, vector[at + 1])


HYSTERESIS = pair(
    dahl,
    "hysteresis",
    nested=("coulomb",),
    twins=("coulomb",),
    equation="tau = -F z, dz/dx = (1 - z sgn(dx)) / length with x the angle of joint {j}",
    parameters=(
        EffectParameter("torque_Nm", "N m", 5e-4, "positive"),
        shape("length_rad", "rad", 0.03, (0.01, 0.03, 0.1, 0.3)),
    ),
    stage="torque",
    dissipative=True,
    bench_check=(
        "Record the last small swings until joint {j} rests: with presliding the frequency rises as they shrink and"
        " the rod still rings before it stops; push it lightly at rest and it springs back."
    ),
    source="Dahl (1968), A solid friction model, Aerospace Corporation TOR-0158(3107-18)-1, with exponent 1.",
)
