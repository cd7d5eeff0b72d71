"""Fit the ratios of the rods to segments of runs with free initial states.

A free swing determines only the ratios. With a known attached mass, the inertia b is also fitted, because the mass
determines the scale. Segments contain encoder readings, each weighted by its own noise. For a relative encoder 2, this
is equivalent to absolute angles with correlated noise.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS, whole_parameters
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.schedule import MAX_STEP
from dpr_lab.dynamics.segments import Segments, segments
from dpr_lab.effects import effect_params
from dpr_lab.fitting.cut import partition
from dpr_lab.fitting.disturbance import disturbance
from dpr_lab.fitting.estimate import (
    Estimate,
    FreeParameter,
    ratio_parameters,
    unknown_ratios,
    visible_ratios,
)
from dpr_lab.fitting.gauss_newton import Fit, GaussNewton, StopReason, fit
from dpr_lab.fitting.linearise import Linearisation, linearise
from dpr_lab.fitting.prior import prior_of
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.rods import RodsAlone, by_start, followed
from dpr_lab.fitting.whitening import Disturbance
from dpr_lab.identification.preprocess import PreprocessedRun
from dpr_lab.rig import Rig

TO_THE_MINIMUM = GaussNewton(converged=1e-8)
"""Settings of a fit whose ratios are reported.

For 6e4 readings, 1e-8 of chi2 corresponds to a fortieth of a standard deviation.
"""


@dataclass(frozen=True, slots=True)
class ShortSegments:
    """Lengths of the segments in the first two fits."""

    first_segment_s: float = 0.25
    """First length, s; the fit converges from all initial values with errors of at most 20 %."""
    working_segment_s: float = 0.5
    """Second length, s; the model cannot follow an incorrect interpretation over this length."""
    noise_alone: float = 20.0
    """Maximum reduced chi-square for which the noise of the inputs is relevant.

    Above this value, the model error is far larger than this noise.
    """
    nested: float = 1.1
    """Maximum ratio of the reduced chi-square of the first segments to that of the second segments.

    The ratio exceeds 1 only because the degrees of freedom differ.
    """


SHORT = ShortSegments()


@dataclass(frozen=True, slots=True)
class RatioFit:
    """Result of a fit of the ratios."""

    problem: Problem
    fit: Fit

    @property
    def unknowns(self) -> Array:
        """(k,) values of the ratios, b and p/b that the runs determine, without the added mass."""
        return self.fit.estimate.ratios[list(self.visible)]

    @property
    def visible(self) -> tuple[int, ...]:
        """Indices in `UNKNOWN_RATIOS` of the ratios, b and p/b that the runs determine."""
        return visible_of(self.problem.segments)

    @property
    def ratios(self) -> Array:
        """(5,) ratios a/b, d/b, e1/b, c1/b, c2/b, without the added mass."""
        return self.fit.estimate.ratios[: len(RATIOS)]

    @property
    def predicted(self) -> Array:
        """Predicted theta1 and theta2 (samples, 2), rad."""
        return self.problem.joints.to_rods(self.problem.predict(self.fit.estimate))

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self.problem.segments)

    @property
    def longest_s(self) -> float:
        """Time from the first to the last sample of the longest segment, s."""
        t, offsets = self.problem.t, self.problem.segments.offsets
        return float(np.max(t[offsets[1:] - 1] - t[offsets[:-1]]))

    @property
    def dof(self) -> int:
        """Number of readings minus number of fitted values."""
        zeros = sum(parameter.block == "zeros" for parameter in self.fit.free)
        return self.problem.evidence - len(self.visible) - zeros

    @property
    def slopes(self) -> Array:
        """Whitened derivatives (segments, m, k) of the readings, without initial states and encoder zeros."""
        return _without_zeros(self.fit.linear, self.fit.free)

    @property
    def prior_information(self) -> Array:
        """Information (k, k) of the rig file on the unknowns, zero without a prior."""
        of_ratios = [i for i, parameter in enumerate(self.fit.free) if parameter.block == "ratios"]
        rows = self.fit.prior[:, of_ratios]
        return rows.T @ rows

    @property
    def chi2_per_dof(self) -> float:
        """Reduced chi-square; 1 = noise only."""
        return self.fit.chi2 / self.dof

    @property
    def noise_factor(self) -> float:
        """Factor of the variances of the noise: a residual above the noise is treated as noise of that size."""
        return max(1.0, self.chi2_per_dof)

    @property
    def initial_covariances(self) -> Array:
        """(segments, 4, 4) covariance of the initial states due to noise, with all other unknowns fixed."""
        inverse = np.linalg.inv(self.fit.linear.R)
        return inverse @ inverse.transpose(0, 2, 1)


def segmented(runs: Sequence[PreprocessedRun], rig: Rig, length: float, step: float = 5e-3) -> tuple[Problem, Array]:
    """Divide runs into segments; return the fitting problem and smoothed initial states (segments, 4).

    Args:
        runs: runs to fit
        rig: lengths, gravity, encoders
        length: nominal length of a segment, s
        step: longest Runge-Kutta step, s; a step of 5 ms has an error below a microradian over half a second
    """
    cuts = [(i, part) for i, prepared in enumerate(runs) for part in partition(prepared.run, length)]
    joints = rig.encoders.joint_angles
    laid_out = segments(
        [runs[i].run.t[part] for i, part in cuts],
        [i for i, _ in cuts],
        [prepared.run.setup for prepared in runs],
        step,
    )
    measured = np.concatenate([joints.of_rods(prepared.run.theta[:, 1:]) for prepared in runs])
    counts = np.array([[1.0, float(not prepared.run.setup.alone)] for prepared in runs])
    weight = np.concatenate(
        [
            np.tile(count / prepared.noise.std_joint, (len(prepared.run.t), 1))
            for count, prepared in zip(counts, runs, strict=True)
        ]
    )
    initial = np.array([runs[i].states[part.start] for i, part in cuts])
    model = RodsAlone(rig_constants(rig))
    problem = Problem(laid_out, measured, weight, model, rezeroed=rig.encoders.rezeroed, prior=prior_of(rig))
    return problem, initial


def rods_estimate(unknown: Array, initial: Array) -> Estimate:
    """Return an estimate without effects from (7,) ratios, b and p/b, and initial states."""
    return Estimate.of(unknown, effect_params({}), initial)


def visible_of(laid_out: Segments) -> tuple[int, ...]:
    """Return the indices of the unknowns (ratios, b and p/b) that the given segments determine.

    The inertia b is included if a known mass or torque makes it identifiable.
    """
    return visible_ratios(laid_out.setups, any(setup.weighs for setup in laid_out.setups))


def fit_ratios(
    problem: Problem,
    start: Estimate,
    *,
    held: Collection[int] = (),
    iterations: int = 40,
    settings: GaussNewton = TO_THE_MINIMUM,
) -> RatioFit:
    """Fit the unknowns and the initial states of given segments.

    The zeros of the encoders are fitted for each run if they are free.

    Args:
        problem: measured readings, weights and model
        start: initial values
        held: indices of the unknowns that stay fixed: all for a held-out run, one for a profile likelihood
        iterations: maximum number of iterations; `converged` is false if it is reached
        settings: tolerances and step control
    """
    free = ratio_parameters(start, visible_of(problem.segments))
    chosen = [parameter for parameter in free if parameter.place not in held]
    return RatioFit(problem, fit(problem, start, chosen, iterations=iterations, settings=settings))


def short_fit(
    Z: Array,
    runs: Sequence[PreprocessedRun],
    rig: Rig,
    *,
    iterations: int = 40,
    settings: GaussNewton = TO_THE_MINIMUM,
    worst: float = np.inf,
) -> RatioFit:
    """Fit the ratios to segments of 0.25 s, then of 0.5 s.

    Longer segments have fewer initial states, so their chi-square is not smaller. A fit of the short segments with a
    reduced chi-square above `worst` is therefore returned without the second fit.

    Args:
        Z: (9,) initial parameters
        runs: runs to fit
        rig: lengths, gravity, encoders
        iterations: maximum number of iterations of each fit
        settings: tolerances and step control
        worst: largest reduced chi-square of interest
    """
    first = first_fit(Z, runs, rig, iterations=iterations, settings=settings)
    arm_moves = any(setup.arm for setup in first.problem.segments.setups)
    ended = first.fit.stop is not StopReason.MAXIMUM_ITERATIONS
    if ended and not arm_moves and first.chi2_per_dof > SHORT.nested * worst:
        return first
    problem, initial = segmented(runs, rig, SHORT.working_segment_s)
    start_longer = rods_estimate(first.fit.estimate.ratios, initial)
    rough = fit_ratios(problem, start_longer, iterations=iterations, settings=settings)
    noise = driving_noise(rough.problem, rough.fit.estimate)
    if noise is None:
        return rough
    noisy = fit_ratios(replace(problem, disturbance=noise), rough.fit.estimate, settings=settings)
    return noisy if noisy.chi2_per_dof < SHORT.noise_alone else rough


def first_fit(
    Z: Array, runs: Sequence[PreprocessedRun], rig: Rig, *, iterations: int, settings: GaussNewton
) -> RatioFit:
    """Fit the ratios to segments of a quarter of a second, from poor initial values.

    See `short_fit` for the arguments.
    """
    start = unknown_ratios(whole_parameters(Z, rig.L1, rig.g))
    problem, initial = segmented(runs, rig, SHORT.first_segment_s)
    return fit_ratios(problem, rods_estimate(start, initial), iterations=iterations, settings=settings)


def driving_noise(problem: Problem, estimate: Estimate) -> Disturbance | None:
    """Compute the effect of the noise of a prescribed arm motion on the readings.

    The result is None if no motion is prescribed.
    """
    if all(setup.arm is None for setup in problem.segments.setups):
        return None
    return disturbance(problem, estimate, begins=lambda first: first)


def information(problem: Problem, estimate: Estimate) -> Array:
    """Compute the Fisher information (k, k) of segments on the ratios, b and p/b that they determine.

    Initial states and encoder zeros are eliminated.
    """
    free = problem.all_free(ratio_parameters(estimate, visible_of(problem.segments)))
    slopes = _without_zeros(linearise(problem, problem.with_zeros(estimate), free), free)
    A = slopes.reshape(-1, slopes.shape[2])
    return A.T @ A


def _without_zeros(linear: Linearisation, free: Sequence[FreeParameter]) -> Array:
    """Return the derivatives (segments, m, k) with respect to the ratios, with encoder zeros projected out."""
    of_zeros = np.array([parameter.block == "zeros" for parameter in free], dtype=np.bool_)
    if not of_zeros.any():
        return linear.A
    A, _ = linear.flat
    zeros, ratios = A[:, of_zeros], A[:, ~of_zeros]
    corrected = ratios - zeros @ np.linalg.lstsq(zeros, ratios, rcond=None)[0]
    return corrected.reshape(*linear.A.shape[:2], -1)


def predictable_until(ratio_fit: RatioFit, index: int, t: Array, error_rad: float = 0.1) -> float:
    """Compute the predictability horizon of a free run from the initial state of a segment.

    The variational equation propagates the uncertainty of the initial state. The horizon is the first instant of `t` at
    which the uncertainty of an angle reaches `error_rad`, or the last instant, s.

    Args:
        ratio_fit: ratios and initial states
        index: index of the initial segment
        t: (n,) times, starting with the first instant of the segment, s
        error_rad: threshold, rad
    """
    rig, layout, estimate = ratio_fit.problem.model.constants, ratio_fit.problem.segments, ratio_fit.fit.estimate
    setup = layout.setups[layout.run[index]]
    free_run = segments([t], setups=[setup], step=MAX_STEP)
    _, slopes = followed(estimate.ratios, free_run, estimate.initial[index : index + 1], rig, outputs=2)
    growth = by_start(slopes[:, :2, len(RATIOS) :], setup)
    variance = np.einsum("nij,jk,nik->ni", growth, ratio_fit.initial_covariances[index], growth)
    lost = np.flatnonzero(~(variance.max(axis=1) * ratio_fit.noise_factor < error_rad**2))
    return float(t[lost[0]] if len(lost) else t[-1])
