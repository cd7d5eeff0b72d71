"""Simulate segments in three coordinates by the classical Runge-Kutta method.

The equation is that of `dpr_lab.dynamics.arm`. The torque on a free or driven arm is

    tau0 = gain u - f0 tanh(phi' / SMOOTHING)

where the input u is linear between samples, f0 is the Coulomb friction of the arm, and phi' is the speed of the arm.
All parameters except L0 may have any common factor.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array, Integers
from dpr_lab.dynamics.arm import CLAMPED, FREE, arm_accelerations
from dpr_lab.dynamics.schedule import sample_steps
from dpr_lab.effects.quantities import NOTHING, SMOOTHING, ArmModel, BaseParameters, Motion
from dpr_lab.kernels import njit, subroutine

SWING_PARAMETERS = ("a", "b", "d", "e1", "c1", "c2", "A", "c0", "k0", "f0", "gain", "L0")
"""Order of the parameter vector p.

It contains the base parameters of the rods; total inertia, viscous friction, stiffness and Coulomb friction of the arm;
the torque per unit of the input; and the length of the arm, m.
"""


class ArmSegments(NamedTuple):
    """Segments of recordings in sequence, with the inputs of the arm."""

    offsets: Integers
    """(segments + 1,) index of the first sample of each segment, then the number of samples."""
    mode: Integers
    """(segments,) mode of the arm: `CLAMPED`, `FREE` (torque as input) or `DRIVEN` (acceleration as input)."""
    drive: Array
    """(samples,) mean of the input from each sample to the next."""
    slope: Array
    """(samples,) derivative of the input from each sample to the next, per second; zero for a held input."""
    step: Array
    """(samples,) length of the Runge-Kutta steps before each sample, s."""
    substeps: Integers
    """(samples,) number of Runge-Kutta steps before each sample."""


def arm_segments(
    t: list[Array], mode: list[int], drive: list[Array], max_step: float = 2.5e-3, slope: list[Array] | None = None
) -> ArmSegments:
    """Concatenate segments.

    Args:
        t: for each segment, (n,) increasing times, s
        mode: mode of the arm in each segment
        drive: for each segment, (n,) mean input from each instant to the next
        max_step: longest Runge-Kutta step, s
        slope: for each segment, (n,) derivative of the input, per second; None: zero
    """
    offsets = np.concatenate([[0], np.cumsum([len(piece) for piece in t])]).astype(np.int64)
    step, count = sample_steps(np.concatenate(t), offsets, np.full(len(t), max_step))
    inputs = np.concatenate(drive)
    slopes = np.zeros_like(inputs) if slope is None else np.concatenate(slope)
    return ArmSegments(offsets, np.array(mode, dtype=np.int64), inputs, slopes, step, count)


def swing_segments(p: ArrayLike, frame: tuple[float, float], segments: ArmSegments, initial: Array) -> Array:
    """Simulate segments with an arm.

    Args:
        p: (12,) parameters in the order of `SWING_PARAMETERS`
        frame: L1 (m), g (m/s^2)
        segments: segments with their inputs
        initial: (segments, 6) theta0, theta1, theta2, omega0, omega1, omega2 at the first sample of each segment, rad
            and rad/s

    Returns:
        (samples, 6) states; not finite after a failure of the integration
    """
    a, b, d, e1, c1, c2, A, c0, k0, f0, gain, L0 = np.asarray(p, dtype=np.float64).tolist()
    L1, g = frame
    base = BaseParameters(a, b, d, e1, d * g / L1, c1, c2)
    states = np.empty((len(segments.drive), 6))
    _swing_segments(base, ArmModel(A, L0 / g, c0, k0), f0, gain, segments, np.ascontiguousarray(initial), states)
    return states


@subroutine
def _rates(
    x: tuple[float, float, float, float, float, float],
    base: BaseParameters,
    arm: ArmModel,
    f0: float,
    mode: int,
    push: float,
) -> tuple[float, float, float, float, float, float]:
    theta0, theta1, theta2, omega0, omega1, omega2 = x
    motion = Motion(
        0.0, theta0, theta1, theta2, omega0, omega1, omega2, np.sin(theta1), np.cos(theta1), np.sin(theta2),
        np.cos(theta2), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0,
    )  # fmt: skip
    drive = push
    if mode == FREE and f0 != 0.0:
        drive -= f0 * np.tanh(omega0 / SMOOTHING)
    alpha0, alpha1, alpha2 = arm_accelerations(motion, base, NOTHING, arm, mode, drive)
    if mode == CLAMPED:
        return 0.0, omega1, omega2, 0.0, alpha1, alpha2
    return omega0, omega1, omega2, alpha0, alpha1, alpha2


@subroutine
def _ahead(
    x: tuple[float, float, float, float, float, float],
    v: tuple[float, float, float, float, float, float],
    h: float,
) -> tuple[float, float, float, float, float, float]:
    return (
        x[0] + h * v[0], x[1] + h * v[1], x[2] + h * v[2], x[3] + h * v[3], x[4] + h * v[4], x[5] + h * v[5],
    )  # fmt: skip


@njit(allocates=False)
def _swing_segments(
    base: BaseParameters,
    arm: ArmModel,
    f0: float,
    gain: float,
    segments: ArmSegments,
    initial: Array,
    states: Array,
) -> None:
    for s in range(len(segments.mode)):
        mode = segments.mode[s]
        x = (initial[s, 0], initial[s, 1], initial[s, 2], initial[s, 3], initial[s, 4], initial[s, 5])
        for i in range(segments.offsets[s], segments.offsets[s + 1]):
            h = segments.step[i]
            change = 0.5 * h * gain * segments.slope[i - 1]
            first = gain * segments.drive[i - 1] - segments.substeps[i] * change
            for k in range(segments.substeps[i]):
                push = first + (2 * k + 1) * change
                k1 = _rates(x, base, arm, f0, mode, push - change)
                k2 = _rates(_ahead(x, k1, 0.5 * h), base, arm, f0, mode, push)
                k3 = _rates(_ahead(x, k2, 0.5 * h), base, arm, f0, mode, push)
                k4 = _rates(_ahead(x, k3, h), base, arm, f0, mode, push + change)
                x = _ahead(_ahead(_ahead(_ahead(x, k1, h / 6), k2, h / 3), k3, h / 3), k4, h / 6)
            states[i, 0], states[i, 1], states[i, 2] = x[0], x[1], x[2]
            states[i, 3], states[i, 4], states[i, 5] = x[3], x[4], x[5]
