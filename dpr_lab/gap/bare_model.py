"""Fit of the bare model to screened runs, first in short segments, then in longer ones."""

from dataclasses import replace

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import whole_parameters
from dpr_lab.errors import RunError
from dpr_lab.fitting.cut import carried
from dpr_lab.fitting.disturbance import disturbance, likeliest_noise, most_noise
from dpr_lab.fitting.estimate import SCALE, Estimate, unknown_ratios, with_scale
from dpr_lab.fitting.gauss_newton import Fit, fit
from dpr_lab.fitting.problem import Problem
from dpr_lab.fitting.robust import refit_lost, student_weights
from dpr_lab.gap.damage.disturbances import without_disturbances
from dpr_lab.gap.damage.outliers import isolated_outliers
from dpr_lab.gap.hypothesis.hypothesis import Hypothesis, free_parameters, hypothesis
from dpr_lab.gap.screen.recordings import LENGTHS, Recordings
from dpr_lab.gap.screen.tracking_noise import tracking_noise
from dpr_lab.identification.prior_update import clamped_cosine, posterior_of
from dpr_lab.rig import Rig
from dpr_lab.setup import only_inner

LESS_NOISE = 0.8
"""Maximum ratio of a new estimate of the torque noise to the previous one for which the new estimate is used.

Neighbouring values that the estimate compares have the ratio 0.71."""


def nominal_ratios(rig: Rig) -> Array:
    """Return the (7,) ratios, b and p/b that follow from the measured or nominal values of the rig file."""
    return unknown_ratios(whole_parameters(rig.nominal, rig.L1, rig.g))


def fit_bare_model(recordings: Recordings, start: Array) -> tuple[Recordings, Problem, Hypothesis]:
    """Fit the ratios robustly in short segments, then in segments of the working length (`SegmentLengths`).

    Disturbed intervals and isolated outliers are excluded after the first fit: at a low sample rate, only the residual
    of a model shows an outlier.

    Args:
        recordings: the screened runs
        start: (7,) initial ratios, b and p/b

    Returns:
        the runs without disturbances and outliers and with the estimated noise of torques and tracking, the problem at
        the working length, and the bare model

    Raises:
        RunError: no initial state fits the readings of a segment.
    """
    short, first = _fitted_in_short_segments(recordings, start)
    undisturbed = without_disturbances(recordings, first.estimate.ratios)
    if undisturbed is not recordings:
        recordings = undisturbed
        short, first = _fitted_in_short_segments(recordings, start)
    ratios = first.estimate.ratios
    driven = recordings.arm_moves or any(setup.torques for setup in short.segments.setups)
    setups = short.segments.setups
    alone, clamped = only_inner(setups), clamped_cosine(setups)
    b = float(ratios[SCALE]) if driven else posterior_of(ratios, recordings.rig, alone=alone, clamped=clamped).b
    recordings = recordings.without(short, isolated_outliers(short, first.estimate))
    estimate = first.estimate.changed(ratios=with_scale(ratios, b))
    recordings = replace(recordings, ratios=None if recordings.exact_torques else estimate.ratios)
    problem, bare = _in_working_segments(recordings, short, estimate)
    if quieter := with_likeliest_noise(recordings, problem, bare):
        recordings = quieter
        problem, bare = _in_working_segments(recordings, short, estimate)
    if noise := tracking_noise(recordings, problem, bare.fit):
        recordings = recordings.with_tracking_noise(noise)
        problem, bare = _in_working_segments(recordings, short, estimate)
    return recordings, problem, bare


def _fitted_in_short_segments(recordings: Recordings, start: Array) -> tuple[Problem, Fit]:
    short, initial = recordings.cut(LENGTHS.first)
    initial_estimate = Estimate.of(start, recordings.start_params, initial)
    free = free_parameters(initial_estimate, (), short)
    rough = fit(short, initial_estimate, free)
    _refuse_unfollowed(recordings, short, rough)
    if not recordings.exact_torques:
        short = replace(short, disturbance=disturbance(short, rough.estimate, most_Nm=recordings.torque_noise_Nm))
    first = fit(short.weighted(np.sqrt(student_weights(short, rough))), rough.estimate, free)
    return short, first


def _refuse_unfollowed(recordings: Recordings, problem: Problem, bare: Fit) -> None:
    lost = np.flatnonzero(~np.isfinite(bare.linear.chi2_by_segment))
    if len(lost):
        run = recordings.records[problem.segments.run[lost[0]]].run.name
        failed_s = problem.t[problem.segments.offsets[lost[0]]]
        raise RunError(
            f"{run}: the model cannot follow the readings from {failed_s:.2f} s on: check the rig file and the"
            f" encoder, or exclude the run"
        )


def with_likeliest_noise(recordings: Recordings, problem: Problem, model: Hypothesis) -> Recordings | None:
    """Return the recordings with a smaller noise of the measured torques, if the residuals make it more likely.

    The result is None if the noise is not clearly smaller (`LESS_NOISE`), or if no noise of torques is assumed.
    """
    before = np.minimum(most_noise(problem), recordings.torque_noise_Nm)
    if problem.disturbance is None or not before.any():
        return None
    noise = np.minimum(likeliest_noise(problem, model.fit), before)
    if not (noise < LESS_NOISE * before).any():
        return None
    return replace(recordings, torque_noise_Nm=(float(noise[0]), float(noise[1])))


def _in_working_segments(recordings: Recordings, short: Problem, estimate: Estimate) -> tuple[Problem, Hypothesis]:
    """Fit the bare model to segments of the working length."""
    longer, initial = recordings.cut(recordings.working_length)
    start = estimate.changed(initial=carried(short.segments, estimate.initial, longer.segments, initial))
    fitted = fit(longer, start, free_parameters(start, (), longer), iterations=20)
    return longer, hypothesis(longer, (), refit_lost(longer, fitted, initial))
