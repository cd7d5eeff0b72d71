"""Simulate many candidates simultaneously to compute the cost of equation (2) for a population.

Theory of operation. `LANES` candidates are simulated together in one flat workspace, with a row of LANES numbers for
each quantity. Each of the four stages of a Runge-Kutta step is one loop over the lanes with constant row offsets. The
compiler therefore knows that rows do not overlap and converts the loop to vector instructions. A loop of one stage is
short enough for the registers and for out-of-order execution.

Sines and cosines of the angles are not evaluated but updated by short Taylor series of the rotation. From the start of
the step the rotation is h * omega or half of it. Between the second and the third stage, and between the fourth stage
and the end of the step, the angle changes by at most h^2 times accelerations. For these small rotations ("nudges"),
even shorter series are sufficient. Each lane stores the sum of its squared rotations in the step. If the sum exceeds
`GUARD`, the lane repeats the step from its old state with exact sines.

Sums are not reassociated, lanes are independent, and each (block of lanes, segment) is independent. A cost is therefore
bit-identical for any batch size and any number of threads. The workspace of a block, `ROWS * LANES` numbers, stays in
the first-level cache.
"""

import math

import numba
import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array, Integers
from dpr_lab.dynamics.equation import accelerations, coupled
from dpr_lab.dynamics.schedule import sample_steps
from dpr_lab.dynamics.segments import Segments, initial_states
from dpr_lab.dynamics.segments import segments as cut
from dpr_lab.kernels import njit, subroutine

LANES = 32
"""Number of lanes; four registers of eight doubles hide the latency of a division."""

GUARD = 0.05
"""Maximum weighted sum of squared rotations in a step, rad^2; squared nudges have the weight `NUDGE_WEIGHT`.

The limit corresponds to a rotation by 0.2 rad in the step. The truncated series then have an error of 3e-14, or of
2e-13 for a single rotation.
"""

NUDGE_WEIGHT = 100.0
"""Weight of a squared nudge relative to other squared rotations; the series of a nudge is shorter."""

# Rows of the workspace, as offsets in units of one number. The last twelve rows pass data from one stage to the next:
# sines and cosines, the accelerations P, Q, R of the first three stages, and the nudge to the end of the step.
ROWS = 32
"""Number of rows of the workspace."""

(
    B, D, E1, E2, C1, C2, THETA1, THETA2, OMEGA1, OMEGA2, SIN1, COS1, SIN2, COS2,
    OLD_THETA1, OLD_THETA2, OLD_OMEGA1, OLD_OMEGA2, TURNED, COST, STAGE_SIN1, STAGE_COS1, STAGE_SIN2, STAGE_COS2,
    P1, P2, Q1, Q2, R1, R2, NUDGE1, NUDGE2,
) = (row * LANES for row in range(ROWS))  # fmt: skip


def trajectory_errors(rows: ArrayLike, initial: ArrayLike, reference: ArrayLike, step: float) -> Array:
    """Compute the cost E(Z) of equation (2) for each candidate and pose.

    One Runge-Kutta step is made per sample.

        E = sum over samples k and axes i of (theta_i - reference_i)^2 [+ (omega_i - reference_i)^2]

    Args:
        rows: (n, 6) from `dpr_lab.dynamics.base.rows`
        initial: (poses, 4) states at the first sample, rad and rad/s
        reference: (poses, samples, 2 or 4) theta1, theta2 [, omega1, omega2]; without speeds only angles are used
        step: time between samples, s

    Returns:
        (n, poses) rad^2 (plus (rad/s)^2 for speeds); inf if the swing is not finite

    Raises:
        ValueError: an array has another shape.
    """
    reference = np.asarray(reference, dtype=np.float64)
    if reference.ndim != 3:
        raise ValueError(f"reference must have shape (poses, samples, 2 or 4), not {reference.shape}")
    poses, samples, _ = reference.shape
    t = step * np.arange(samples)
    swings = cut([t] * poses, range(poses), step=step)
    return segment_errors(rows, swings, initial, reference.reshape(poses * samples, -1))


def segment_errors(
    rows: ArrayLike,
    segments: Segments,
    initial: ArrayLike,
    targets: ArrayLike,
    whitening: ArrayLike | None = None,
) -> Array:
    """Compute the sum of squared, whitened errors of each candidate over each segment.

        cost = sum over samples of |W (theta - target)|^2 [+ |omega - target|^2]

    Args:
        rows: (n, 6) from `dpr_lab.dynamics.base.rows`
        segments: times of the samples, between which steps are equal
        initial: (S, 4) state at each segment's first sample, rad and rad/s
        targets: (samples, 2 or 4) theta1, theta2 [, omega1, omega2] of all segments in sequence
        whitening: (2, 2) W with W^T W the inverse covariance of the two angles, 1/rad; None: the identity

    Returns:
        (n, S); inf if the swing is not finite

    Raises:
        ValueError: an array has another shape.
    """
    rows = np.ascontiguousarray(rows, dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 6:
        raise ValueError(f"rows must have shape (n, 6), not {rows.shape}")
    starts = initial_states(initial, segments)
    measured, weigh_speeds = _targets(targets, len(segments.t))
    weights = _weights(whitening, weigh_speeds)
    if not len(rows):
        return np.empty((0, len(segments)))
    step, count = sample_steps(segments.t, segments.offsets, segments.step)
    return _costs(rows, starts, segments.offsets, step, count, measured, weights)


def _targets(targets: ArrayLike, samples: int) -> tuple[Array, bool]:
    """Extend the targets to (samples, 4); return them, and whether they contain speeds."""
    targets = np.asarray(targets, dtype=np.float64)
    if targets.ndim != 2 or targets.shape[0] != samples or targets.shape[1] not in (2, 4):
        raise ValueError(f"targets must have shape ({samples}, 2 or 4), not {targets.shape}")
    with_speeds = targets.shape[1] == 4
    full = np.zeros((samples, 4))
    full[:, : targets.shape[1]] = targets
    return full, with_speeds


def _weights(whitening: ArrayLike | None, weigh_speeds: bool) -> Array:
    """Return the (4,) weights of the cost.

    The first three weights are the metric of the angle error: element 11, twice element 12, and element 22 of W^T W.
    The fourth one is the weight of the squared speed errors.
    """
    W = np.eye(2) if whitening is None else np.asarray(whitening, dtype=np.float64)
    if W.shape != (2, 2):
        raise ValueError(f"whitening must have shape (2, 2), not {W.shape}")
    metric = W.T @ W
    return np.array([metric[0, 0], 2.0 * metric[0, 1], metric[1, 1], 1.0 if weigh_speeds else 0.0])


@njit(parallel=True)
def _costs(
    rows: Array,
    starts: Array,
    offsets: Integers,
    step: Array,
    count: Integers,
    targets: Array,
    weights: Array,
) -> Array:
    candidates, pieces = len(rows), len(starts)
    blocks = (candidates + LANES - 1) // LANES
    costs = np.empty((candidates, pieces))
    for job in numba.prange(blocks * pieces):
        block, piece = job // pieces, job % pieces
        first = block * LANES
        lanes = np.empty(ROWS * LANES)
        _load(lanes, rows, first, starts[piece])
        for sample in range(offsets[piece], offsets[piece + 1]):
            for _ in range(count[sample]):
                _advance(lanes, step[sample])
            _score(lanes, targets[sample], weights)
        for k in range(min(LANES, candidates - first)):
            cost = lanes[COST + k]
            costs[first + k, piece] = cost if np.isfinite(cost) else np.inf
    return costs


@subroutine
def _load(lanes: Array, rows: Array, first: int, start: Array) -> None:
    """Load candidates from index `first` on; spare lanes repeat the last one."""
    for k in range(LANES):
        candidate = min(first + k, len(rows) - 1)
        for row in range(6):
            lanes[row * LANES + k] = rows[candidate, row]
        lanes[COST + k] = 0.0
        _place(lanes, k, start[0], start[1], start[2], start[3])


@subroutine
def _place(lanes: Array, k: int, theta1: float, theta2: float, omega1: float, omega2: float) -> None:
    lanes[THETA1 + k], lanes[THETA2 + k] = theta1, theta2
    lanes[OMEGA1 + k], lanes[OMEGA2 + k] = omega1, omega2
    lanes[SIN1 + k], lanes[COS1 + k] = math.sin(theta1), math.cos(theta1)
    lanes[SIN2 + k], lanes[COS2 + k] = math.sin(theta2), math.cos(theta2)


@subroutine
def _score(lanes: Array, target: Array, weights: Array) -> None:
    theta1, theta2, omega1, omega2 = target
    metric11, metric12, metric22, speeds = weights
    for k in range(LANES):
        z1, z2 = lanes[THETA1 + k] - theta1, lanes[THETA2 + k] - theta2
        v1, v2 = lanes[OMEGA1 + k] - omega1, lanes[OMEGA2 + k] - omega2
        angles = z1 * (metric11 * z1 + metric12 * z2) + metric22 * z2 * z2
        lanes[COST + k] += angles + speeds * (v1 * v1 + v2 * v2)


@subroutine
def _sines(lanes: Array, k: int, first_row: int) -> tuple[float, float, float, float]:
    i = first_row + k
    return lanes[i], lanes[i + LANES], lanes[i + 2 * LANES], lanes[i + 3 * LANES]


@subroutine
def _accelerated(
    lanes: Array,
    k: int,
    sin1: float,
    cos1: float,
    sin2: float,
    cos2: float,
    omega1: float,
    omega2: float,
) -> tuple[float, float]:
    """Return the accelerations of one lane, rad/s^2, by elimination.

    Divided by a, the mass matrix is [[1, coupling], [coupling, b]].
    """
    b, d, e1, e2, c1, c2 = lanes[B + k], lanes[D + k], lanes[E1 + k], lanes[E2 + k], lanes[C1 + k], lanes[C2 + k]
    coupling, torque1, torque2 = coupled(sin1, cos1, sin2, cos2, omega1, omega2, d, e1, e2, c1, c2)
    alpha2 = (torque2 - coupling * torque1) / (b - coupling * coupling)
    return torque1 - coupling * alpha2, alpha2


@subroutine
def turned(angle: float, square: float, sine: float, cosine: float) -> tuple[float, float]:
    """Return the sine and cosine after a rotation by a small `angle` (see `GUARD`).

    `square` is the squared angle.
    """
    p = square * (1.0 / 362880.0) - 1.0 / 5040.0
    p = (p * square + 1.0 / 120.0) * square - 1.0 / 6.0
    turn = angle + angle * square * p
    q = square * (1.0 / 40320.0) - 1.0 / 720.0
    q = (q * square + 1.0 / 24.0) * square - 0.5
    shrink = square * q
    return sine + (sine * shrink + cosine * turn), cosine + (cosine * shrink - sine * turn)


@subroutine
def _nudged(angle: float, square: float, sine: float, cosine: float) -> tuple[float, float]:
    """Return the sine and cosine after a rotation by a nudge, which is much smaller than an angle of `turned`."""
    turn = angle + angle * square * (square * (1.0 / 120.0) - 1.0 / 6.0)
    shrink = square * (square * (1.0 / 24.0) - 0.5)
    return sine + (sine * shrink + cosine * turn), cosine + (cosine * shrink - sine * turn)


@subroutine
def _advance(lanes: Array, h: float) -> None:
    """Advance all lanes by one Runge-Kutta step."""
    _stage1(lanes, h)
    _stage2(lanes, h)
    _stage3(lanes, h)
    beyond = 0
    for k in range(LANES):
        beyond += lanes[TURNED + k] > GUARD
    if beyond:
        _remember(lanes)
    _stage4(lanes, h)
    if beyond:
        _repeat_exactly(lanes, h)


@subroutine
def _stage1(lanes: Array, h: float) -> None:
    """Compute stage 1: the accelerations p at the start of the step.

    The sines and cosines are then rotated by half a step with the initial speeds.
    """
    half = 0.5 * h
    for k in range(LANES):
        sin1, cos1, sin2, cos2 = _sines(lanes, k, SIN1)
        omega1, omega2 = lanes[OMEGA1 + k], lanes[OMEGA2 + k]
        lanes[P1 + k], lanes[P2 + k] = _accelerated(lanes, k, sin1, cos1, sin2, cos2, omega1, omega2)
        turn1, turn2 = half * omega1, half * omega2
        square1, square2 = turn1 * turn1, turn2 * turn2
        lanes[STAGE_SIN1 + k], lanes[STAGE_COS1 + k] = turned(turn1, square1, sin1, cos1)
        lanes[STAGE_SIN2 + k], lanes[STAGE_COS2 + k] = turned(turn2, square2, sin2, cos2)
        lanes[TURNED + k] = square1 + square2


@subroutine
def _stage2(lanes: Array, h: float) -> None:
    """Compute stage 2: the accelerations q in the middle of the step.

    The speeds of the stage follow from p. The sines and cosines are then nudged to the angles of stage 3.
    """
    half, quarter = 0.5 * h, 0.25 * h * h
    for k in range(LANES):
        sin1, cos1, sin2, cos2 = _sines(lanes, k, STAGE_SIN1)
        p1, p2 = lanes[P1 + k], lanes[P2 + k]
        u1, u2 = lanes[OMEGA1 + k] + half * p1, lanes[OMEGA2 + k] + half * p2
        lanes[Q1 + k], lanes[Q2 + k] = _accelerated(lanes, k, sin1, cos1, sin2, cos2, u1, u2)
        nudge1, nudge2 = quarter * p1, quarter * p2
        square1, square2 = nudge1 * nudge1, nudge2 * nudge2
        lanes[STAGE_SIN1 + k], lanes[STAGE_COS1 + k] = _nudged(nudge1, square1, sin1, cos1)
        lanes[STAGE_SIN2 + k], lanes[STAGE_COS2 + k] = _nudged(nudge2, square2, sin2, cos2)
        lanes[TURNED + k] += NUDGE_WEIGHT * (square1 + square2)


@subroutine
def _stage3(lanes: Array, h: float) -> None:
    """Compute stage 3: the accelerations r in the middle of the step.

    The speeds of the stage follow from q. The initial sines and cosines are then rotated by a whole step with these
    speeds.
    """
    half, sixth = 0.5 * h, h * h / 6.0
    for k in range(LANES):
        sin1, cos1, sin2, cos2 = _sines(lanes, k, STAGE_SIN1)
        q1, q2 = lanes[Q1 + k], lanes[Q2 + k]
        v1, v2 = lanes[OMEGA1 + k] + half * q1, lanes[OMEGA2 + k] + half * q2
        r1, r2 = _accelerated(lanes, k, sin1, cos1, sin2, cos2, v1, v2)
        turn1, turn2 = h * v1, h * v2
        square1, square2 = turn1 * turn1, turn2 * turn2
        lanes[STAGE_SIN1 + k], lanes[STAGE_COS1 + k] = turned(turn1, square1, lanes[SIN1 + k], lanes[COS1 + k])
        lanes[STAGE_SIN2 + k], lanes[STAGE_COS2 + k] = turned(turn2, square2, lanes[SIN2 + k], lanes[COS2 + k])
        nudge1, nudge2 = sixth * (lanes[P1 + k] - 2.0 * q1 + r1), sixth * (lanes[P2 + k] - 2.0 * q2 + r2)
        lanes[R1 + k], lanes[R2 + k], lanes[NUDGE1 + k], lanes[NUDGE2 + k] = r1, r2, nudge1, nudge2
        lanes[TURNED + k] += square1 + square2 + NUDGE_WEIGHT * (nudge1 * nudge1 + nudge2 * nudge2)


@subroutine
def _stage4(lanes: Array, h: float) -> None:
    """Compute stage 4, the accelerations z at the end of the step, and the new state.

    The speeds of the stage follow from r.
    """
    half, sixth = 0.5 * h, h / 6.0
    for k in range(LANES):
        sin1, cos1, sin2, cos2 = _sines(lanes, k, STAGE_SIN1)
        omega1, omega2 = lanes[OMEGA1 + k], lanes[OMEGA2 + k]
        q1, q2, r1, r2 = lanes[Q1 + k], lanes[Q2 + k], lanes[R1 + k], lanes[R2 + k]
        nudge1, nudge2 = lanes[NUDGE1 + k], lanes[NUDGE2 + k]
        z1, z2 = _accelerated(lanes, k, sin1, cos1, sin2, cos2, omega1 + h * r1, omega2 + h * r2)
        lanes[SIN1 + k], lanes[COS1 + k] = _nudged(nudge1, nudge1 * nudge1, sin1, cos1)
        lanes[SIN2 + k], lanes[COS2 + k] = _nudged(nudge2, nudge2 * nudge2, sin2, cos2)
        lanes[THETA1 + k] += h * (omega1 + half * q1) + nudge1
        lanes[THETA2 + k] += h * (omega2 + half * q2) + nudge2
        lanes[OMEGA1 + k] = omega1 + sixth * (lanes[P1 + k] + 2.0 * (q1 + r1) + z1)
        lanes[OMEGA2 + k] = omega2 + sixth * (lanes[P2 + k] + 2.0 * (q2 + r2) + z2)


@subroutine
def _remember(lanes: Array) -> None:
    """Copy the state at the start of the step, for a possible repetition."""
    for k in range(LANES):
        lanes[OLD_THETA1 + k], lanes[OLD_THETA2 + k] = lanes[THETA1 + k], lanes[THETA2 + k]
        lanes[OLD_OMEGA1 + k], lanes[OLD_OMEGA2 + k] = lanes[OMEGA1 + k], lanes[OMEGA2 + k]


@subroutine
def _repeat_exactly(lanes: Array, h: float) -> None:
    """Repeat the last step with exact sines and cosines in the lanes whose rotation was too large."""
    for k in range(LANES):
        if lanes[TURNED + k] > GUARD:
            theta1, theta2, omega1, omega2 = _exact_step(lanes, k, h)
            _place(lanes, k, theta1, theta2, omega1, omega2)


@subroutine
def _exact_step(lanes: Array, k: int, h: float) -> tuple[float, float, float, float]:
    b, d, e1, e2, c1, c2 = lanes[B + k], lanes[D + k], lanes[E1 + k], lanes[E2 + k], lanes[C1 + k], lanes[C2 + k]
    theta1, theta2 = lanes[OLD_THETA1 + k], lanes[OLD_THETA2 + k]
    w1, w2 = lanes[OLD_OMEGA1 + k], lanes[OLD_OMEGA2 + k]
    u1, u2 = w1, w2
    sum1, sum2, speed1, speed2 = 0.0, 0.0, 0.0, 0.0
    at1, at2 = theta1, theta2
    for stage in range(4):
        p1, p2 = accelerations(at1, at2, u1, u2, 1.0, b, d, e1, e2, c1, c2, 0.0, 0.0)
        weight = 2.0 if stage in (1, 2) else 1.0
        sum1, sum2 = sum1 + weight * p1, sum2 + weight * p2
        speed1, speed2 = speed1 + weight * u1, speed2 + weight * u2
        ahead = h if stage == 2 else 0.5 * h
        at1, at2 = theta1 + ahead * u1, theta2 + ahead * u2
        u1, u2 = w1 + ahead * p1, w2 + ahead * p2
    sixth = h / 6.0
    return theta1 + sixth * speed1, theta2 + sixth * speed2, w1 + sixth * sum1, w2 + sixth * sum2
