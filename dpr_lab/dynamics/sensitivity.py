r"""How a swing answers to its parameters and its start: the derivative of the Runge-Kutta map itself.

With state x, parameters p and S = dx/d(p, x(0)), every stage k = f(x + h a k', p) is differentiated alongside:
dk = f_x (S + h a dk') + f_p. The result is the exact derivative of what `simulate` computes, up to rounding, not an
approximation of the derivative of the true swing.

Columns of S: the ratios a/b, d/b, e1/b, c1/b, c2/b (with b = 1), then theta1, theta2, omega1, omega2 at the start.
"""

import math

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dpr_lab.dynamics.equation import coupled, solved
from dpr_lab.dynamics.schedule import MAX_STEP
from dpr_lab.dynamics.segments import Segments, segments
from dpr_lab.kernels import njit

STATES = 4
RATIOS = 5
COLUMNS = RATIOS + STATES


def swing_sensitivity(
    ratios: ArrayLike, L1: float, g: float, state: ArrayLike, t: ArrayLike, max_step: float = MAX_STEP
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """One swing and its derivative.

    Args:
        ratios: (5,) a/b, d/b, e1/b, c1/b, c2/b
        L1: length of the inner rod, m
        g: gravity, m/s^2
        state: (4,) theta1, theta2, omega1, omega2 at t[0], rad and rad/s
        t: (n,) increasing instants, s
        max_step: longest Runge-Kutta step, s

    Returns:
        (n, 4) states and (n, 4, 9) their derivatives; not finite from where the swing is not

    Raises:
        ValueError: shapes that do not fit, or instants that do not increase.
    """
    return sensitivities(ratios, L1, g, segments([t], np.atleast_2d(np.asarray(state, dtype=np.float64)), max_step))


def sensitivities(
    ratios: ArrayLike, L1: float, g: float, swings: Segments
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Many segments and their derivatives, in parallel; each with respect to its own start state.

    Args:
        ratios: (5,) a/b, d/b, e1/b, c1/b, c2/b
        L1: length of the inner rod, m
        g: gravity, m/s^2
        swings: the segments and their start states

    Returns:
        (samples, 4) states of all segments end to end and (samples, 4, 9) their derivatives

    Raises:
        ValueError: not five ratios.
    """
    values = np.array(ratios, dtype=np.float64)
    if values.shape != (RATIOS,):
        raise ValueError(f"ratios must have shape ({RATIOS},), not {values.shape}")
    return _sensitivities(values, g / L1, swings.starts, swings.offsets, swings.step, swings.count)


@njit(parallel=True)
def _sensitivities(
    ratios: NDArray[np.float64],
    gravity: float,
    starts: NDArray[np.float64],
    offsets: NDArray[np.int64],
    step: NDArray[np.float64],
    count: NDArray[np.int64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    states = np.empty((len(step), STATES))
    slopes = np.empty((len(step), STATES, COLUMNS))
    for segment in numba.prange(len(starts)):
        x, S = starts[segment].copy(), np.zeros((STATES, COLUMNS))
        for i in range(STATES):
            S[i, RATIOS + i] = 1.0
        work_x, work_S = np.empty((3, STATES)), np.empty((3, STATES, COLUMNS))
        for sample in range(offsets[segment], offsets[segment + 1]):
            for _ in range(count[sample]):
                _runge_kutta(x, S, ratios, gravity, step[sample], work_x, work_S)
            states[sample], slopes[sample] = x, S
    return states, slopes


@njit
def _runge_kutta(
    x: NDArray[np.float64],
    S: NDArray[np.float64],
    ratios: NDArray[np.float64],
    gravity: float,
    h: float,
    work_x: NDArray[np.float64],
    work_S: NDArray[np.float64],
) -> None:
    """Advance state and derivative by one step, in place."""
    k, total, at = work_x
    dk, dtotal, dat = work_S
    total[:], dtotal[:] = 0.0, 0.0
    at[:], dat[:] = x, S
    for stage in range(4):
        _differentiate(at, dat, ratios, gravity, k, dk)
        weight = 2.0 if stage in (1, 2) else 1.0
        ahead = h if stage == 2 else 0.5 * h
        for i in range(STATES):
            total[i] += weight * k[i]
            at[i] = x[i] + ahead * k[i]
            for j in range(COLUMNS):
                dtotal[i, j] += weight * dk[i, j]
                dat[i, j] = S[i, j] + ahead * dk[i, j]
    for i in range(STATES):
        x[i] += h / 6.0 * total[i]
        for j in range(COLUMNS):
            S[i, j] += h / 6.0 * dtotal[i, j]


@njit
def _differentiate(
    x: NDArray[np.float64],
    S: NDArray[np.float64],
    ratios: NDArray[np.float64],
    gravity: float,
    k: NDArray[np.float64],
    dk: NDArray[np.float64],
) -> None:
    r"""Derivative in time k = f(x, p), and its own derivative dk = f_x S + f_p.

    From M alpha = f follows M dalpha = df - dM alpha, for each column.
    """
    a, d, e1, c1, c2 = ratios
    e2 = d * gravity
    theta1, theta2, omega1, omega2 = x
    sin1, cos1, sin2, cos2 = math.sin(theta1), math.cos(theta1), math.sin(theta2), math.cos(theta2)
    sin12, cos12 = sin1 * cos2 - cos1 * sin2, cos1 * cos2 + sin1 * sin2
    coupling, torque1, torque2 = coupled(sin1, cos1, sin2, cos2, omega1, omega2, d, e1, e2, c1, c2)
    alpha1, alpha2 = solved(a, 1.0, coupling, torque1, torque2)
    k[0], k[1], k[2], k[3] = omega1, omega2, alpha1, alpha2

    # df - dM alpha for the difference angle t1 - t2, which M and the whirling torques share
    twist1 = -d * cos12 * omega2 * omega2 + d * sin12 * alpha2
    twist2 = d * cos12 * omega1 * omega1 + d * sin12 * alpha1
    lift1, lift2 = e1 * cos1, e2 * cos2
    whirl1, whirl2 = -2.0 * d * sin12 * omega2, 2.0 * d * sin12 * omega1
    slide = omega1 - omega2
    explicit1 = (-alpha1, -sin12 * omega2 * omega2 - cos12 * alpha2, sin1, -omega1, -slide)
    explicit2 = (0.0, sin12 * omega1 * omega1 + gravity * sin2 - cos12 * alpha1, 0.0, 0.0, slide)
    scale = 1.0 / (a - coupling * coupling)
    for j in range(COLUMNS):
        t1, t2, w1, w2 = S[0, j], S[1, j], S[2, j], S[3, j]
        drag = c2 * (w1 - w2)
        r1 = twist1 * (t1 - t2) + lift1 * t1 + whirl1 * w2 - c1 * w1 - drag
        r2 = twist2 * (t1 - t2) + lift2 * t2 + whirl2 * w1 + drag
        if j < RATIOS:
            r1 += explicit1[j]
            r2 += explicit2[j]
        dk[0, j], dk[1, j] = w1, w2
        dk[2, j] = (r1 - coupling * r2) * scale
        dk[3, j] = (a * r2 - coupling * r1) * scale
