"""Fit rods, arm and drive to segments by the common fitting engine."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from dpr_lab.arrays import Array, Flags
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS
from dpr_lab.errors import IdentificationError
from dpr_lab.fitting.estimate import Estimate
from dpr_lab.fitting.gauss_newton import Fit, fit
from dpr_lab.identification.merging import MergeSettings
from dpr_lab.identification.moving_arm.problem import ArmProblem, ArmRecording, Cut, arm_problem
from dpr_lab.identification.moving_arm.search import searched_start
from dpr_lab.identification.moving_arm.unknowns import STEPS
from dpr_lab.identification.ratio_fit import TO_THE_MINIMUM
from dpr_lab.rig import Rig


@dataclass(frozen=True, slots=True)
class ArmFitSettings:
    """Settings of the fit with a moving arm."""

    first_s: float = 0.25
    """Length of the first segments, s."""
    merging: MergeSettings = field(default=MergeSettings(worse=1.05, shortest_step=2.5e-4))
    """Settings of segment merging; the number of levels is not limited."""
    searched: float = 20.0
    """Reduced chi-square of the first segments above which a global search determines other initial values."""
    searched_segments: int = 32
    """Number of segments, spread over all recordings, that the global search simulates."""
    misfit: float = 1.5
    """Reduced chi-square above which the covariance accounts for residuals clustered by segment."""
    sensitive_rad: float = 0.01
    """Maximum change of a reading in a longer segment if an initial state is changed by its increment, rad.

    Above this value the central differences of a chaotic segment are inaccurate, and its fit has many local minima.
    """


ARM_FIT = ArmFitSettings()


@dataclass(frozen=True, slots=True)
class ArmFit:
    """Result of a fit with a moving arm."""

    problem: ArmProblem
    """The fitted problem."""
    fit: Fit
    """Result of the common fitting engine."""
    at_noise: float = 0.0
    """Reduced chi-square with weights from the noise, if joints are weighted by their residuals; otherwise 0."""
    merges: tuple[tuple[float, float], ...] = ()
    """Median segment length, s, and reduced chi-square, for the first segments and after each merge."""

    @property
    def estimate(self) -> Estimate:
        """Fitted `SWING_PARAMETERS` in units of the scale, and fitted initial states."""
        return self.fit.estimate

    @property
    def p(self) -> Array:
        """Array (12,) of the fitted `SWING_PARAMETERS`, in units of the scale."""
        return self.estimate.vector

    @property
    def values(self) -> Array:
        """Array (free,) of the fitted unknowns, in units of the scale."""
        return self.p[self.problem.unknowns.places]

    @property
    def information(self) -> Array:
        """Fisher information (free, free) of the unknowns, after elimination of the initial states."""
        rows = np.vstack([self.fit.linear.flat[0], self.fit.prior])
        return rows.T @ rows

    @property
    def converged(self) -> bool:
        """Whether the fit reached a minimum."""
        return self.fit.converged

    @property
    def chi2_per_dof(self) -> float:
        """Reduced chi-square; 1 = noise only."""
        return self.fit.chi2 / max(self.problem.dof, 1)

    @property
    def misfit(self) -> float:
        """Reduced chi-square with weights from the noise of the readings.

        The fit itself may weight each joint by its residuals.
        """
        return self.at_noise or self.chi2_per_dof

    def value(self, parameter: str) -> float:
        """Return the fitted value of one of the `SWING_PARAMETERS`, in units of the scale."""
        return float(self.p[SWING_PARAMETERS.index(parameter)])

    @property
    def rms(self) -> Array:
        """(3,) rms residual of each joint's readings, rad, with nan for a joint without readings."""
        read = self.problem.read
        residuals = self.problem.measured - self.problem.predict(self.estimate)
        squares = np.sum(residuals**2, axis=0, where=read)
        return np.sqrt(squares / np.where(read.any(axis=0), read.sum(axis=0), np.nan))


def fit_moving_arm(recordings: Sequence[ArmRecording], rig: Rig, settings: ArmFitSettings = ARM_FIT) -> ArmFit:
    """Fit segments of 0.25 s, then merge them while the model follows the readings.

    Raises:
        IdentificationError: the values of the rig file cannot be simulated.
    """
    best = fit_short_segments(recordings, rig, settings)
    merges = [_length_and_misfit(best)]
    limit, ranges = settings.merging.worse * max(1.0, best.chi2_per_dof), list(settings.merging.ranges_rad)
    while ranges:
        longer = merged(best.problem, best.estimate, ranges[0])
        if longer is None:
            break
        # Initial states are fitted first, so that the start of longer segments is not worse than that of short ones.
        start = fit_segments(*longer, states_only=True)
        trial = fit_segments(start.problem, start.estimate)
        if trial.converged and trial.chi2_per_dof < limit:
            best = trial
            merges.append(_length_and_misfit(best))
        else:
            ranges.pop(0)
    if best.chi2_per_dof > settings.misfit:
        # A residual above the noise is treated as noise: joints are weighted by their residuals.
        std = np.fmax(best.rms, np.max([recording.std for recording in recordings], axis=0))
        weighed = replace(best.problem, weight=np.where(best.problem.read, 1.0 / std, 0.0))
        refitted = fit_segments(weighed, best.estimate)
        return replace(refitted, at_noise=best.chi2_per_dof, merges=tuple(merges))
    return replace(best, merges=tuple(merges))


def _length_and_misfit(fit: ArmFit) -> tuple[float, float]:
    return float(np.median(fit.problem.lengths_s)), fit.chi2_per_dof


def merged(problem: ArmProblem, estimate: Estimate, near_rad: float) -> tuple[ArmProblem, Estimate] | None:
    """Merge adjacent segments, and return them with their initial states.

    The result is None if no segments can be merged.

    Args:
        problem: problem of the current segments
        estimate: fitted parameters and initial states
        near_rad: maximum distance of the free run of the first segment from the readings of the second segment, rad
    """
    cuts, step = problem.cuts, problem.max_step
    pairs = {
        first: (piece[0], slice(piece[1].start, other[1].stop))
        for first, (piece, other) in enumerate(pairwise(cuts))
        if piece[0] == other[0]
    }
    if not pairs:
        return None
    start = Estimate(estimate.vector, estimate.initial[list(pairs)])
    longer = problem.with_cuts(list(pairs.values()), step)
    near, exact = _following(longer, start, near_rad)
    while (near & ~exact).any() and step > ARM_FIT.merging.shortest_step:
        step /= 2
        near, exact = _following(problem.with_cuts(longer.cuts, step), start, near_rad)
    follows = {first for first, good in zip(pairs, near & exact, strict=True) if good}
    pieces, begins, index = list[Cut](), list[int](), 0
    while index < len(cuts):
        pieces.append(pairs[index] if index in follows else cuts[index])
        begins.append(index)
        index += 2 if index in follows else 1
    if len(pieces) == len(cuts):
        return None
    return problem.with_cuts(pieces, step), Estimate(estimate.vector, estimate.initial[begins])


def _following(longer: ArmProblem, start: Estimate, near_rad: float) -> tuple[Flags, Flags]:
    """Check for each segment whether its free run is accurate.

    Returns:
        (segments,) whether the free run stays near all readings with accurate derivatives, and (segments,) whether the
        integration error is negligible
    """
    finer = longer.with_cuts(longer.cuts, longer.max_step / 2)
    with np.errstate(invalid="ignore", over="ignore"):
        readings = longer.predict(start)
        changes = STEPS.state * np.abs(longer.slopes(start, ())).max(axis=2)
        near = ~longer.read | ((np.abs(readings - longer.measured) < near_rad) & (changes < ARM_FIT.sensitive_rad))
        exact = ~longer.read | (longer.weight * np.abs(readings - finer.predict(start)) < ARM_FIT.merging.solver_error)
    firsts = longer.segments.offsets[:-1]
    return np.logical_and.reduceat(near.all(axis=1), firsts), np.logical_and.reduceat(exact.all(axis=1), firsts)


def fit_short_segments(recordings: Sequence[ArmRecording], rig: Rig, settings: ArmFitSettings = ARM_FIT) -> ArmFit:
    """Fit segments of the first length, starting from the rig file.

    If this fit fails or has a large residual, a fit from a global search is also made, and the better fit is returned.

    Raises:
        IdentificationError: the simulation fails for both initial values.
    """
    problem, initial = arm_problem(recordings, rig, settings.first_s)
    failed, fits = IdentificationError("no values within the bounds of the rig file can be simulated"), list[ArmFit]()
    try:
        fits.append(fit_segments(problem, _start(problem, initial)))
    except IdentificationError as error:
        failed = error
    if fits and fits[0].converged and fits[0].chi2_per_dof < settings.searched:
        return fits[0]
    spread = _spread(problem, settings.searched_segments)
    thinned = problem.with_cuts([problem.cuts[s] for s in spread])
    start = searched_start(thinned, initial[spread])
    if start is not None:
        with suppress(IdentificationError):
            fits.append(fit_segments(problem, Estimate(start, initial)))
    if not fits:
        raise failed
    return min(fits, key=lambda fit: fit.chi2_per_dof)


def _spread(problem: ArmProblem, most: int) -> list[int]:
    """Return the sorted indices of about `most` evenly spaced segments and the first segment of each recording."""
    count, firsts = len(problem.cuts), problem.segments.chains[:-1].tolist()
    return sorted({*firsts, *range(0, count, -(-count // most))})


def _start(problem: ArmProblem, initial: Array) -> Estimate:
    """Return initial values from the rig file, with a gain of zero if this fits better.

    A gain of zero fits better if the unit or the sign of the input is incorrect.
    """
    start = Estimate(problem.unknowns.start, initial)
    if "gain" not in problem.unknowns.free:
        return start
    without = Estimate(start.vector.copy(), initial)
    without.vector[SWING_PARAMETERS.index("gain")] = 0.0
    passive = fit_segments(problem, without, 5, states_only=True)
    try:
        driven = fit_segments(problem, start, 5, states_only=True)
    except IdentificationError:
        return without
    return start if driven.chi2_per_dof < passive.chi2_per_dof else without


def fit_segments(
    problem: ArmProblem, start: Estimate, iterations: int = ARM_FIT.merging.iterations, *, states_only: bool = False
) -> ArmFit:
    """Fit the unknowns and the initial states of given segments; with `states_only`, only the initial states.

    Raises:
        IdentificationError: the initial values cannot be simulated.
    """
    if not np.isfinite(problem.chi2(start)):
        raise IdentificationError(
            "the arm and rods of the rig file cannot be simulated: check [arm], [motor] and [parameters], and the units"
            " of the angles"
        )
    free = () if states_only else problem.unknowns.parameters
    return ArmFit(problem, fit(problem, start, free, iterations=iterations, settings=TO_THE_MINIMUM))


def covariance_of(fit: ArmFit) -> Array:
    """Estimate the covariance (free, free) of the unknowns.

    Undetermined directions have very large variances. If the residual exceeds the noise, each variance is at least that
    for residuals clustered by segment (White 1980). For few segments this clustered variance alone would be far too
    small, because the gradients sum to zero at the minimum.
    """
    scale = np.where(np.diag(fit.information) > 0, np.sqrt(np.diag(fit.information)), 1.0)
    values, vectors = np.linalg.eigh(fit.information / np.outer(scale, scale))
    inverse = (vectors / np.maximum(values, 1e-14)) @ vectors.T / np.outer(scale, scale)
    white = inverse * max(1.0, fit.chi2_per_dof)
    if not fit.at_noise:
        return white
    linear = fit.fit.linear
    n = len(linear.e)
    moved = np.einsum("smk,sm->sk", linear.A, linear.e) @ inverse  # (segment, free)
    clustered = np.sum(moved**2, axis=0) * n / max(n - len(fit.values), 1)
    widen = np.sqrt(np.maximum(clustered / np.diag(white), 1.0))
    return white * np.outer(widen, widen)
