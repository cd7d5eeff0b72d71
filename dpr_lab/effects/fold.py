"""All effects as one compiled torque: a zero coefficient switches an effect off, nothing is recompiled."""

from collections.abc import Callable, Iterable

import numba
import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.effect import Effect, Torques

FoldedTorques = Callable[[float, float, float, float, NDArray[np.float64]], tuple[float, float]]


def slices(effects: Iterable[Effect]) -> dict[str, slice]:
    """Where each effect's parameters lie in the flat vector, in the order of `effects`."""
    places: dict[str, slice] = {}
    start = 0
    for effect in effects:
        places[effect.name] = slice(start, start + len(effect.parameters))
        start += len(effect.parameters)
    return places


def fold(effects: Iterable[Effect]) -> FoldedTorques:
    """Sum of the torques of `effects` as one kernel (theta1, theta2, omega1, omega2, vector) -> (tau1, tau2), N m."""
    effects = tuple(effects)
    torques = _none
    for effect, place in zip(effects, slices(effects).values(), strict=True):
        torques = _added(torques, effect.kernel, place.start)
    return torques


# The folded functions are closures, which the disk cache cannot recognise again; the kernels that call them are
# cached with their code inside.
@numba.njit
def _none(
    theta1: float, theta2: float, omega1: float, omega2: float, vector: NDArray[np.float64]
) -> tuple[float, float]:
    return 0.0, 0.0


def _added(before: FoldedTorques, kernel: Torques, at: int) -> FoldedTorques:
    @numba.njit
    def torques(
        theta1: float, theta2: float, omega1: float, omega2: float, vector: NDArray[np.float64]
    ) -> tuple[float, float]:
        sum1, sum2 = before(theta1, theta2, omega1, omega2, vector)
        tau1, tau2 = kernel(theta1, theta2, omega1, omega2, vector, at)
        return sum1 + tau1, sum2 + tau2

    return torques
