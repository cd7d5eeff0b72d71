"""Dry (Coulomb) friction in the two rod joints."""

import math

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Effect, EffectParameter
from dpr_lab.kernels import njit

SMOOTHING = 0.02
"""Speed v_s below which the friction fades linearly, rad/s: far below any swing, and still smooth for a 1 ms step."""

_SOURCE = (
    "Armstrong-Helouvry, Dupont & Canudas de Wit (1994), A survey of models, analysis tools and compensation methods"
    " for the control of machines with friction, Automatica 30(7), 1083-1138; the tanh instead of the jump is ours."
)


@njit
def joint1_torques(
    theta1: float, theta2: float, omega1: float, omega2: float, vector: NDArray[np.float64], at: int
) -> tuple[float, float]:
    """Torques of dry friction between arm and inner rod, N m.

        tau1 = -F tanh(omega1 / v_s),    tau2 = 0,    F = vector[at]

    Args:
        theta1: angle of the inner rod, rad (unused)
        theta2: angle of the outer rod, rad (unused)
        omega1: speed of the inner rod, rad/s
        omega2: speed of the outer rod, rad/s (unused)
        vector: (size,) parameters of all effects, SI
        at: place of F
    """
    friction = vector[at]
    if friction == 0.0:
        return 0.0, 0.0
    return -friction * math.tanh(omega1 / SMOOTHING), 0.0


@njit
def joint2_torques(
    theta1: float, theta2: float, omega1: float, omega2: float, vector: NDArray[np.float64], at: int
) -> tuple[float, float]:
    """Torques of dry friction between inner and outer rod, N m; the inner rod feels the reaction.

        tau2 = -F tanh((omega2 - omega1) / v_s),    tau1 = -tau2,    F = vector[at]

    Args:
        theta1: angle of the inner rod, rad (unused)
        theta2: angle of the outer rod, rad (unused)
        omega1: speed of the inner rod, rad/s
        omega2: speed of the outer rod, rad/s
        vector: (size,) parameters of all effects, SI
        at: place of F
    """
    friction = vector[at]
    if friction == 0.0:
        return 0.0, 0.0
    torque = friction * math.tanh((omega2 - omega1) / SMOOTHING)
    return torque, -torque


COULOMB_JOINT1 = Effect(
    name="coulomb_joint1",
    site="joint1",
    parameters=(EffectParameter("torque_Nm", "N m", 1e-3, "positive"),),
    kernel=joint1_torques,
    dissipative=True,
    twins=("coulomb_joint2",),
    bench_check=(
        "Swing the inner rod alone by a few degrees: under dry friction the peaks fall along a straight line and the"
        " rod stops away from the vertical; viscous friction gives a decaying exponential."
    ),
    source=_SOURCE,
)

COULOMB_JOINT2 = Effect(
    name="coulomb_joint2",
    site="joint2",
    parameters=(EffectParameter("torque_Nm", "N m", 5e-4, "positive"),),
    kernel=joint2_torques,
    dissipative=True,
    twins=("coulomb_joint1",),
    bench_check=(
        "Clamp the inner rod and swing the outer one by a few degrees: under dry friction the peaks fall along a"
        " straight line and the rod stops away from the vertical."
    ),
    source=_SOURCE,
)
