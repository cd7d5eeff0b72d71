"""Detect a soft stop of a moving arm, for example the end of its cable.

A soft stop is a torque that acts when the arm exceeds a limit angle. The equation of the arm (docs/theory.md, three
coordinates) is linear in ratios of its parameters:

    q'' = sum_j k_j x_j - K+ max(q - Q+, 0) + K- max(Q- - q, 0)

where q is the angle of the arm, th_i the angle of rod i, s_i = sin th_i and c_i = cos th_i. The terms x_j are 1, q, q',
sgn(q'), the input, s_i^2 q'' + 2 q' s_i c_i th_i' and c_i th_i'' - s_i th_i'^2 of each rod, and the coupling of both
rods. The limit angles Q+ and Q- are scanned. Local polynomials estimate the derivatives. The coefficients k_j, K+ and
K- follow by linear least squares, without the values of the rig file.

If a cable stiffens gradually or if cogging acts, the term of a stop also reduces the residual. This term then reduces
the residual less than the smooth torque K2 q^2 + K3 q^3. A stop is therefore reported only if it reduces the residual
more than this torque.
"""

from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.identification.misread.balance import periods
from dpr_lab.identification.misread.local_motion import LocalMotion, local_motion
from dpr_lab.identification.misread.torque_balance import TORQUES
from dpr_lab.rig import Rig
from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class SoftStopSettings:
    """Limits from which a soft stop is the likely cause."""

    nearest: float = 0.75
    """Minimum distance of a stop from the other end of the arm's range, relative to the range."""
    angles: int = 12
    """Number of angles that are tested at each end of the range."""
    better: float = 3.0
    """Minimum factor by which stops reduce the residual.

    On rigs without a stop, with or without Coulomb friction or drag, they reduce it by a factor below 1.5.
    """
    separated: float = 1.5
    """Minimum factor by which stops reduce the residual more than a smooth torque.

    It was at least 1.6 on 95 of 96 simulated rigs with a stop, and at most 1.03 on 96 rigs with a stiffening cable or
    cogging.
    """
    rarely: float = 0.25
    """Maximum fraction of the time that the arm spends beyond a stop."""
    contacts: int = 2
    """Minimum number of contacts with a stop."""
    certain: float = 5.0
    """Factor of the reduction of the residual from which a single contact is sufficient."""


SOFT_STOP = SoftStopSettings()


class ArmStop(NamedTuple):
    """A stop at one end of the arm's range."""

    end: str
    """End of the range at which the stop is: `largest` or `smallest` angle."""
    angle: float
    """Angle of a hard stop, or angle beyond which the torque of a soft stop acts, rad."""
    contacts: list[float]
    """Instants at which the arm reaches the stop, s."""


@dataclass(frozen=True, slots=True)
class _Trial:
    """A trial stop at one limit angle, with its regressor."""

    end: str
    angle: float
    beyond: Flags
    column: Array
    """(k,) torque of the stop, with the other terms of the equation projected out."""


def soft_stop(run: Run, rig: Rig) -> ArmStop | None:
    """Find the stop that explains most of the arm's residual, or return None.

    Args:
        run: a recording with a moving arm
        rig: mounted rods and lengths
    """
    window = min(periods(rig))
    motion = local_motion(run.t, run.theta, window, TORQUES.motion)
    if motion is None:
        return None
    terms = _terms(motion, run, rig.rods.number)
    basis = np.linalg.qr(terms / np.maximum(np.linalg.norm(terms, axis=0), 1e-300))[0]
    angle, alpha = motion.rods[:, 0], motion.alpha[:, 0]
    residual = alpha - basis @ (basis.T @ alpha)
    best = max(_pairs(_trials(angle, basis)), key=lambda pair: _reduction(pair, residual), default=())
    reduction = _reduction(best, residual)
    if not best or reduction < max(SOFT_STOP.better, SOFT_STOP.separated * _smooth_reduction(angle, basis, residual)):
        return None
    stop = max(best, key=lambda trial: _reduction((trial,), residual))
    entered = np.flatnonzero(np.diff(stop.beyond.astype(int), prepend=0) == 1)
    if len(entered) < (1 if reduction > SOFT_STOP.certain else SOFT_STOP.contacts):
        return None
    return ArmStop(stop.end, stop.angle, motion.t[entered].tolist())


def _terms(motion: LocalMotion, run: Run, number: int) -> Array:
    """Return the regressors (k, terms) of the equation of the arm.

    The regressors exclude the inertia of the arm and the stops.
    """
    (q, *theta), (speed, *w), (alpha, *al) = motion.rods.T, motion.omega.T, motion.alpha.T
    sin, cos = np.sin(theta), np.cos(theta)
    columns = [np.ones_like(q), q, speed, np.tanh(speed / TORQUES.slipping)]
    for i in range(number):
        columns.append(sin[i] ** 2 * alpha + 2 * speed * sin[i] * cos[i] * w[i])
        columns.append(cos[i] * al[i] - sin[i] * w[i] ** 2)
    if number > 1:
        columns.append(sin[0] * sin[1] * alpha + speed * (sin[1] * cos[0] * w[0] + sin[0] * cos[1] * w[1]))
    if run.arm_input is not None:
        columns.append(run.arm_input[motion.near])
    return np.column_stack(columns)


def _trials(angle: Array, basis: Array) -> tuple[list[_Trial], list[_Trial]]:
    """List trial stops at the largest and at the smallest angle."""
    low, high = float(angle.min()), float(angle.max())
    shares = np.linspace(SOFT_STOP.nearest, 1.0, SOFT_STOP.angles, endpoint=False)
    largest, smallest = list[_Trial](), list[_Trial]()
    for reach in ((high - low) * shares).tolist():
        for trials, end, where, sign in (
            (largest, "largest", low + reach, -1.0),
            (smallest, "smallest", high - reach, 1.0),
        ):
            torque = sign * np.maximum(sign * (where - angle), 0.0)
            beyond = torque != 0.0
            if 0.0 < np.mean(beyond) <= SOFT_STOP.rarely:
                trials.append(_Trial(end, where, beyond, torque - basis @ (basis.T @ torque)))
    return largest, smallest


def _pairs(trials: tuple[list[_Trial], list[_Trial]]) -> list[tuple[_Trial, ...]]:
    """List the candidates: single stops, and pairs of stops at both ends."""
    largest, smallest = trials
    return [*((trial,) for trial in (*largest, *smallest)), *product(largest, smallest)]


def _smooth_reduction(angle: Array, basis: Array, residual: Array) -> float:
    """Compute the factor by which a smooth torque on the arm reduces the sum of squares of a residual.

    The torque is K2 q^2 + K3 q^3 with fitted K2 and K3. q is the deviation of the angle from its mean, divided by the
    range of the angle.

    Args:
        angle: (k,) angle of the arm, rad
        basis: (k, n) orthonormal basis of the other terms of the equation, which is projected out
        residual: (k,) residual
    """
    relative = (angle - angle.mean()) / np.ptp(angle)
    columns = np.column_stack([relative**2, relative**3])
    columns -= basis @ (basis.T @ columns)
    remainder = residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]
    total = float(residual @ residual)
    return total / max(float(remainder @ remainder), 1e-12 * total, 1e-300)


def _reduction(stops: tuple[_Trial, ...], residual: Array) -> float:
    """Compute by which factor stops reduce the residual `residual` (k,).

    The factor is 1 if a stop would push outwards.
    """
    if not stops:
        return 1.0
    columns = np.column_stack([stop.column for stop in stops])
    products = columns.T @ columns
    stiffness = np.linalg.lstsq(products, columns.T @ residual, rcond=None)[0]
    if not (stiffness > 0).all():
        return 1.0
    total = float(residual @ residual)
    return total / max(total - float(stiffness @ products @ stiffness), 1e-12 * total, 1e-300)
