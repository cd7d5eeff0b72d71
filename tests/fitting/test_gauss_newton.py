from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from dpr_lab.dynamics.base import base_parameters, ratios
from dpr_lab.effects import EFFECTS, effect_params, param_index
from dpr_lab.fitting import gauss_newton
from dpr_lab.fitting.estimate import effect_parameters
from dpr_lab.fitting.gauss_newton import Fit, GaussNewton, StopReason, fit
from dpr_lab.fitting.linearise import linearise
from dpr_lab.fitting.projection import COMPILED, ColumnSpace
from dpr_lab.fitting.robust import refit_lost, relative_chi2
from dpr_lab.fitting.uncompiled import bounded_solution
from dpr_lab.gap.hypothesis.cross_validation import folds, left_out_chi2, predictive_loss
from dpr_lab.gap.hypothesis.hypothesis import free_parameters
from dpr_lab.gap.hypothesis.residuals import residual_statistics
from sim_device.plant.config import load_plant
from tests.background_rigs import Law, law, recordings


@pytest.fixture(scope="module")
def clean(recorded, bare):
    return bare(recorded({}, duration=5.0))


def test_ratios_of_the_plant_come_back(clean, paper):
    _, base = clean
    truth = ratios(base_parameters(load_plant("paper", 1).Z, paper.L1, paper.g))
    assert base.fit.converged
    assert base.fit.estimate.ratios[:3] == pytest.approx(truth[:3], rel=1e-4)
    assert base.fit.estimate.ratios[3:5] == pytest.approx(truth[3:], rel=2e-2)


def test_the_residual_of_a_clean_rig_is_noise(clean):
    problem, base = clean
    left = residual_statistics(problem, base.fit)
    assert abs(left.z) < 4
    assert left.chi2 / left.dof == pytest.approx(1.0, abs=0.1)


def test_bounded_solution_agrees_with_an_independent_solver(rng):
    for _ in range(20):
        A, b = rng.normal(size=(30, 6)), rng.normal(size=30)
        lower = np.where(rng.random(6) < 0.5, -np.inf, rng.normal(size=6) * 0.1)
        upper = np.where(rng.random(6) < 0.5, np.inf, np.maximum(lower, -0.1) + rng.random(6) * 0.1 + 1e-3)
        reference = lsq_linear(A, b, (lower, upper), method="bvls").x
        result = bounded_solution(A.T @ A, A.T @ b, lower, upper)
        assert (result >= lower - 1e-12).all()
        assert (result <= upper + 1e-12).all()
        assert result == pytest.approx(reference, abs=1e-9)


def test_a_bounded_solution_is_optimal_where_the_sets_of_fixed_coordinates_recur():
    """They recur in the problems 631 and 991, which have nearly collinear columns. Both forms have the same bits."""
    rng = np.random.default_rng(0)
    for number in range(992):
        k = rng.integers(1, 10)
        A = rng.standard_normal((k + rng.integers(0, 20), k)) @ np.diag(10.0 ** rng.uniform(-0.5, 0.5, k))
        if k > 2:
            A[:, 1] = A[:, 0] * rng.standard_normal() + A[:, 1] * 10**-0.5
        b = rng.standard_normal(len(A))
        lower = np.where(rng.random(k) < 0.4, -np.inf, rng.uniform(-2, 0.3, k))
        upper = np.where(rng.random(k) < 0.4, np.inf, np.maximum(lower, 0) + rng.uniform(0, 1, k))
        if number < 200 or number in (631, 991):
            H, gradient = A.T @ A + 1e-14 * np.sum(A**2) * np.eye(k), A.T @ b
            root = np.linalg.cholesky(H)
            reference = lsq_linear(root.T, np.linalg.solve(root, gradient), (lower, upper), method="bvls", tol=1e-14).x
            result = bounded_solution(H, gradient, lower, upper, COMPILED)
            assert result == pytest.approx(reference, rel=1e-5, abs=1e-7), number
            best = reference @ H @ reference / 2 - gradient @ reference
            assert result @ H @ result / 2 - gradient @ result <= best + 1e-8 * abs(best)
            assert (bounded_solution(H, gradient, lower, upper) == result).all()


def test_a_bounded_solution_with_a_singular_matrix_is_refused():
    with pytest.raises(np.linalg.LinAlgError):
        bounded_solution(np.ones((2, 2)), np.ones(2), np.full(2, -1.0), np.full(2, 1.0))


def test_the_conditional_reduction_of_columns_agrees_with_a_joint_solution(rng):
    A, e = rng.normal(size=(40, 7)) * 10.0 ** rng.integers(-4, 5, 7), rng.normal(size=40)
    space, held, own = ColumnSpace.of(A, e), [0, 1, 2], [3, 4, 5, 6]
    whole = np.linalg.lstsq(A, e, rcond=None)[0]
    assert space.solution() == pytest.approx(whole, rel=1e-6)
    assert space.gain() == pytest.approx(np.sum((A @ whole) ** 2))
    others_removed = space.projected_out(held, own)
    assert others_removed.solution() == pytest.approx(whole[own], rel=1e-6)
    assert others_removed.covariance() == pytest.approx(np.linalg.inv(A.T @ A)[np.ix_(own, own)], rel=1e-6)
    assert space.chosen(held).gain() + others_removed.gain() == pytest.approx(space.gain())
    nearest = A[:, own] @ np.linalg.lstsq(A[:, own], A[:, 0], rcond=None)[0]
    expected = np.linalg.norm(nearest) / np.linalg.norm(A[:, 0])
    assert space.cosine(np.ones(1), [0], own) == pytest.approx(expected)


def test_many_small_sets_gain_what_each_gains_alone(rng):
    held, sets, e = rng.normal(size=(40, 3)) * [1e-3, 1.0, 1e4], rng.normal(size=(5, 40, 2)), rng.normal(size=40)
    sets[4, :, 1] = held[:, 0] + 1e-6 * sets[4, :, 1]  # nearly what is fitted already
    space, across = ColumnSpace.of(held, e), np.einsum("rk,srn->ksn", held, sets)
    own, gradient = np.einsum("sri,srj->sij", sets, sets), np.einsum("srn,r->sn", sets, e)
    result = space.projected_out_of_sets(across, own, gradient).gains(positive=False)
    left = [np.linalg.lstsq(A, e, rcond=None)[1][0] for A in (held, *(np.column_stack([held, own]) for own in sets))]
    assert result == pytest.approx(left[0] - np.array(left[1:]), rel=1e-3)
    single = np.ix_(range(5), [0], [0])
    result = space.projected_out_of_sets(across[:, :, :1], own[single], gradient[:, :1]).gains(positive=True)
    alone = [ColumnSpace.of(np.column_stack([held, one[:, :1]]), e) for one in sets]
    wrong = np.array([space.projected_out([0, 1, 2], [3]).solution()[0] < 0 for space in alone])
    assert wrong.any()
    assert (result[wrong] == 0).all()
    assert result[~wrong] == pytest.approx([alone[i].gain() - space.gain() for i in np.flatnonzero(~wrong)])


class Counting:
    """Output model that counts its predictions and the requests for derivatives."""

    def __init__(self, model):
        self.model, self.constants, self.asked, self.predicted = model, model.constants, 0, 0

    def predict(self, segments, at):
        self.predicted += 1
        return self.model.predict(segments, at)

    def slopes(self, segments, at, free, predicted=None):
        self.asked += 1
        return self.model.slopes(segments, at, free)


def test_a_fit_with_frozen_jacobians_reaches_the_same_minimum(clean):
    problem, base = clean
    model = Counting(problem.model)
    start = base.fit.estimate.changed(ratios=base.fit.estimate.ratios * 1.002)
    free = free_parameters(start, (), problem)
    fitted = fit(replace(problem, model=model), start, free)
    exact = fit(problem, start, free, iterations=30, settings=GaussNewton(linearity=-1.0, converged=1e-9))
    A, _ = fitted.linear.flat
    std = np.sqrt(np.diag(np.linalg.inv(A.T @ A)))
    assert fitted.converged
    assert model.asked < fitted.iterations
    assert np.abs(fitted.values - exact.values).max() < np.abs(start.ratios[:5] - exact.values).max()
    assert (np.abs(fitted.values - exact.values) < 0.05 * std).all()


class Misleading(Counting):
    """Output model whose derivatives have the wrong sign, so that no step reduces the cost."""

    def slopes(self, segments, at, free, predicted=None):
        return -super().slopes(segments, at, free, predicted)


def test_a_step_that_failed_is_not_tried_again_because_of_a_little_damping(clean):
    problem, base = clean
    model = Misleading(problem.model)
    start = base.fit.estimate.changed(ratios=base.fit.estimate.ratios * 1.002)
    fitted = fit(replace(problem, model=model), start, free_parameters(start, (), problem))
    assert fitted.stop is StopReason.NO_DESCENT
    assert fitted.estimate is start
    assert model.predicted <= 1 + 2 * GaussNewton().tries  # a damping of 1e-3 is another step


def test_a_fit_that_has_not_beaten_another_one_ends_at_its_first_failed_step(clean):
    problem, base = clean
    model = Misleading(problem.model)
    start = base.fit.estimate.changed(ratios=base.fit.estimate.ratios * 1.002)
    free, settings = free_parameters(start, (), problem), GaussNewton(to_beat=2.0 * base.fit.chi2, race=True)
    fitted = fit(replace(problem, model=model), start, free, settings=settings)
    assert fitted.stop is StopReason.BEATEN
    assert model.predicted <= 1 + settings.tries


@pytest.mark.parametrize(
    ("before", "to_beat", "expected"),
    [(np.inf, 0.0, None), (1.0, 90.0, StopReason.BEATEN), (1.0, 92.0, None), (2.0, 90.0, None)],
)
def test_a_fit_ends_if_eight_steps_like_the_last_ones_do_not_beat_another_one(before, to_beat, expected):
    """The first step does not decide, and the better of the last two counts."""
    state, problem = Mock(chi2=100.0, reduction=before), Mock(evidence=100)
    assert gauss_newton._end(problem, state, 1.0, 1e-4, GaussNewton(to_beat=to_beat, race=True)) is expected


def test_a_failed_step_is_shortened_for_the_worse_segments_and_for_all_in_turn(monkeypatch):
    """At every step one of three segments is worse, and more so than the others are better."""
    tried = []
    monkeypatch.setattr(gauss_newton, "moved", lambda at, free, step, initial: tried.append([*step, *initial[:, 0]]))
    linear = Mock(chi2_by_segment=np.ones(3), initial_steps=lambda step: np.ones((3, 4)))
    problem, prior = Mock(chi2_by_segment=lambda predicted: np.array([9.0, 0.5, 0.5])), Mock(cost=lambda step: 0.0)
    settings = GaussNewton()
    assert gauss_newton._line_search(problem, (), Mock(linear=linear), np.ones(1), prior, settings, 4) is None
    alone, whole = settings.shorten_segment, settings.shorten
    once = np.array([[1.0, 1.0, 1.0, 1.0], [1.0, alone, 1.0, 1.0]])
    np.testing.assert_allclose(tried, np.concatenate([once, whole * once]))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 4])
def test_a_swing_from_near_the_upright_does_not_end_a_fit_above_its_minimum(bare, seed):
    """Where the initial state compensates for the friction, both have to change in proportion."""
    drag = Law("air_drag", 0, 4e-4, lambda t, angle, speed: -4e-4 * speed * abs(speed))
    rig, runs, _ = recordings(seed, [law("coulomb", 0, 6.0), drag], rods=1)
    problem, base = bare(runs[:1], rig)
    with_drag = effect_params({"air_drag_both": {"coefficient_kg_per_m2": 1e-3}})
    start = base.fit.estimate.changed(params=with_drag)
    alone = fit(problem, start, free_parameters(start, ("air_drag_both",), problem), iterations=30)
    both = free_parameters(alone.estimate, ("air_drag_both", "coulomb_joint1"), problem)
    fitted = fit(problem, alone.estimate, both, iterations=30)
    assert alone.chi2 > 2.0 * problem.evidence
    assert fitted.stop is StopReason.CONVERGED
    assert fitted.chi2 < 1.1 * problem.evidence


def test_far_from_the_noise_a_preliminary_fit_ends_at_the_first_small_reduction(clean):
    problem, base = clean
    settings = GaussNewton(preliminary=1.0)
    start = base.fit.estimate.changed(ratios=base.fit.estimate.ratios * 1.00001)
    free = free_parameters(start, (), problem)
    near = fit(problem, start, free, settings=settings)
    far = fit(problem.weighted(np.full((len(problem.t), 1), 100.0)), start, free, settings=settings)
    assert near.stop is StopReason.CONVERGED
    assert far.stop is StopReason.PRELIMINARY
    assert far.iterations == 1
    assert not far.converged


def test_a_fit_that_is_not_expected_to_beat_another_one_ends(clean):
    problem, base = clean
    start = base.fit.estimate.changed(ratios=base.fit.estimate.ratios * 1.002)
    free = free_parameters(start, (), problem)
    models = [Counting(problem.model) for _ in range(3)]
    worse, alike, alone = (
        fit(replace(problem, model=model), start, free, settings=GaussNewton(to_beat=to_beat))
        for model, to_beat in zip(models, (0.9 * base.fit.chi2, 1.1 * base.fit.chi2, np.inf), strict=True)
    )
    assert worse.stop is StopReason.BEATEN
    assert not worse.converged
    assert models[0].predicted < models[2].predicted
    assert (alike.chi2, alike.stop) == (alone.chi2, StopReason.CONVERGED)


class LosesASegment(Counting):
    """Output model whose first swing cannot be followed in one segment."""

    def predict(self, segments, at):
        read = super().predict(segments, at).copy()
        if self.predicted == 1:
            read[: segments.offsets[1]] = np.inf
        return read


def test_a_fit_goes_on_after_a_step_that_regains_a_lost_segment(clean):
    problem, base = clean
    start = base.fit.estimate.changed(ratios=base.fit.estimate.ratios * 1.002)
    losing = replace(problem, model=LosesASegment(problem.model))
    fitted = fit(losing, start, free_parameters(start, (), problem))
    assert fitted.iterations > 1
    assert fitted.chi2 == pytest.approx(base.fit.chi2, rel=1e-3)


def test_eliminating_initial_states_changes_no_step(clean):
    problem, base = clean
    free = free_parameters(base.fit.estimate, (), problem)
    linear = linearise(problem, base.fit.estimate, free)
    count = len(problem.segments)
    initial = np.zeros((*linear.residual.shape, 4 * count))
    for s in range(count):
        initial[s, :, 4 * s : 4 * s + 4] = linear.Q[s]
    whole = np.concatenate([linear.A + linear.Q @ linear.initial_state_coefficients, initial], axis=2).reshape(
        -1, len(free) + 4 * count
    )
    scale = np.linalg.norm(whole, axis=0)
    reference = np.linalg.lstsq(whole / scale, linear.residual.ravel(), rcond=None)[0] / scale
    A, e = linear.flat
    norm = np.linalg.norm(A, axis=0)
    result = np.linalg.lstsq(A / norm, e, rcond=None)[0] / norm
    assert result == pytest.approx(reference[: len(free)], rel=1e-6, abs=1e-12)


def test_prediction_of_a_run_left_out_agrees_with_fitting_the_others(clean):
    problem, base = clean
    fold = folds(problem)
    result = left_out_chi2(base.fit, fold)
    linear = base.fit.linear
    A = linear.A.reshape(*linear.A.shape)
    scale = np.linalg.norm(A.reshape(-1, A.shape[2]), axis=0)
    for r in np.unique(fold):
        rest = (A[fold != r] / scale).reshape(-1, A.shape[2])
        step = np.linalg.lstsq(rest, linear.e[fold != r].ravel(), rcond=None)[0] / scale
        expected = np.sum((linear.e[fold == r] - A[fold == r] @ step) ** 2, axis=1)
        assert result[fold == r] == pytest.approx(expected, rel=1e-3)
    assert result.sum() > base.fit.chi2


@pytest.mark.parametrize("part", ["shape", "size"])
def test_only_the_shape_of_an_effect_that_one_run_alone_sees_is_that_run_s_own(clean, tested, part):
    """A cubic term of a spring that other runs hardly reach is fitted to the run left out; the stiffness is not."""
    problem, base = clean
    (result,) = tested(problem, base.fit, [EFFECTS["spring_joint2"]]).ranking
    more = fit(problem, base.fit.estimate, result.free)
    fold = folds(problem)
    names = [parameter.name for parameter in more.free]
    alone = names.index("cubic_Nm_per_rad3" if part == "shape" else "stiffness_Nm_per_rad")
    A, e = more.linear.A.copy(), more.linear.e.copy()
    A[fold != 0, :, alone] *= 1e-5
    e[fold == 0] += A[fold == 0, :, alone] * 50 / np.linalg.norm(A[fold == 0, :, alone])
    known = replace(more, linear=replace(more.linear, A=A, e=e))
    before, after = (left_out_chi2(one, fold)[fold == 0].sum() for one in (more, known))
    if part == "shape":
        assert after < before + 0.1 * 50**2
    else:
        assert after > before + 0.5 * 50**2


def test_an_effect_that_is_not_there_makes_no_run_easier_to_predict(clean, tested):
    problem, base = clean
    (result,) = tested(problem, base.fit, [EFFECTS["spring_joint2"]]).ranking
    more = fit(problem, base.fit.estimate, result.free)
    fold = folds(problem)
    assert predictive_loss(more, fold, 1.0) > predictive_loss(base.fit, fold, 1.0)


def test_a_reduction_of_chi2_beyond_a_bound_is_no_evidence(clean, tested):
    """A fit ends at a tiny positive friction, although its linear model has its minimum at a negative one."""
    problem, base = clean
    (result,) = tested(problem, base.fit, [EFFECTS["coulomb_joint1"]]).ranking
    params = base.fit.estimate.params.copy()
    params[param_index("coulomb_joint1", "torque_Nm")] = 1e-9
    near = fit(problem, base.fit.estimate.changed(params=params), result.free, iterations=0)
    friction = near.linear.A[:, :, [parameter.name for parameter in near.free].index("torque_Nm")]
    e = near.linear.e - 50 * friction / np.linalg.norm(friction)
    beyond = replace(near, linear=replace(near.linear, e=e))
    without = replace(base.fit, linear=replace(base.fit.linear, e=e))
    fold = folds(problem)
    assert predictive_loss(beyond, fold, 1.0) == pytest.approx(predictive_loss(without, fold, 1.0), rel=1e-3)


def test_a_parameter_that_one_run_alone_determines_keeps_its_prior_without_this_run(clean):
    problem, base = clean
    fold = folds(problem)
    A = base.fit.linear.A.copy()
    A[fold == 0, :, 0] *= 1e9
    A[fold != 0, :, 0] = 0.0
    known = replace(base.fit, linear=replace(base.fit.linear, A=A))
    assert np.isfinite(predictive_loss(known, fold, 1.0))
    assert np.isfinite(left_out_chi2(known, fold)).all()


def without_simulation(fitted: Fit, lost: np.ndarray) -> Fit:
    """Fit that cannot simulate some segments."""
    residual, e, A = fitted.linear.residual.copy(), fitted.linear.e.copy(), fitted.linear.A.copy()
    residual[lost], e[lost], A[lost] = np.inf, 0.0, 0.0
    return replace(fitted, linear=replace(fitted.linear, residual=residual, e=e, A=A))


def test_a_segment_that_cannot_be_simulated_is_no_perfect_prediction(clean):
    problem, base = clean
    fold, lost = folds(problem), np.arange(len(problem.segments)) == 0
    fitted = without_simulation(base.fit, lost)
    assert left_out_chi2(fitted, fold)[lost] > 1e12
    loss = predictive_loss(fitted, fold, 1.0)
    assert np.isfinite(loss)
    assert loss > 1e12


def test_segments_that_cannot_be_simulated_are_refitted_even_if_they_are_the_majority(clean):
    problem, base = clean
    lost, initial = np.arange(len(problem.segments)) > 1, base.fit.estimate.initial
    wrong = base.fit.estimate.changed(initial=initial + 0.5 * lost[:, None])
    first = replace(without_simulation(base.fit, lost), estimate=wrong)
    relative = relative_chi2(first)
    assert np.isinf(relative[lost]).all()
    assert np.median(relative[~lost]) == pytest.approx(1.0)
    assert refit_lost(problem, first, initial).chi2 == pytest.approx(base.fit.chi2, rel=1e-3)


@pytest.mark.slow
def test_the_score_test_predicts_the_reduction_of_the_fit(recorded, bare, tested):
    problem, base = bare(recorded({"base_tilt": {"tilt_rad": 5e-4}}))
    (result,) = tested(problem, base.fit, [EFFECTS["base_tilt"]]).ranking
    at = base.fit.estimate
    after = fit(problem, at, free_parameters(at, ("base_tilt",), problem))
    assert base.fit.chi2 - after.chi2 == pytest.approx(result.gain, rel=0.02)
    assert after.estimate.params[param_index("base_tilt", "tilt_rad")] == pytest.approx(5e-4, rel=0.02)
    assert len(effect_parameters(EFFECTS["base_tilt"])) == 1


def test_a_fit_that_diverges_has_a_finite_cost(clean):
    problem, base = clean
    lost = base.fit.linear.residual.copy()
    lost[0] = np.inf
    left = residual_statistics(problem, replace(base.fit, linear=replace(base.fit.linear, residual=lost)))
    assert np.isfinite([left.chi2, left.excess, left.z, left.inflation]).all()
    assert left.excess > 1e6 * left.dof
