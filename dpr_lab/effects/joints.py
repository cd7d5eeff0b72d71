"""One law of friction or elasticity for either joint: a torque from the joint's own angle, speed, grip and load."""

import math
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Effect
from dpr_lab.effects.quantities import Joint, Known, Motion, Rods, Terms, torques

Law = Callable[[Joint, NDArray[np.float64], int], float]
"""(joint, vector, at) -> torque on the rod beyond the joint, N m."""


# Closures, which the disk cache cannot recognise again; the kernels that call them are cached with their code inside.
def _at_joint1(law: Any) -> Callable[..., Terms]:
    @numba.njit(error_model="numpy", nogil=True)
    def kernel(motion: Motion, rods: Rods, known: Known, vector: NDArray[np.float64], at: int) -> Terms:
        angle = motion.theta1 - math.pi
        joint = Joint(motion.t, angle, motion.omega1, motion.grip1, motion.slip1, motion.force1)
        return torques(law(joint, vector, at), 0.0)

    return kernel


def _at_joint2(law: Any) -> Callable[..., Terms]:
    @numba.njit(error_model="numpy", nogil=True)
    def kernel(motion: Motion, rods: Rods, known: Known, vector: NDArray[np.float64], at: int) -> Terms:
        angle, speed = motion.theta2 - motion.theta1, motion.omega2 - motion.omega1
        torque = law(Joint(motion.t, angle, speed, motion.grip2, motion.slip2, motion.force2), vector, at)
        return torques(-torque, torque)

    return kernel


def pair(
    law: Law,
    family: str,
    *,
    equation: str,
    bench_check: str,
    nested: tuple[str, ...] = (),
    twins: tuple[str, ...] = (),
    **fields: Any,
) -> list[Effect]:
    """The same law in both joints: FAMILY_joint1 and FAMILY_joint2.

    Args:
        law: the torque
        family: name without the joint
        equation: {j} in it stands for the number of the joint
        bench_check: likewise
        nested: families of simpler effects in the same joint
        twins: families of effects in the same joint that look alike
        fields: the other fields of `Effect`
    """
    return [
        Effect(
            name=f"{family}_joint{j}",
            kernel=kernel(law),
            nested=tuple(f"{name}_joint{j}" for name in nested),
            twins=tuple(f"{name}_joint{j}" for name in twins),
            site="joint torque",
            equation=equation.replace("{j}", str(j)),
            bench_check=bench_check.replace("{j}", str(j)),
            **fields,
        )
        for j, kernel in ((1, _at_joint1), (2, _at_joint2))
    ]
