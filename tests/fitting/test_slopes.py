"""Derivatives of the readings where effects have internal states that are handed on from segment to segment."""

from itertools import pairwise

import numpy as np
import pytest

from dpr_lab.dynamics.prediction import predict, predict_with_internal
from dpr_lab.effects import effect_params
from dpr_lab.fitting import rods_with_effects
from dpr_lab.fitting.rods_with_effects import INITIAL_STEPS, DerivativeSettings
from dpr_lab.gap.hypothesis.hypothesis import free_parameters

REMEMBERING = {
    "hysteresis_joint2": {"torque_Nm": 2e-3, "length_rad": 0.1},
    "backlash_joint2": {"play_rad": 0.02},
    "arm_compliance": {"coupling_per_kg": 1.0, "frequency_hz": 14.0, "damping_ratio": 0.05},
}


@pytest.mark.slow
@pytest.mark.parametrize("effect", REMEMBERING)
def test_derivatives_with_respect_to_initial_states_agree_with_wider_differences(recorded, bare, effect):
    truth = {effect: REMEMBERING[effect]}
    problem, base = bare(recorded(truth, duration=3.0))
    at = base.fit.estimate.changed(params=effect_params(truth))
    known = at.base, at.params, problem.model.constants, problem.segments
    internal = predict_with_internal([at.base], [at.params], *known[2:], [at.initial])[1][0]
    slopes = problem.model.slopes(problem.segments, at, ())
    for column, step in enumerate(300 * INITIAL_STEPS[: at.initial.shape[1]]):
        ahead, behind = at.initial.copy(), at.initial.copy()
        ahead[:, column] += step
        behind[:, column] -= step
        wide = [predict(*known, initial, internal) for initial in (ahead, behind)]
        expected = (wide[0] - wide[1]) / (2 * step)
        off = np.abs(slopes[:, :, column] - expected) > 0.05 * np.abs(expected).max()
        assert off.mean() < 0.02  # an encoder's play has kinks, at which differences depend on their width


@pytest.fixture(scope="module")
def nearly_singular(recorded, bare):
    """Inertias so nearly singular that swings of twice the step diverge in some segments."""
    problem, base = bare(recorded({}, duration=3.0))
    ratios = base.fit.estimate.ratios.copy()
    ratios[0] = 1.1 * ratios[1] ** 2  # a/b of a singular mass matrix is (d/b)^2
    return problem, base.fit.estimate.changed(ratios=ratios)


@pytest.mark.slow
def test_derivatives_of_a_swing_that_diverges_with_twice_the_step_use_the_step_itself(nearly_singular, monkeypatch):
    problem, estimate = nearly_singular
    free, predicted = free_parameters(estimate, (), problem), problem.predict(estimate)
    coarse, checked = problem.slopes(estimate, free), problem.slopes(estimate, free, predicted)
    monkeypatch.setattr(rods_with_effects, "DERIVATIVES", DerivativeSettings(coarser=1.0))
    fine = problem.slopes(estimate, free)
    segments = [slice(i, j) for i, j in pairwise(problem.segments.offsets)]
    kept = [rows for rows in segments if np.array_equal(checked[rows], coarse[rows])]
    corrected = [rows for rows in segments if rows not in kept]
    assert kept
    assert corrected
    assert all(np.array_equal(checked[rows], fine[rows]) for rows in corrected)
    assert max(np.abs(coarse[rows] / fine[rows] - 1).max() for rows in corrected) > 1.0
