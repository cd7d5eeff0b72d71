"""Sensitivity of a swing to parameters and initial state, exact for the Runge-Kutta map.

Let x be the state, p the parameters, f the right-hand side, and S = dx/d(p, x(0)). Every stage k = f(x + h a k', p) of
a step of length h is differentiated, where k' is the previous stage and a its coefficient: dk = f_x (S + h a dk') +
f_p. Up to rounding, the result is the exact derivative of the result of `simulate`, not an approximation of the
derivative of the true swing.

The columns of S belong to the ratios a/b, d/b, e1/b, c1/b, c2/b (with b = 1), then to theta1, theta2, omega1, omega2 at
the start. They are the lanes of the kernel. Within a step, sines are computed from their values at the start by a
series that is exact to rounding.
"""

import math

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array, Flags, Integers
from dpr_lab.dynamics.equation import coupled, solved
from dpr_lab.dynamics.rollout import GUARD, turned
from dpr_lab.dynamics.schedule import sample_steps
from dpr_lab.dynamics.segments import Segments, initial_states
from dpr_lab.effects.quantities import RigConstants
from dpr_lab.kernels import njit, subroutine

STATES = 4
RATIOS = 5
COLUMNS = RATIOS + STATES

WIDTH = 12
"""Number of columns in a row of the kernel.

The columns are the `COLUMNS` of S, the column of the torque factor 1 / b, and two more to fill vector registers.
"""

# Rows of the workspace, each `WIDTH` numbers: S, S at the stage, the sum of dk, and f_p for the two accelerations.
S, AT, TOTAL, F_P = (row * WIDTH for row in (0, 4, 8, 12))
ROWS = 14 * WIDTH


def sensitivities(
    ratios: ArrayLike, L1: float, g: float, segments: Segments, initial: ArrayLike, outputs: int = STATES
) -> tuple[Array, Array]:
    """Simulate segments, with the derivatives with respect to ratios and initial states.

    Args:
        ratios: (5,) a/b, d/b, e1/b, c1/b, c2/b, or (S, 5) for each segment
        L1: length of the inner rod, m
        g: gravity, m/s^2
        segments: times of the samples, between which steps are equal
        initial: (S, 4) state at each segment's first sample, rad and rad/s
        outputs: number of the four states whose derivatives are returned; 2: the angles

    Returns:
        (samples, 4) states of all segments in sequence and (samples, `outputs`, 9) derivatives

    Raises:
        ValueError: the ratios or initial states do not have the stated shapes.
    """
    return _followed(ratios, L1, g, segments, initial, outputs)


def driven(
    values: Array, rig: RigConstants, segments: Segments, initial: ArrayLike, outputs: int
) -> tuple[Array, Array, Array]:
    """Simulate segments as `sensitivities` does, with known torques and arm motions.

    Args:
        values: (S, 6) ratios of each segment, and 1 / b, by which torques are multiplied
        rig: lengths and gravity
        segments: times of the samples
        initial: (S, 4) state at the first sample of each segment, rad and rad/s
        outputs: number of the four states whose derivatives are returned

    Returns:
        states and derivatives as in `sensitivities`, and (samples, `outputs`) derivatives with respect to 1 / b
    """
    step, count = sample_steps(segments.t, segments.offsets, segments.step)
    starts, pushes = initial_states(initial, segments), segments.pushes
    if any(setup.arm is not None for setup in segments.setups):
        pushes[:, 2] *= rig.L0 / rig.g  # docs/theory.md (54)
    gravity = rig.g / rig.L1
    return _integrated(np.ascontiguousarray(values), gravity, starts, segments, pushes, step, count, outputs)


def swings(ratios: ArrayLike, L1: float, g: float, segments: Segments, initial: ArrayLike) -> Array:
    """Compute the (samples, 4) states like `sensitivities` but without derivatives, in a third of the time."""
    return _followed(ratios, L1, g, segments, initial, 0)[0]


def _followed(
    ratios: ArrayLike, L1: float, g: float, segments: Segments, initial: ArrayLike, outputs: int
) -> tuple[Array, Array]:
    values = np.asarray(ratios, dtype=np.float64)
    if values.shape not in ((RATIOS,), (len(segments), RATIOS)):
        raise ValueError(f"ratios must have shape ({RATIOS},), or that for each segment, not {values.shape}")
    free = np.zeros((len(segments), RATIOS + 1))
    free[:, :RATIOS] = values
    step, count = sample_steps(segments.t, segments.offsets, segments.step)
    starts, still = initial_states(initial, segments), np.zeros((len(segments.t), 4))
    return _integrated(free, g / L1, starts, segments, still, step, count, outputs)[:2]


def _integrated(
    ratios: Array,
    gravity: float,
    starts: Array,
    segments: Segments,
    pushes: Array,
    step: Array,
    count: Integers,
    outputs: int,
) -> tuple[Array, Array, Array]:
    """Return the states, their derivatives, and their derivatives with respect to 1 / b.

    The shapes are (samples, 4), (samples, `outputs`, 9) and (samples, `outputs`).
    """
    states, by_push = np.empty((len(step), STATES)), np.empty((len(step), outputs))
    slopes, x, rows = np.empty((len(step), outputs, COLUMNS)), np.empty(STATES), np.empty(ROWS if outputs else 0)
    held, offsets = segments.held, segments.offsets
    _integrate(ratios, gravity, starts, held, pushes, offsets, step, count, outputs, x, rows, states, slopes, by_push)
    return states, slopes, by_push


@njit(allocates=False)
def _integrate(
    ratios: Array,
    gravity: float,
    starts: Array,
    held: Flags,
    pushes: Array,
    offsets: Integers,
    step: Array,
    count: Integers,
    outputs: int,
    x: Array,
    rows: Array,
    states: Array,
    slopes: Array,
    by_push: Array,
) -> None:
    """Compute states, derivatives and `by_push` in place; x and rows are work arrays."""
    for segment in range(len(starts)):
        for i in range(STATES):
            x[i] = starts[segment, i]
        for i in range(len(rows)):
            rows[i] = 0.0
        for i in range(STATES if outputs else 0):
            rows[S + i * WIDTH + RATIOS + i] = 1.0
        for sample in range(offsets[segment], offsets[segment + 1]):
            for _ in range(count[sample]):
                _runge_kutta(x, rows, ratios[segment], gravity, step[sample], held[segment], pushes[sample])
            for i in range(STATES):
                states[sample, i] = x[i]
            for i in range(outputs):
                for j in range(COLUMNS):
                    slopes[sample, i, j] = rows[S + i * WIDTH + j]
                by_push[sample, i] = rows[S + i * WIDTH + COLUMNS]


@subroutine
def _runge_kutta(
    x: Array,
    rows: Array,
    ratios: Array,
    gravity: float,
    h: float,
    held: bool,
    push: Array,
) -> None:
    """Advance the state and its derivative by one step in place.

    The derivative is not computed if `rows` is empty. `held` states whether joint 2 is fixed.
    """
    theta1, theta2, omega1, omega2 = x
    e2 = ratios[1] * gravity
    push1, push2 = ratios[5] * push[0], ratios[5] * push[1]
    u1, u2 = omega1, omega2
    sum1, sum2, speed1, speed2 = 0.0, 0.0, 0.0, 0.0
    start1, start2 = (math.sin(theta1), math.cos(theta1)), (math.sin(theta2), math.cos(theta2))
    sines1, sines2 = start1, start2
    derived, carried = len(rows) > 0, push[2] != 0.0 or push[3] != 0.0
    for j in range(STATES * WIDTH if derived else 0):
        rows[AT + j] = rows[S + j]
        rows[TOTAL + j] = 0.0
    for stage in range(4):
        weight = 2.0 if stage in (1, 2) else 1.0
        ahead = h if stage == 2 else 0.5 * h
        coupling, torque1, torque2 = coupled(*sines1, *sines2, u1, u2, ratios[1], ratios[2], e2, ratios[3], ratios[4])
        torque1, torque2 = torque1 + push1, torque2 + push2
        if carried:
            (sin1, cos1), (sin2, cos2) = sines1, sines2
            torque1 += (push[3] * (ratios[0] * sin1 + ratios[1] * sin2) - push[2] * ratios[2]) * cos1
            torque2 += (push[3] * (sin2 + ratios[1] * sin1) - push[2] * e2) * cos2
        alpha1, alpha2 = solved(ratios[0], 1.0, coupling, torque1, torque2)
        if held:
            alpha1 = alpha2 = (torque1 + torque2) / (ratios[0] + 1.0 + 2.0 * coupling)
        if derived:
            _differentiate(rows, sines1, sines2, (u1, u2), (alpha1, alpha2), ratios, gravity, weight, ahead, held, push)
        sum1, sum2 = sum1 + weight * alpha1, sum2 + weight * alpha2
        speed1, speed2 = speed1 + weight * u1, speed2 + weight * u2
        sines1, sines2 = _after(ahead * u1, theta1, start1), _after(ahead * u2, theta2, start2)
        u1, u2 = omega1 + ahead * alpha1, omega2 + ahead * alpha2
    sixth = h / 6.0
    x[0], x[1] = theta1 + sixth * speed1, theta2 + sixth * speed2
    x[2], x[3] = omega1 + sixth * sum1, omega2 + sixth * sum2
    for j in range(STATES * WIDTH if derived else 0):
        rows[S + j] += sixth * rows[TOTAL + j]


@subroutine
def _after(turn: float, angle: float, sines: tuple[float, float]) -> tuple[float, float]:
    """Return the sine and cosine of an angle after a rotation by `turn`.

    `sines` contains the sine and cosine before the rotation.
    """
    square = turn * turn
    if square > GUARD:
        return math.sin(angle + turn), math.cos(angle + turn)
    return turned(turn, square, sines[0], sines[1])


@subroutine
def _differentiate(
    rows: Array,
    sines1: tuple[float, float],
    sines2: tuple[float, float],
    omegas: tuple[float, float],
    alphas: tuple[float, float],
    ratios: Array,
    gravity: float,
    weight: float,
    ahead: float,
    held: bool,
    push: Array,
) -> None:
    """Add the derivative dk = f_x S + f_p of a stage to the sum, and advance S.

    S contains the derivatives of the state. From M alpha = f it follows that M dalpha = df - dM alpha for each column.
    If joint 2 is fixed, the sum of the two rows of this equation is used.
    """
    a, d, e1, c1, c2, _ = ratios
    e2 = d * gravity
    (sin1, cos1), (sin2, cos2) = sines1, sines2
    (omega1, omega2), (alpha1, alpha2) = omegas, alphas
    sin12, cos12 = sin1 * cos2 - cos1 * sin2, cos1 * cos2 + sin1 * sin2
    coupling = d * cos12

    # df - dM alpha for the difference angle t1 - t2, on which M and the centrifugal torques depend
    twist1 = -d * cos12 * omega2 * omega2 + d * sin12 * alpha2
    twist2 = d * cos12 * omega1 * omega1 + d * sin12 * alpha1
    lift1, lift2 = e1 * cos1, e2 * cos2
    whirl1, whirl2 = -2.0 * d * sin12 * omega2, 2.0 * d * sin12 * omega1
    slide = omega1 - omega2
    rows[F_P], rows[F_P + 1], rows[F_P + 2] = -alpha1, -sin12 * omega2 * omega2 - cos12 * alpha2, sin1
    rows[F_P + 3], rows[F_P + 4] = -omega1, -slide
    rows[F_P + WIDTH + 1], rows[F_P + WIDTH + 4] = sin12 * omega1 * omega1 + gravity * sin2 - cos12 * alpha1, slide
    rows[F_P + COLUMNS], rows[F_P + WIDTH + COLUMNS] = push[0], push[1]
    cross = 0.0
    if push[2] != 0.0 or push[3] != 0.0:  # moving arm, docs/theory.md (54)
        pull, whirl = push[2], push[3]
        lift1 += whirl * (a * (cos1 * cos1 - sin1 * sin1) - d * sin1 * sin2) + pull * e1 * sin1
        lift2 += whirl * (cos2 * cos2 - sin2 * sin2 - d * sin1 * sin2) + pull * e2 * sin2
        cross = whirl * d * cos1 * cos2
        rows[F_P] += whirl * sin1 * cos1
        rows[F_P + 1] += whirl * sin2 * cos1
        rows[F_P + 2] -= pull * cos1
        rows[F_P + WIDTH + 1] += (whirl * sin1 - pull * gravity) * cos2
    scale = 1.0 / (a - coupling * coupling)
    for j in range(WIDTH):
        t1, t2, w1, w2 = rows[AT + j], rows[AT + WIDTH + j], rows[AT + 2 * WIDTH + j], rows[AT + 3 * WIDTH + j]
        drag = c2 * (w1 - w2)
        r1 = twist1 * (t1 - t2) + lift1 * t1 + cross * t2 + whirl1 * w2 - c1 * w1 - drag + rows[F_P + j]
        r2 = twist2 * (t1 - t2) + lift2 * t2 + cross * t1 + whirl2 * w1 + drag + rows[F_P + WIDTH + j]
        dalpha1, dalpha2 = (r1 - coupling * r2) * scale, (a * r2 - coupling * r1) * scale
        if held:
            dalpha1 = dalpha2 = (r1 + r2) / (a + 1.0 + 2.0 * coupling)
        rows[TOTAL + j] += weight * w1
        rows[TOTAL + WIDTH + j] += weight * w2
        rows[TOTAL + 2 * WIDTH + j] += weight * dalpha1
        rows[TOTAL + 3 * WIDTH + j] += weight * dalpha2
        rows[AT + j] = rows[S + j] + ahead * w1
        rows[AT + WIDTH + j] = rows[S + WIDTH + j] + ahead * w2
        rows[AT + 2 * WIDTH + j] = rows[S + 2 * WIDTH + j] + ahead * dalpha1
        rows[AT + 3 * WIDTH + j] = rows[S + 3 * WIDTH + j] + ahead * dalpha2
