"""Gauss-Newton fit with Marquardt damping, on segments whose free initial states are eliminated."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dpr_lab.arrays import Array
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS
from dpr_lab.errors import IdentificationError
from dpr_lab.identification.moving_arm.merge import merged
from dpr_lab.identification.moving_arm.problem import ArmProblem, ArmRecording, arm_problem, problem_of
from dpr_lab.identification.moving_arm.search import searched_start
from dpr_lab.rig import Rig


@dataclass(frozen=True, slots=True)
class ArmFitSettings:
    """Settings of the fit with a moving arm."""

    first_s: float = 0.25
    """Length of the first segments, s."""
    ranges_rad: tuple[float, ...] = (0.2, 0.05, 0.0125)
    """Maximum distance of the free run of a segment from the readings of the next one for which both are merged, rad.

    After a failed merge, the next smaller distance is tried.
    """
    worse: float = 1.05
    """Maximum growth factor of the reduced chi-square for which merged segments are kept."""
    iterations: int = 100
    """Maximum number of iterations of each fit."""
    converged: float = 1e-5
    """Limit of convergence: reduction of chi-square by a step with little damping.

    The reduction is relative to the degrees of freedom, or per unknown.
    """
    damping: float = 1e-3
    """Initial damping, relative to the diagonal of the normal equations."""
    most_damping: float = 1e9
    """Maximum damping; with more damping, no step can reduce the cost."""
    searched: float = 20.0
    """Reduced chi-square of the first segments above which a global search determines other initial values."""
    searched_segments: int = 32
    """Number of segments, spread over all recordings, that the global search simulates."""
    misfit: float = 1.5
    """Reduced chi-square above which the covariance accounts for residuals clustered by segment."""


ARM_FIT = ArmFitSettings()


@dataclass(frozen=True, slots=True)
class ArmFit:
    """Result of a fit with a moving arm."""

    problem: ArmProblem
    """The fitted problem."""
    p: Array
    """(12,) fitted `SWING_PARAMETERS` in units of the scale."""
    initial: Array
    """(segments, 6) fitted initial states, rad and rad/s."""
    converged: bool
    """Whether the fit reached a minimum."""
    information: Array
    """(free, free) Fisher information of the unknowns at the noise floor, with initial states eliminated."""
    scores: Array
    """(segments, free) gradient of half the chi-square of each segment, with initial states eliminated."""
    misfit: float = 0.0
    """Reduced chi-square at the noise of the readings, if the joints are weighted by their residuals; otherwise 0."""
    merges: tuple[tuple[float, float], ...] = ()
    """Median segment length, s, and reduced chi-square, for the first segments and after each merge."""

    @property
    def values(self) -> Array:
        """(free,) estimated unknowns."""
        return self.p[self.problem.unknowns.places]

    @property
    def chi2_per_dof(self) -> float:
        """Reduced chi-square; 1 = noise only."""
        residuals = self.problem.residuals(self.p, self.initial)
        return float(np.sum(residuals**2)) / max(self.problem.dof, 1)

    @property
    def rms(self) -> Array:
        """(3,) rms residual of the readings of each joint, rad; nan without readings."""
        away = self.problem.measured - self.problem.predict(self.p, self.initial)
        read = self.problem.weight > 0
        squares = np.sum(np.where(read, away, 0.0) ** 2, axis=0)
        return np.sqrt(squares / np.where(read.any(axis=0), np.maximum(read.sum(axis=0), 1), np.nan))


def fit_moving_arm(recordings: Sequence[ArmRecording], rig: Rig, settings: ArmFitSettings = ARM_FIT) -> ArmFit:
    """Fit the unknowns to segments of a quarter of a second, then merge segments as far as the model follows.

    Raises:
        IdentificationError: the values of the rig file cannot be simulated.
    """
    problem, initial = arm_problem(recordings, rig, settings.first_s)
    best = _short_fit(problem, initial, recordings, rig, settings)
    merges = [_length_and_misfit(best)]
    limit, ranges = settings.worse * max(1.0, best.chi2_per_dof), list(settings.ranges_rad)
    while ranges:
        longer = merged(best.problem, best.p, best.initial, recordings, rig, ranges[0])
        if longer is None:
            break
        # Initial states are fitted first, so that the start of longer segments is not worse than that of short ones.
        start = fit_segments(longer[0], best.p, longer[1], settings, states_only=True)
        trial = fit_segments(longer[0], best.p, start.initial, settings)
        if trial.converged and trial.chi2_per_dof < limit:
            best = trial
            merges.append(_length_and_misfit(best))
        else:
            ranges.pop(0)
    if best.chi2_per_dof > settings.misfit:
        # A residual above the noise is treated as noise: joints are weighted by their residuals.
        std = np.fmax(best.rms, np.max([recording.std for recording in recordings], axis=0))
        weighed = fit_segments(best.problem.with_std(std), best.p, best.initial, settings)
        return replace(weighed, misfit=best.chi2_per_dof, merges=tuple(merges))
    return replace(best, merges=tuple(merges))


def _length_and_misfit(fit: ArmFit) -> tuple[float, float]:
    return float(np.median(fit.problem.lengths_s)), fit.chi2_per_dof


def _short_fit(
    problem: ArmProblem, initial: Array, recordings: Sequence[ArmRecording], rig: Rig, settings: ArmFitSettings
) -> ArmFit:
    """Fit of the first segments from the values of the rig file, or from a global search if this fails.

    Raises:
        IdentificationError: neither can be simulated.
    """
    failed: IdentificationError | None = None
    local: ArmFit | None = None
    try:
        local = fit_segments(problem, _start(problem, initial, settings), initial, settings)
    except IdentificationError as error:
        failed = error
    if local is not None and local.converged and local.chi2_per_dof < settings.searched:
        return local
    spread = _spread(problem, settings.searched_segments)
    thinned = problem_of(recordings, rig, [problem.cuts[s] for s in spread])
    start = searched_start(thinned, initial[spread], rig)
    fits = [local] if local is not None else []
    if start is not None:
        with suppress(IdentificationError):
            fits.append(fit_segments(problem, start, initial, settings))
    if not fits:
        raise failed or IdentificationError("no values within the bounds of the rig file can be simulated")
    return min(fits, key=lambda fit: fit.chi2_per_dof)


def _spread(problem: ArmProblem, most: int) -> list[int]:
    """Indices of about `most` segments at equal distances, and of the first segment of each recording."""
    first = {recording: s for s, (recording, _) in reversed(list(enumerate(problem.cuts)))}
    return sorted({*first.values(), *range(0, len(problem.cuts), -(-len(problem.cuts) // most))})


def _start(problem: ArmProblem, initial: Array, settings: ArmFitSettings) -> Array:
    """(12,) initial values from the rig file; the gain is zero if this fits better.

    The unit or the sign of the input may be wrong.
    """
    start = problem.unknowns.start
    if "gain" not in problem.unknowns.free:
        return start
    without = np.where(np.arange(len(start)) == SWING_PARAMETERS.index("gain"), 0.0, start)
    short = replace(settings, iterations=5)
    passive = fit_segments(problem, without, initial, short, states_only=True)
    try:
        driven = fit_segments(problem, start, initial, short, states_only=True)
    except IdentificationError:
        return without
    return start if driven.chi2_per_dof < passive.chi2_per_dof else without


def fit_segments(
    problem: ArmProblem,
    p: Array,
    initial: Array,
    settings: ArmFitSettings = ARM_FIT,
    *,
    states_only: bool = False,
) -> ArmFit:
    """Fit unknowns and initial states to given segments; arguments as in `ArmFit`.

    Raises:
        IdentificationError: the initial values cannot be simulated.
    """
    places = [] if states_only else problem.unknowns.places
    positive = [SWING_PARAMETERS.index(name) for name in problem.unknowns.positive]
    start, prior = problem.unknowns.start, problem.prior
    p, initial, damping, converged = p.copy(), initial.copy(), settings.damping, False

    def cost(trial: Array, residuals: Array) -> float:
        away = prior * (trial - start)[problem.unknowns.places]
        with np.errstate(over="ignore", invalid="ignore"):
            total = float(np.sum(residuals**2) + np.sum(away**2))
        return total if np.isfinite(total) and (trial[positive] > 0).all() else np.inf

    residuals = problem.residuals(p, initial)
    now, slopes = cost(p, residuals), _slopes(problem, p, initial)
    if slopes is None or not np.isfinite(now):
        raise IdentificationError(
            "the arm and rods of the rig file cannot be simulated over a quarter of a second: check [arm], [motor] and"
            " [parameters], and the units of the angles"
        )
    for _ in range(settings.iterations):
        linear = _Eliminated(problem, residuals, *slopes, damping)
        step = np.zeros(len(p))
        if places:
            H = linear.information + np.diag(prior**2)
            gradient = linear.scores.sum(axis=0) - prior**2 * (p - start)[places]
            step[places] = _solved(H + damping * np.diag(np.diag(H)), gradient)
        trial, states = p + step, initial + linear.states(step[problem.unknowns.places])
        new = problem.residuals(trial, states)
        then = cost(trial, new)
        next_slopes = _slopes(problem, trial, states) if then < now else None
        if next_slopes is not None:
            gained = (now - then) / max(now, 1e-300)
            p, initial, residuals, now, slopes = trial, states, new, then, next_slopes
            # a small reduction by a damped step does not show convergence, because the valley of a long segment is
            # curved
            if damping <= settings.damping and gained < settings.converged * len(step) / max(problem.dof, 1):
                converged = True
                break
            damping = max(damping / 10, 1e-12)
        else:
            damping *= 10
            if damping > settings.most_damping:
                converged = True  # no step reduces the cost: the minimum is reached within rounding errors
                break
    linear = _Eliminated(problem, residuals, *slopes, 0.0)
    return ArmFit(problem, p, initial, converged, linear.information + np.diag(prior**2), linear.scores)


def _slopes(problem: ArmProblem, p: Array, initial: Array) -> tuple[Array, Array] | None:
    """Derivatives with respect to unknowns and to initial states; None if they are too large for normal equations."""
    by_unknowns, by_states = problem.slopes(p, initial)
    with np.errstate(over="ignore", invalid="ignore"):
        sizes = np.sum(by_unknowns**2), np.sum(by_states**2)
    return (by_unknowns, by_states) if np.isfinite(sizes).all() else None


class _Eliminated:
    """Normal equations of the unknowns, with the initial state of each segment eliminated by a Schur complement."""

    def __init__(
        self, problem: ArmProblem, residuals: Array, by_unknowns: Array, by_states: Array, damping: float
    ) -> None:
        size = len(problem.unknowns.free)
        self._parts: list[tuple[NDArray[np.intp], Array, Array]] = []
        self._segments = len(problem.moves)
        self.information = np.zeros((size, size))
        self.scores = np.zeros((self._segments, size))
        for s, rows in enumerate(problem.slices()):
            free = np.flatnonzero(problem.moves[s])
            B = by_states[rows].reshape(-1, 6)[:, free]
            A, r = by_unknowns[rows].reshape(-1, size), residuals[rows].ravel()
            damped = np.vstack([B, np.sqrt(damping) * np.diag(np.linalg.norm(B, axis=0) + 1e-12)])
            Q, R = np.linalg.qr(damped)
            Q = Q[: len(r)]
            inward: Array = np.linalg.solve(R, np.column_stack([Q.T @ r, Q.T @ A])).astype(np.float64)
            self._parts.append((free, inward[:, 0], inward[:, 1:]))
            remainder = A - Q @ (Q.T @ A)
            self.information += A.T @ remainder
            self.scores[s] = remainder.T @ r

    def states(self, step: Array) -> Array:
        """(segments, 6) change of the initial states for a step (free,) of the unknowns."""
        change = np.zeros((self._segments, 6))
        for s, (free, slopes, by_step) in enumerate(self._parts):
            change[s, free] = slopes - by_step @ step
        return change


def _solved(H: Array, gradient: Array) -> Array:
    scale = 1.0 / np.sqrt(np.maximum(np.diag(H), 1e-300))
    return scale * np.linalg.lstsq(H * np.outer(scale, scale), scale * gradient, rcond=1e-13)[0]


def covariance_of(fit: ArmFit) -> Array:
    """(free, free) covariance of the unknowns; very large in undetermined directions.

    If the residual exceeds the noise, the covariance is computed for residuals clustered by segment (White 1980).
    """
    scale = np.where(np.diag(fit.information) > 0, np.sqrt(np.diag(fit.information)), 1.0)
    values, vectors = np.linalg.eigh(fit.information / np.outer(scale, scale))
    inverse = (vectors / np.maximum(values, 1e-14)) @ vectors.T / np.outer(scale, scale)
    if not fit.misfit:
        return inverse * max(1.0, fit.chi2_per_dof)
    n = len(fit.scores)
    # (segment, free); computed as a square, every variance stays positive in spite of rounding
    moved = fit.scores @ inverse
    return moved.T @ moved * n / max(n - len(fit.values), 1)
