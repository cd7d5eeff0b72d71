from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from dpr_lab.dynamics.base import base_parameters, ratios
from dpr_lab.effects import EFFECTS, place
from dpr_lab.gap.base_fit import fit_base, nominal_rods
from dpr_lab.gap.heldout import folds, left_out, remainder, surprise
from dpr_lab.gap.hypothesis import slots_of
from dpr_lab.gap.problem import effect_slots
from dpr_lab.gap.record import record
from dpr_lab.gap.score import score
from dpr_lab.gap.shooting import bounded_solution, fit, linearise
from sim_device.config import load_plant


@pytest.fixture(scope="module")
def clean(recorded, paper):
    return fit_base([record(run, paper) for run in recorded({})], paper, nominal_rods(paper))


def test_ratios_of_the_plant_come_back(clean, paper):
    _, base = clean
    truth = ratios(base_parameters(load_plant("paper", 1).Z, paper.rig.L1, paper.rig.g))
    assert base.fit.converged
    assert base.fit.point.rods[:3] == pytest.approx(truth[:3], rel=1e-4)
    assert base.fit.point.rods[3:5] == pytest.approx(truth[3:], rel=2e-2)


def test_nothing_but_noise_is_left_of_a_clean_rig(clean):
    made, base = clean
    left = remainder(made, base.fit)
    assert abs(left.z) < 4
    assert left.chi2 / left.dof == pytest.approx(1.0, abs=0.1)


def test_bounded_solution_agrees_with_an_independent_solver(rng):
    for _ in range(20):
        A, b = rng.normal(size=(30, 6)), rng.normal(size=30)
        lower = np.where(rng.random(6) < 0.5, -np.inf, rng.normal(size=6) * 0.1)
        reference = lsq_linear(A, b, (lower, np.full(6, np.inf)), method="bvls").x
        found = bounded_solution(A.T @ A, A.T @ b, lower)
        assert (found >= lower - 1e-12).all()
        assert np.sum((A @ found - b) ** 2) == pytest.approx(np.sum((A @ reference - b) ** 2), rel=0.02)


def test_eliminating_start_states_changes_no_step(clean):
    made, base = clean
    slots = slots_of(base.fit.point, (), made)
    linear = linearise(made, base.fit.point, slots)
    count = len(made.run)
    starts = np.zeros((*linear.residual.shape, 4 * count))
    for s in range(count):
        starts[s, :, 4 * s : 4 * s + 4] = linear.Q[s]
    whole = np.concatenate([linear.slopes, starts], axis=2).reshape(-1, len(slots) + 4 * count)
    scale = np.linalg.norm(whole, axis=0)
    reference = np.linalg.lstsq(whole / scale, linear.residual.ravel(), rcond=None)[0] / scale
    A = linear.A.reshape(-1, len(slots))
    norm = np.linalg.norm(A, axis=0)
    found = np.linalg.lstsq(A / norm, linear.e.ravel(), rcond=None)[0] / norm
    assert found == pytest.approx(reference[: len(slots)], rel=1e-6, abs=1e-12)


def test_prediction_of_a_release_left_out_agrees_with_fitting_the_others(clean):
    made, base = clean
    fold = folds(made)
    found = left_out(base.fit, fold)
    linear = base.fit.linear
    A = linear.A.reshape(*linear.A.shape)
    scale = np.linalg.norm(A.reshape(-1, A.shape[2]), axis=0)
    for r in np.unique(fold):
        rest = (A[fold != r] / scale).reshape(-1, A.shape[2])
        step = np.linalg.lstsq(rest, linear.e[fold != r].ravel(), rcond=None)[0] / scale
        expected = np.sum((linear.e[fold == r] - A[fold == r] @ step) ** 2, axis=1)
        assert found[fold == r] == pytest.approx(expected, rel=1e-3)
    assert found.sum() > base.fit.chi2


def test_an_effect_that_is_not_there_makes_no_release_easier_to_predict(clean):
    made, base = clean
    scores = score(made, base.fit, [EFFECTS["spring_joint2"]])
    (item,) = scores.ranking
    more = fit(made, base.fit.point, item.slots)
    fold = folds(made)
    assert surprise(more, fold, 1.0).sum() > surprise(base.fit, fold, 1.0).sum()


def test_score_promises_what_the_fit_then_gains(recorded, paper):
    runs = recorded({"base_tilt": {"tilt_rad": 5e-4}})
    made, base = fit_base([record(run, paper) for run in runs], paper, nominal_rods(paper))
    (item,) = score(made, base.fit, [EFFECTS["base_tilt"]]).ranking
    after = fit(made, base.fit.point, slots_of(base.fit.point, ("base_tilt",), made))
    assert base.fit.chi2 - after.chi2 == pytest.approx(item.gain, rel=0.02)
    assert after.point.vector[place("base_tilt", "tilt_rad")] == pytest.approx(5e-4, rel=0.02)
    assert len(effect_slots(EFFECTS["base_tilt"])) == 1


def test_a_fit_that_cannot_be_followed_leaves_a_number(clean):
    made, base = clean
    lost = base.fit.linear.residual.copy()
    lost[0] = np.inf
    left = remainder(made, replace(base.fit, linear=replace(base.fit.linear, residual=lost)))
    assert np.isfinite([left.chi2, left.excess, left.z, left.inflation]).all()
    assert left.excess > 1e6 * left.dof
