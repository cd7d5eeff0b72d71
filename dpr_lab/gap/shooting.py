"""Multiple shooting with effects: five ratios, parameters of chosen effects, free start states of every segment.

    minimise  sum over segments s, samples k  w_sk | (y_sk - readings(t_sk; p, x_s)) / sigma_sk |^2

by damped Gauss-Newton with bounds. All derivatives are forward differences made in one batched call. A start state
touches its own segment only and is eliminated there by QR: with B = dreadings/dx_s = Q R the projected
A = (I - Q Q^T) dreadings/dp and e = (I - Q Q^T) residual leave normal equations as small as p. They are kept by
segment, because everything that is asked of a fit afterwards (score of further effects, prediction of a release that
was left out, classes, detectable sizes) is linear algebra on them.

The common scale of all torques cannot be seen in a free swing: b is held where the rig file puts it.

Source: multiple shooting, H. G. Bock (1983); variable projection, Golub & Pereyra (1973).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from dpr_lab.gap.problem import Point, Problem, Slot

Array = NDArray[np.float64]

SETTLED = 1e-4  # relative change of the cost that ends the iteration
TRIES = 10  # shorter steps, before one counts as failed
OUTSTANDING = 9.0  # times the median chi2 of the segments
BLIND = 1e-12  # readings in standard deviations per rad below which a start state cannot be seen
FREEDOM = 4.0  # of the Student-t loss of a robust fit


@dataclass(frozen=True, slots=True)
class Linear:
    """A problem around one point: whitened, padded to equal lengths, start states projected out.

    m = 2 * samples of the longest segment; shorter ones are padded with rows of zero.
    """

    residual: Array
    """(segments, m)"""
    e: Array
    """(segments, m) residual without its part along the start states."""
    A: Array
    """(segments, m, slots) slopes without theirs."""
    slopes: Array
    """(segments, m, slots)"""
    Q: Array
    """(segments, m, 4)"""
    R: Array
    """(segments, 4, 4)"""

    def projected(self, columns: Array) -> Array:
        """(segments, m, k) whitened columns without their part along the start states."""
        return columns - self.Q @ (self.Q.transpose(0, 2, 1) @ columns)

    @property
    def cost(self) -> float:
        """Sum of squared residuals."""
        with np.errstate(over="ignore"):
            return float(self.by_segment.sum())

    @property
    def by_segment(self) -> Array:
        """(segments,) the same by segment; inf where one cannot be followed."""
        with np.errstate(over="ignore"):
            return np.sum(self.residual**2, axis=1)


@dataclass(frozen=True, slots=True)
class Fit:
    """Where the iteration ended."""

    point: Point
    slots: tuple[Slot, ...]
    linear: Linear
    converged: bool

    @property
    def chi2(self) -> float:
        """Sum of squared whitened residuals."""
        return self.linear.cost

    @property
    def chi2_by_segment(self) -> Array:
        """(segments,) the same by segment."""
        return self.linear.by_segment

    @property
    def values(self) -> Array:
        """(slots,) fitted values."""
        return np.array([slot.read(self.point) for slot in self.slots])


def linearise(problem: Problem, point: Point, slots: Sequence[Slot]) -> Linear:
    """Readings and all their slopes around a point, in one batched call; inf where a segment cannot be simulated."""
    predicted, slopes = problem.predict(point, slots)
    residual = problem.whitened(problem.measured - predicted)
    J = problem.whitened(slopes)
    bad = np.logical_not(np.isfinite(J).all(axis=(1, 2)) & np.isfinite(residual).all(axis=1))
    residual[bad], J[bad] = np.inf, 0.0
    Q, R = np.linalg.qr(J[:, :, -4:])
    blind = np.abs(np.diagonal(R, axis1=1, axis2=2)).min(axis=1) < BLIND
    R[bad | blind] = np.eye(4) / BLIND  # nothing says where its start state lies: it stays
    slopes = J[:, :, :-4]
    clean = np.where(bad[:, None], 0.0, residual)
    e = clean - (Q @ (Q.transpose(0, 2, 1) @ clean[:, :, None]))[:, :, 0]
    return Linear(residual, e, slopes - Q @ (Q.transpose(0, 2, 1) @ slopes), slopes, Q, R)


def fit(
    problem: Problem, point: Point, slots: Sequence[Slot], *, iterations: int = 12, first: Linear | None = None
) -> Fit:
    """Fit the slots and all start states.

    Args:
        problem: what was measured
        point: to start from; what is in no slot stays as it is
        slots: the unknowns besides the start states
        iterations: at most
        first: the problem linearised at `point` where that is known already
    """
    slots = tuple(slots)
    linear = first or linearise(problem, point, slots)
    damping, converged = 1e-9, False
    for _ in range(iterations):
        step = _bounded_step(linear, point, slots, damping)
        starts = start_steps(linear, step)
        trial, cost = _search(problem, point, slots, step, starts, linear.by_segment)
        if trial is None:
            damping *= 1e3
            converged = damping > 1e-1
            if converged:
                break
            continue
        gain = linear.cost - cost
        point, linear = trial, linearise(problem, trial, slots)
        damping = max(damping / 10, 1e-9)
        if gain <= SETTLED * linear.cost:
            converged = True
            break
    return Fit(point, slots, linear, converged)


def unlocked(problem: Problem, found: Fit, *, iterations: int = 12) -> Fit:
    """A fit once more, from where it leads while the few segments that it fits worst hardly count.

    One swing that passes near the upright can hold all parameters at a local minimum. The better of the two fits.
    """
    chi2 = np.minimum(found.chi2_by_segment, np.finfo(np.float64).max)
    worst = chi2 / max(float(np.median(chi2)), 1e-300)
    if not (worst > OUTSTANDING).any():
        return found
    lighter = np.repeat(1 / np.sqrt(np.maximum(worst, 1.0)), np.diff(problem.offsets))
    eased = replace(problem, weight=problem.weight * lighter[:, None])
    there = fit(eased, found.point, found.slots, iterations=iterations)
    again = fit(problem, there.point, found.slots, iterations=iterations)
    return min(found, again, key=lambda one: one.chi2)


def robust_weights(problem: Problem, found: Fit) -> Array:
    """(samples, 2) Student-t weights of a fit's residuals, each against its own channel's spread.

    Source: Lange, Little & Taylor (1989), Robust statistical modeling using the t distribution, JASA 84, 881-896.
    """
    residual = problem.by_sample(found.linear.residual)
    spread = 1.4826 * np.median(np.abs(residual), axis=0)
    return (FREEDOM + 1) / (FREEDOM + (residual / spread) ** 2)


def bounded_solution(H: Array, gradient: Array, lower: Array) -> Array:
    """The step x >= lower of normal equations H x = gradient: coordinates that would cross their bound are held."""
    free, x = np.ones(len(gradient), dtype=bool), np.zeros(len(gradient))
    for _ in range(len(gradient) + 1):
        x = np.where(free, 0.0, lower)
        if free.any():
            x[free] = np.linalg.solve(H[np.ix_(free, free)], (gradient - H @ x)[free])
        below = free & (x < lower)
        if not below.any():
            break
        free &= ~below
    return x


def _bounded_step(linear: Linear, point: Point, slots: tuple[Slot, ...], damping: float) -> Array:
    if not slots:
        return np.zeros(0)
    k = len(slots)
    A, e = linear.A.reshape(-1, k), linear.e.ravel()
    H, gradient = A.T @ A, A.T @ e
    scale = 1 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    H = H * scale[:, None] * scale + (1e-12 + damping) * np.eye(k)
    lower = np.array([slot.lower - slot.read(point) for slot in slots]) / scale
    return bounded_solution(H, gradient * scale, lower) * scale


def start_steps(linear: Linear, step: Array) -> Array:
    """(segments, 4) the start states' own least-squares steps, given that of the slots."""
    left = np.where(np.isfinite(linear.residual), linear.residual, 0.0) - linear.slopes @ step
    target = linear.Q.transpose(0, 2, 1) @ left[:, :, None]
    return np.stack([solve_triangular(R, t[:, 0], check_finite=False) for R, t in zip(linear.R, target, strict=True)])


def _search(
    problem: Problem, point: Point, slots: tuple[Slot, ...], step: Array, starts: Array, before: Array
) -> tuple[Point | None, float]:
    """The first point along the step that lowers the cost.

    A start state that would make its segment worse goes less far; one segment that passes near the upright would
    otherwise hold back all others.
    """
    share, own, followed = 1.0, np.ones(len(starts)), np.isfinite(before)
    if not followed.any():
        return None, float(before.sum())
    for attempt in range(TRIES):
        trial = moved(point, slots, share * step, (share * own)[:, None] * starts)
        costs = problem.costs(trial)
        if costs[followed].sum() <= before[followed].sum():
            return trial, float(costs.sum())
        worse = ~(costs <= before)
        if attempt % 2 or worse.mean() > 0.5:
            share *= 0.3
        else:
            own[worse] *= 0.1
    return None, float(before.sum())


def moved(point: Point, slots: Sequence[Slot], step: Array, starts: Array) -> Point:
    """The point a step further."""
    rods, vector = point.rods.copy(), point.vector.copy()
    for slot, change in zip(slots, step, strict=True):
        target = rods if slot.rods else vector
        target[slot.at] = max(target[slot.at] + change, slot.lower)
    return replace(point, rods=rods, vector=vector, starts=point.starts + starts)
