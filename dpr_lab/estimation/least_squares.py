"""Segment least squares: the ratios and every segment's start state, by Gauss-Newton with backtracking.

    minimise  sum over segments s, samples k  | W_run(s) (theta_sk - theta_hat(t_k; q, x_s)) |^2

over the unknowns q and the start states x_s (4 each). q holds the five ratios; where a run was recorded with a known
mass clamped on, it also holds b itself, because the known mass sets the scale:

    run's base parameters = b (a/b, 1, d/b, e1/b, c1/b, c2/b) + what the known mass adds

A start state touches its own segment only, so it is eliminated there by QR: with B = dresidual/dx_s = QR, the projected
A~ = (I - Q Q^T) A and e~ = (I - Q Q^T) e leave five or six normal equations however many segments there are.

Source: multiple shooting, H. G. Bock (1983); variable projection, Golub & Pereyra (1973).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from dpr_lab.dynamics.base import BASE, RATIOS, base_from_ratios, ratio_slopes
from dpr_lab.dynamics.base import ratios as ratios_of
from dpr_lab.dynamics.segments import segments as laid_end_to_end
from dpr_lab.dynamics.sensitivity import sensitivities
from dpr_lab.estimation.segments import Segment, restart

BLOCK_S = 0.5  # residuals further apart than half a swing are taken as independent in the covariance
FRACTIONS = (1.0, 0.3, 0.1, 0.03, 0.01, 1e-3, 1e-4)  # of a step, until the cost falls
SETTLED = 1e-8  # relative fall of the cost in a whole step that ends the iteration
MISFIT = 1.5  # reduced chi-square above which the model, not the noise, decides how uncertain the result is
HALVES = 1.1  # one linear step understates how far apart the halves' own fits end
NORMAL_90 = 1.6449  # standard deviations in half a 90 % interval
RIDGE = 1e-10  # keeps a parameter that the data do not reach where it is
FRICTION = slice(3, 5)  # c1/b, c2/b cannot be negative
UNKNOWNS = (*RATIOS, "b")
"""Order of the unknowns; b only where a known added mass makes it visible, kg m^2."""

_B = BASE.index("b")
_OTHERS = [i for i in range(len(BASE)) if i != _B]


@dataclass(frozen=True, slots=True)
class Conditions:
    """What a fit takes as known."""

    L1: float
    """Inner rod's length, m."""
    g: float
    whitening: tuple[NDArray[np.float64], ...]
    """Per run the (2, 2) matrix W with W cov W^T = I for the noise of (theta1, theta2), 1/rad."""
    added: tuple[NDArray[np.float64], ...] = ()
    """Per run the (6,) base parameters of the known mass clamped on, SI; empty when there never was one."""

    @property
    def unknowns(self) -> int:
        """Five ratios, and b where a known mass makes it visible."""
        return 6 if any(np.any(extra) for extra in self.added) else 5

    def loading(self, run: int) -> tuple[float, ...]:
        """What was clamped on during a run; runs alike in it swing by the same ratios."""
        return tuple(self.added[run]) if self.unknowns == 6 else ()

    def ratios(self, q: NDArray[np.float64], run: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(5,) the ratios that a run swings by, and their (5, unknowns) derivative with respect to q."""
        slopes = np.eye(5, len(q))
        if len(q) == 5 or not np.any(self.added[run]):
            return q[:5], slopes
        unit, b = base_from_ratios(q[:5]), q[5]
        base = b * unit + self.added[run]
        base_slopes = np.zeros((6, 6))
        base_slopes[_OTHERS, :5], base_slopes[:, 5] = b * np.eye(5), unit
        return ratios_of(base), ratio_slopes(base) @ base_slopes


@dataclass(frozen=True, slots=True)
class SegmentFit:
    """Where the Gauss-Newton iteration ended."""

    unknowns: NDArray[np.float64]
    """(5 or 6,) in the order of `UNKNOWNS`."""
    segments: tuple[Segment, ...]
    """The segments with their fitted start states."""
    predicted: tuple[NDArray[np.float64], ...]
    """(n, 2) fitted theta1, theta2 of each segment, rad."""
    start_covariances: tuple[NDArray[np.float64], ...]
    """(4, 4) covariance of each start state from the noise alone, the unknowns taken as known."""
    information: NDArray[np.float64]
    """Fisher information of the unknowns, start states eliminated."""
    covariance: NDArray[np.float64]
    """Covariance of the unknowns, valid under autocorrelated residuals (blocks as units)."""
    blocks: int
    chi2: float
    chi2_by_segment: tuple[float, ...]
    dof: int
    iterations: int
    converged: bool

    @property
    def ratios(self) -> NDArray[np.float64]:
        """(5,) a/b, d/b, e1/b, c1/b, c2/b of the rig without any added mass."""
        return self.unknowns[:5]

    @property
    def chi2_per_dof(self) -> float:
        """Reduced chi-square; 1 = nothing left but noise."""
        return self.chi2 / self.dof

    @property
    def at_zero(self) -> tuple[str, ...]:
        """Friction ratios held at zero because the data ask for less."""
        return tuple(name for name, value in zip(RATIOS, self.ratios, strict=True) if value <= 0)

    @property
    def cramer_rao_std(self) -> NDArray[np.float64]:
        """Least standard deviation any unbiased estimate can have at this noise; zero for what is held at zero."""
        free = self.unknowns > 0
        std = np.zeros(len(free))
        std[free] = np.sqrt(np.diag(np.linalg.inv(self.information[np.ix_(free, free)])))
        return std

    def interval90(self, index: int) -> tuple[float, float]:
        """90 % interval of one unknown, Student-t with the blocks as units."""
        freedom = max(self.blocks - len(self.unknowns), 1)
        reach = float(stdtrit(freedom, 0.95)) * self.covariance[index, index] ** 0.5
        return float(self.unknowns[index] - reach), float(self.unknowns[index] + reach)


def fit_segments(
    start: NDArray[np.float64],
    segments: Sequence[Segment],
    known: Conditions,
    *,
    held: Sequence[int] = (),
    max_iterations: int = 40,
) -> SegmentFit:
    """Fit the unknowns and the start states to segments of fixed length.

    Args:
        start: (5 or 6,) unknowns to start from
        segments: what to fit; their `run` indexes what is known of each run
        known: lengths, noise, added masses
        held: places of unknowns that stay as they are: all of them for a run that is held out, one for its profile
        max_iterations: give up (`converged` false) after as many
    """
    q, current = start, list(segments)
    linear = _linearise(q, current, known)
    cost, converged, iteration = _cost(linear), False, 0
    while iteration < max_iterations and not converged:
        iteration += 1
        step = _step(q, linear, held)
        starts = np.array([segment.start for segment in current])
        start_steps = _start_steps(linear, step)
        converged = True
        for fraction in FRACTIONS:
            trial = restart(current, starts + fraction * start_steps)
            trial_linear = _linearise(q + fraction * step, trial, known)
            trial_cost = _cost(trial_linear)
            if trial_cost < cost:
                converged = fraction == 1.0 and cost - trial_cost <= SETTLED * cost
                q, current, linear, cost = q + fraction * step, trial, trial_linear, trial_cost
                break
    return _result(q, current, linear, iteration, converged)


def carried(fit: SegmentFit, step: NDArray[np.float64], known: Conditions) -> list[Segment]:
    """The segments with start states that follow a step of the unknowns, to first order."""
    linear = _linearise(fit.unknowns, fit.segments, known)
    moves = [np.linalg.solve(part.R, -part.Q.T @ (part.slopes @ step)) for part in linear]
    return [replace(s, start=s.start + move) for s, move in zip(fit.segments, moves, strict=True)]


def information(q: NDArray[np.float64], segments: Sequence[Segment], known: Conditions) -> NDArray[np.float64]:
    """Fisher information that segments hold of the unknowns, start states eliminated; arguments of `fit_segments`."""
    return sum((part.A.T @ part.A for part in _linearise(q, segments, known)), np.zeros((len(q), len(q))))


@dataclass(frozen=True, slots=True)
class _Linear:
    """A segment around the current unknowns; A and e are projected, that is free of the start state."""

    residual: NDArray[np.float64]  # (2n,) whitened
    slopes: NDArray[np.float64]  # (2n, unknowns)
    Q: NDArray[np.float64]  # (2n, 4)
    R: NDArray[np.float64]  # (4, 4)
    A: NDArray[np.float64]  # (2n, unknowns)
    e: NDArray[np.float64]  # (2n,)
    predicted: NDArray[np.float64]  # (n, 2)


def _linearise(q: NDArray[np.float64], segments: Sequence[Segment], known: Conditions) -> list[_Linear]:
    linear: dict[int, _Linear] = {}
    for loading in sorted({known.loading(segment.run) for segment in segments}):
        alike = [i for i, segment in enumerate(segments) if known.loading(segment.run) == loading]
        ratios, chain = known.ratios(q, segments[alike[0]].run)
        swings = laid_end_to_end(
            [segments[i].t for i in alike],
            np.array([segments[i].start for i in alike]),
            [segments[i].max_step for i in alike],
        )
        states, slopes = sensitivities(ratios, known.L1, known.g, swings)
        for i, (first, last) in zip(alike, pairwise(swings.offsets), strict=True):
            W = known.whitening[segments[i].run]
            linear[i] = _whitened(segments[i].theta, states[first:last, :2], slopes[first:last, :2], W, chain)
    return [linear[i] for i in range(len(segments))]


def _whitened(
    measured: NDArray[np.float64],
    predicted: NDArray[np.float64],
    slopes: NDArray[np.float64],
    W: NDArray[np.float64],
    chain: NDArray[np.float64],
) -> _Linear:
    residual = ((measured - predicted) @ W.T).ravel()
    jacobian = (W @ slopes).reshape(len(residual), -1)
    if not np.isfinite(jacobian).all():
        nothing = np.zeros((len(residual), chain.shape[1]))
        failed = np.full(len(residual), np.inf)
        return _Linear(failed, nothing, np.zeros((len(residual), 4)), np.eye(4), nothing, failed, predicted)
    of_unknowns = jacobian[:, :5] @ chain
    Q, R = np.linalg.qr(jacobian[:, 5:])
    A, e = of_unknowns - Q @ (Q.T @ of_unknowns), residual - Q @ (Q.T @ residual)
    return _Linear(residual, of_unknowns, Q, R, A, e, predicted)


def _cost(linear: Sequence[_Linear]) -> float:
    return float(sum(np.sum(part.residual**2) for part in linear))


def _step(q: NDArray[np.float64], linear: Sequence[_Linear], held: Sequence[int]) -> NDArray[np.float64]:
    """The Gauss-Newton step; friction that would turn negative stops at zero and the others are solved again."""
    H = np.sum([part.A.T @ part.A for part in linear], axis=0)
    gradient = np.sum([part.A.T @ part.e for part in linear], axis=0)
    free, step = np.ones(len(q), dtype=bool), np.zeros(len(q))
    free[list(held)] = False
    at_zero = np.zeros(len(q), dtype=bool)
    while free.any():
        inner = H[np.ix_(free, free)]
        step[:] = -q * at_zero
        step[free] = np.linalg.solve(inner + RIDGE * np.diag(np.diag(inner)), (gradient - H @ step)[free])
        below = np.zeros(len(q), dtype=bool)
        below[FRICTION] = (q + step)[FRICTION] < 0
        if not (below & free).any():
            break
        at_zero |= below & free
        free &= ~below
    return step


def _start_steps(linear: Sequence[_Linear], step: NDArray[np.float64]) -> NDArray[np.float64]:
    """(segments, 4) the start states' share of a step."""
    steps = [np.linalg.solve(part.R, part.Q.T @ (part.residual - part.slopes @ step)) for part in linear]
    return np.array(steps, dtype=np.float64)


def _result(
    q: NDArray[np.float64], segments: Sequence[Segment], linear: Sequence[_Linear], iterations: int, converged: bool
) -> SegmentFit:
    H = np.sum([part.A.T @ part.A for part in linear], axis=0)
    scores = np.concatenate([_block_scores(s, part) for s, part in zip(segments, linear, strict=True)])
    dof = sum(len(part.residual) - 4 for part in linear) - len(q)
    inverses = [np.linalg.inv(part.R) for part in linear]
    return SegmentFit(
        unknowns=q,
        segments=tuple(segments),
        predicted=tuple(part.predicted for part in linear),
        start_covariances=tuple(inverse @ inverse.T for inverse in inverses),
        information=H,
        covariance=_covariance(H, scores, _cost(linear) / dof, _halves_disagree(segments, linear, len(q)), q > 0),
        blocks=len(scores),
        chi2=_cost(linear),
        chi2_by_segment=tuple(float(np.sum(part.residual**2)) for part in linear),
        dof=dof,
        iterations=iterations,
        converged=converged,
    )


def _covariance(
    H: NDArray[np.float64],
    scores: NDArray[np.float64],
    chi2_per_dof: float,
    halves: NDArray[np.float64],
    free: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Covariance from the information at the noise that is there, widened to what the scatter of the blocks asks for.

    White residuals make both agree, and the information is the exacter of the two, because a chaotic run holds most of
    it in few blocks; correlated residuals make the blocks scatter more. What a wrong model leaves changes slowly along
    a run, so there the 90 % interval is also no narrower than what first and second halves disagree by.
    """
    bread = np.linalg.inv(H[np.ix_(free, free)])
    white = bread * chi2_per_dof
    blocks = len(scores) / max(len(scores) - len(H), 1) * bread @ scores[:, free].T @ scores[:, free] @ bread
    variance = np.maximum(np.diag(white), np.diag(blocks))
    if chi2_per_dof > MISFIT:
        variance = np.maximum(variance, (HALVES * halves[free] / 2 / NORMAL_90) ** 2)
    widen = np.sqrt(variance / np.diag(white))
    covariance = np.zeros_like(H)
    covariance[np.ix_(free, free)] = white * np.outer(widen, widen)
    return covariance


def _halves_disagree(segments: Sequence[Segment], linear: Sequence[_Linear], unknowns: int) -> NDArray[np.float64]:
    """(unknowns,) how far apart one Gauss-Newton step takes the first and the second halves of the runs."""
    middle = {run: max(s.t[-1] for s in segments if s.run == run) / 2 for run in {s.run for s in segments}}
    steps = []
    for second in (False, True):
        parts = [p for s, p in zip(segments, linear, strict=True) if (s.t.mean() > middle[s.run]) == second]
        H = sum((part.A.T @ part.A for part in parts), np.zeros((unknowns, unknowns)))
        gradient = sum((part.A.T @ part.e for part in parts), np.zeros(unknowns))
        steps.append(np.linalg.pinv(H, hermitian=True) @ gradient)
    return np.abs(steps[1] - steps[0])


def _block_scores(segment: Segment, part: _Linear) -> NDArray[np.float64]:
    """(blocks, unknowns) gradient of each stretch of `BLOCK_S`: the independent units of the covariance."""
    blocks = np.repeat(((segment.t - segment.t[0]) // BLOCK_S).astype(int), 2)
    edges = np.flatnonzero(np.diff(blocks, prepend=-1))
    return np.add.reduceat(part.A * part.e[:, None], edges, axis=0)
