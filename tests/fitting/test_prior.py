"""The rig file as prior information: limits of effects on every rig, weak priors of ratios, absorbed amplitudes."""

from dataclasses import replace
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters, whole_parameters
from dpr_lab.effects import EFFECTS, SLICES, effect_params
from dpr_lab.effects.detent import DETENT_JOINT1
from dpr_lab.effects.effect import Recorded
from dpr_lab.fitting import gauss_newton
from dpr_lab.fitting.estimate import (
    FRICTION,
    Estimate,
    effect_parameters,
    moved,
    ratio_parameters,
    unknown_ratios,
)
from dpr_lab.fitting.gauss_newton import Fit, GaussNewton, fit
from dpr_lab.fitting.prior import parameter_std, prior_of, unknown_jacobian
from dpr_lab.fitting.projection import ColumnSpace
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.hypothesis import scan
from dpr_lab.gap.hypothesis.score_test import score_test
from dpr_lab.gap.screen.record import record as screened
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.rig import Rig, load_rig, parse_rig
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record

RIGS = sorted(path.stem for path in (Path(__file__).parents[2] / "configs" / "rigs").glob("*.toml"))
NOTHING = Recorded(arm_moves=(None,), steps=[(0, 0, 0.5)])


def small_rig() -> Rig:
    return parse_rig(draft_rig(RigMeasures("small", 0.05, 0.05, Measure(0.005), Measure(0.005))))


def test_friction_has_a_prior_of_three_tenths_of_critical_damping_and_its_bounds(paper: Rig) -> None:
    a, b, d, e1, *_ = base_parameters(paper.nominal, paper.L1, paper.g)
    e2 = d * paper.g / paper.L1
    damping = 0.3 * 2.0 * np.sqrt([(a + b + 2.0 * d) * (e1 + e2), b * e2]) / b
    of_the_file = prior_of(paper).covariance[FRICTION, FRICTION] - damping**2
    assert np.all((of_the_file > 0.0) & (of_the_file < (0.1 * damping) ** 2))


@pytest.mark.parametrize("name", [*RIGS, "small"])
def test_every_amplitude_has_a_limit_far_above_its_typical_size_relative_to_the_rig(name: str) -> None:
    rig = small_rig() if name == "small" else load_rig(name)
    limits = prior_of(rig).limits
    paper = prior_of(load_rig("paper")).limits
    for effect in EFFECTS.values():
        for index, parameter in enumerate(effect.parameters, SLICES[effect.name].start):
            assert np.isfinite(limits[index]) == (parameter.role == "amplitude"), (effect.name, parameter.name)
            if parameter.role == "amplitude":
                assert limits[index] > 0
                assert paper[index] > 5 * parameter.typical, (effect.name, parameter.name)
                assert parameter.unit != "N m" or name != "small" or limits[index] < 0.01 * paper[index]


@pytest.fixture(scope="module")
def wrong_rig() -> tuple:
    """A recording of a rod a third shorter than in the rig file, which pulls every effect as far as it goes."""
    rig = load_rig("paper")
    plant = load_plant("paper")
    other = plant.model_copy(update={"parameters": plant.parameters | {"l1": 0.3, "l2": 0.1, "c1": 0.02, "c2": 0.01}})
    runs = record(other, rig, duration=2.0, rate_hz=200)[1:2]
    recordings = Recordings(tuple(screened(run, rig) for run in runs), rig)
    problem, initial = recordings.cut(0.5)
    at = fit_bare_model(recordings, nominal_ratios(rig))[2].fit.estimate
    return problem, at.changed(ratios=nominal_ratios(rig), initial=initial)


@pytest.mark.parametrize("name", EFFECTS)
def test_no_fitted_size_exceeds_its_limit(wrong_rig: tuple, name: str) -> None:
    problem, at = wrong_rig
    own = effect_parameters(EFFECTS[name], refined=True, limits=problem.limits)
    started = at.vector.copy()
    for parameter in own:
        if parameter.amplitude:
            started[parameter.place] = min(30 * parameter.size, 0.9 * parameter.upper)
    estimate = fit(problem, replace(at, vector=started), own, iterations=6).estimate
    sizes = estimate.params[SLICES[name]]
    assert np.isfinite(sizes).all()
    assert (np.abs(sizes) <= problem.limits[SLICES[name]] * (1 + 1e-12)).all()


@pytest.fixture(scope="module")
def bare(wrong_rig: tuple) -> Fit:
    """The ratios alone after two iterations."""
    problem, at = wrong_rig
    return fit(problem, at, ratio_parameters(at), iterations=2)


@pytest.mark.parametrize("name", EFFECTS)
def test_the_score_test_predicts_no_size_beyond_the_limit(wrong_rig: tuple, bare: Fit, name: str) -> None:
    problem, _ = wrong_rig
    test = score_test(problem, bare, [EFFECTS[name]], NOTHING)
    for score in test.shaped.get(name, ()):
        limits = dict(zip((p.name for p in EFFECTS[name].parameters), problem.limits[SLICES[name]], strict=True))
        assert all(abs(size) <= limits[p] * (1 + 1e-9) for p, size in score.named_amplitudes.items())


def test_a_prior_holds_what_the_recordings_do_not_show(wrong_rig: tuple) -> None:
    problem, at = wrong_rig
    blind = replace(problem, weight=1e-9 * problem.weight)
    free = ratio_parameters(at)
    moved = at.changed(ratios=at.ratios * 1.5)
    assert fit(blind, moved, free).values == pytest.approx(problem.prior.mean[:5], rel=1e-3)
    free_of_prior = fit(replace(blind, prior=None), moved, free).values
    assert not np.allclose(free_of_prior, problem.prior.mean[:5], rtol=0.1)


@pytest.mark.slow
def test_cogging_of_order_one_is_gravity_on_one_rod(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scan, "arc", lambda angle: 4 * np.pi)  # as if the rod had turned twice
    rig = load_rig("paper").with_rods("inner")
    runs = record(load_plant("paper"), rig, duration=5.0, rate_hz=200)[1:2]
    _, problem, bare = fit_bare_model(Recordings(tuple(screened(run, rig) for run in runs), rig), nominal_ratios(rig))
    once = tuple(replace(p, scan=(1.0,)) if p.scan else p for p in DETENT_JOINT1.parameters)
    first = replace(DETENT_JOINT1, parameters=once)
    score = score_test(problem, bare.fit, [first], NOTHING).best_score("detent_joint1")
    assert score is not None
    assert score.absorbed["sin1_Nm"] == "e1/b"
    assert "cos1_Nm" not in score.absorbed
    rotor = score_test(problem, bare.fit, [EFFECTS["rotor_inertia_joint1"]], NOTHING).best_score("rotor_inertia_joint1")
    assert rotor is not None
    assert rotor.gain == 0.0
    assert set(rotor.absorbed) == {"inertia_kgm2"}


@pytest.mark.parametrize("twins", [0, 1, 3])
def test_projected_columns_agree_with_elimination(twins: int) -> None:
    rng = np.random.default_rng(twins)
    A = rng.normal(size=(40, 6))
    A[:, 3 : 3 + twins] = A[:, :twins] + 1e-9 * A[:, :twins] ** 2  # exact to rounding: not to be divided by
    space, order = ColumnSpace.of(A, rng.normal(size=40)), [2, 0, 1, 5, 4, 3]
    H, left = space.H.copy(), np.zeros(6)
    for i in order:
        left[i] = max(H[i, i], 0.0)
        if left[i] > 1e-9:
            H -= np.outer(H[:, i], H[i]) / H[i, i]
    assert space.unabsorbed(order) == pytest.approx(left, abs=1e-12)


@pytest.mark.parametrize(("difference", "last"), [(1e-5, 1.0), (1e-3, 0.0)])
def test_a_column_of_which_only_rounding_errors_remain_removes_nothing_from_later_columns(
    difference: float, last: float
) -> None:
    """The second column differs from the first by a multiple of the third."""
    A = np.array([[1.0, 0.0], [1.0, difference], [0.0, 1.0]]).T
    remaining = ColumnSpace.of(A, np.ones(2)).unabsorbed([0, 1, 2])
    assert remaining == pytest.approx([1.0, difference**2 / (1 + difference**2), last], rel=1e-4, abs=1e-9)


def test_a_searched_parameter_has_the_standard_deviation_of_a_uniform_distribution(paper: Rig) -> None:
    lower, upper = paper.bounds
    uniform = np.linspace(lower, upper, 10_001).std(axis=0)
    assert parameter_std(paper)[paper.searched] == pytest.approx(uniform[paper.searched], rel=1e-3)


def test_the_derivatives_of_the_unknowns_are_those_of_differences(paper: Rig) -> None:
    Z, step = paper.nominal, 1e-6 * np.diag(paper.nominal)
    later, earlier = (
        np.array([unknown_ratios(whole_parameters(row, paper.L1, paper.g)) for row in Z + sign * step])
        for sign in (1, -1)
    )
    expected = ((later - earlier) / (2e-6 * Z)[:, None]).T
    assert unknown_jacobian(Z, paper) == pytest.approx(expected, rel=1e-6, abs=1e-8)


def test_the_prior_leads_to_its_mean_in_one_step(paper: Rig) -> None:
    """Ratios to those of the rig file, amplitudes to zero."""
    prior = prior_of(paper)
    params = effect_params({"coulomb_joint1": {"torque_Nm": 1.5e-3}})
    at = Estimate.of(1.1 * prior.mean, params, np.zeros((0, 4)))
    free = (*ratio_parameters(at), *effect_parameters(EFFECTS["coulomb_joint1"]))
    A, e = prior.rows(at, free)
    assert A @ [*(prior.mean[:5] - at.ratios[:5]), -1.5e-3] == pytest.approx(e)
    assert np.abs(e).min() > 0.0


def test_a_step_ends_at_the_bounds_of_a_parameter(paper: Rig) -> None:
    at = Estimate.of(prior_of(paper).mean, effect_params({}), np.zeros((0, 4)))
    limits = prior_of(paper).limits
    free = effect_parameters(EFFECTS["coulomb_joint1"], limits=limits)[:1]
    limit = float(limits[SLICES["coulomb_joint1"].start])
    ends = [moved(at, free, np.array([step]), at.initial) for step in (0.5 * limit, 2.0 * limit, -2.0 * limit)]
    assert [free[0].read(end) for end in ends] == [0.5 * limit, limit, free[0].lower]


def test_a_step_that_costs_more_prior_than_it_reduces_chi2_is_shortened(monkeypatch):
    """The cost is 10 - length + 4 length^2, which exceeds 10 after the whole step but not after a short one."""
    monkeypatch.setattr(gauss_newton, "moved", lambda at, free, step, initial: float(step[0]))
    linear = Mock(chi2_by_segment=np.array([10.0]), initial_steps=lambda step: np.zeros((1, 4)))
    problem = Mock(predict=lambda length: length, chi2_by_segment=lambda length: np.array([10.0 - length]))
    prior = Mock(cost=lambda step: 4.0 * float(step @ step))
    length, _, chi2, cost = gauss_newton._line_search(
        problem, (Mock(),), Mock(linear=linear), np.ones(1), prior, GaussNewton(), 8
    )
    assert (chi2, cost) == (10.0 - length, 4.0 * length**2)
    assert 0.0 < length <= 0.25
