"""What an effect is: a physical cause of a difference between simulation and rig, as data and one kernel."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Torques = Callable[[float, float, float, float, NDArray[np.float64], int], tuple[float, float]]
"""Kernel of an effect: (theta1, theta2, omega1, omega2, vector, at) -> (tau1, tau2).

Angles are absolute (0 = upright, pi = hanging, rad), speeds absolute (rad/s). tau1, tau2 are the generalised torques on
the coordinates theta1 and theta2, N m: a torque tau of rod 1 on rod 2 at joint 2 is (-tau, +tau). `vector` holds the
parameters of all effects and `at` the place of this effect's first one.
"""


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """One coefficient; zero switches the effect off."""

    name: str
    unit: str
    typical: float
    """Size met on a laboratory rig, in `unit`."""
    sign: Literal["positive", "any"]


@dataclass(frozen=True, slots=True)
class Effect:
    """One physical effect."""

    name: str
    site: Literal["joint1", "joint2"]
    """Where it acts."""
    parameters: tuple[EffectParameter, ...]
    kernel: Torques
    dissipative: bool
    """Whether it can only take energy out."""
    twins: tuple[str, ...]
    """Effects that a recording tells apart from this one only with difficulty."""
    bench_check: str
    """What to do at the rig to confirm it or rule it out."""
    source: str
