from statistics import NormalDist
from typing import Any

import numpy as np
import pytest

from dpr_lab.dynamics.base import RATIOS, base_parameters, ratios, whole_parameters
from dpr_lab.fitting.estimate import SCALE, unknown_ratios, visible_ratios
from dpr_lab.identification.model import EstimatedValue, ParameterValue
from dpr_lab.identification.prior_update import _edges, as_observed, clamped_cosine, posterior_of
from dpr_lab.rig import PARAMETERS, Rig
from dpr_lab.rig_tables import Parameter
from dpr_lab.setup import Setup
from tests.thinned import FULL

TRUE = np.array([0.21, 0.19, 0.104, 0.093, 0.215, 0.00107, 0.00093, 0.00139, 0.00128])
EXACT = np.zeros((5, 5))


def measured(rig: Rig, *names: str) -> Rig:
    known = {
        name: Parameter(
            nominal=float(TRUE[PARAMETERS.index(name)]), measured=float(TRUE[PARAMETERS.index(name)]), std=1e-6
        )
        for name in names
    }
    return rig.model_copy(update={"parameters": {**rig.parameters, **known}})


def update_prior(
    estimated: np.ndarray, covariance: np.ndarray, rig: Rig
) -> tuple[dict[str, ParameterValue], dict[str, ParameterValue]]:
    """Nine parameters and base parameters for (5,) ratios, or (6,) with b."""
    unknown = unknown_ratios(whole_parameters(TRUE, rig.L1, rig.g))
    unknown[: len(estimated)] = estimated
    posterior = posterior_of(unknown, rig, range(len(estimated)), covariance)
    five = {
        name: EstimatedValue(value=value, std=0.0, interval90=(value, value))
        for name, value in zip(RATIOS, estimated[:5].tolist(), strict=True)
    }
    return posterior.parameters(posterior.scale(), five)


def truth(rig: Rig) -> np.ndarray:
    return ratios(base_parameters(TRUE, rig.rig.L1, rig.rig.g))


def test_without_measured_values_the_nine_have_the_ratios_and_are_held_by_their_bounds_alone(paper: Rig) -> None:
    result = update_prior(truth(paper), EXACT, paper)[0]
    Z = np.array([result[name].value for name in PARAMETERS])
    assert ratios(base_parameters(Z, paper.rig.L1, paper.rig.g)) == pytest.approx(truth(paper), rel=1e-9)
    assert {value.fixed_by for value in result.values()} == {"bound"}
    assert all(value.std is None for value in result.values())


def test_four_measured_values_let_the_data_fix_the_other_five(paper: Rig) -> None:
    result = update_prior(truth(paper), EXACT, measured(paper, "m1", "m2", "mb", "l2"))[0]
    for name, true in zip(PARAMETERS, TRUE, strict=True):
        assert result[name].value == pytest.approx(true, rel=1e-4)
    assert [name for name in PARAMETERS if result[name].fixed_by == "measured"] == ["l2", "m1", "m2", "mb"]
    assert [name for name in PARAMETERS if result[name].fixed_by == "data"] == ["l1", "c1", "c2", "J1", "J2"]


def test_a_measured_value_is_bounded_by_its_90_percent_interval_and_another_by_the_rig_file(paper: Rig) -> None:
    rig = measured(paper, "m1")
    weighed, nominal = PARAMETERS.index("m1"), rig.bounds[0][PARAMETERS.index("m1")]
    lower, upper = _edges(rig)
    assert (nominal - lower[weighed], upper[weighed] - nominal) == pytest.approx(
        [1e-6 * NormalDist().inv_cdf(0.95)] * 2
    )
    others = np.arange(len(PARAMETERS)) != weighed
    assert np.array_equal([lower[others], upper[others]], np.array(rig.bounds)[:, others])


def test_three_weighed_parts_leave_one_direction_that_only_bounds_hold(paper: Rig) -> None:
    result = update_prior(truth(paper), EXACT, measured(paper, "m1", "m2", "mb"))[0]
    assert {result[name].fixed_by for name in ("m1", "m2", "mb")} == {"measured"}
    assert "bound" in {result[name].fixed_by for name in ("l1", "l2", "J1", "J2", "c1", "c2")}


def test_the_uncertainty_of_a_ratio_reaches_the_parameters_it_fixes(paper: Rig) -> None:
    rig = measured(paper, "m1", "m2", "mb", "l2")
    r = truth(paper)
    covariance = np.diag((np.array([0, 0, 0, 0.01, 0]) * r) ** 2)
    result = update_prior(r, covariance, rig)[0]
    assert result["c1"].std == pytest.approx(0.01 * TRUE[5], rel=0.05)
    assert result["c2"].std is not None
    assert result["c2"].std < 1e-3 * TRUE[6]


def test_a_known_scale_leaves_two_directions_and_fixes_the_base_parameters(paper: Rig) -> None:
    base = base_parameters(TRUE, paper.rig.L1, paper.rig.g)
    nine, absolute = update_prior(np.append(truth(paper), base[1]), np.zeros((6, 6)), paper)
    assert {value.fixed_by for value in absolute.values()} == {"data"}
    assert [absolute[name].value for name in absolute] == pytest.approx(base, rel=1e-8)
    assert [name for name in PARAMETERS if nine[name].fixed_by == "data"] == ["c1", "c2"]
    assert nine["c1"].value == pytest.approx(TRUE[5], rel=1e-8)


def test_without_a_scale_no_base_parameter_is_fixed(paper: Rig) -> None:
    _, absolute = update_prior(truth(paper), EXACT, paper)
    assert {value.fixed_by for value in absolute.values()} == {"bound"}


def test_the_update_agrees_with_a_weighted_sample_of_the_prior(paper: Rig) -> None:
    """One rod whose ratio e1/a is 6 % below that of the rig file, with an uncertainty of 3 %."""
    l1, m1, mb, J1 = (paper.parameters[name] for name in ("l1", "m1", "mb", "J1"))
    logs = [np.log(p.upper / p.lower) / np.sqrt(12) for p in (l1, m1, mb, J1) if p.upper and p.lower]
    middle = np.log([p.nominal for p in (l1, m1, mb, J1)])
    x = np.exp(middle + np.array(logs) * np.random.default_rng(0).standard_normal((400_000, 4))).T
    a, e1 = x[3] + x[1] * x[0] ** 2 + x[2] * paper.L1**2, (x[1] * x[0] + x[2] * paper.L1) * paper.g
    unknown = unknown_ratios(whole_parameters(paper.nominal, paper.L1, paper.g))
    share = unknown[0] - unknown[6]
    wanted = 0.94 * (unknown[2] - unknown[6] * paper.g / paper.L1) / share
    unknown[2] = wanted * share + unknown[6] * paper.g / paper.L1
    weight = np.exp(-0.5 * (np.log(e1 / a / wanted) / 0.03) ** 2)
    mean = np.average(np.log(a), weights=weight)
    std = np.average((np.log(a) - mean) ** 2, weights=weight) ** 0.5
    posterior = posterior_of(unknown, paper, [2], np.array([[(0.03 * wanted * share) ** 2]]), alone=True)
    inertia, log_std = posterior.inertia()
    assert np.log(inertia) == pytest.approx(mean, abs=0.15 * std)
    assert log_std == pytest.approx(std, rel=0.1)
    assert posterior.b == pytest.approx(inertia / share)


def test_two_commands_with_different_covariances_and_assumed_ratios_state_the_same_inertia_of_one_rod(
    paper: Rig,
) -> None:
    unknown = unknown_ratios(whole_parameters(0.9 * paper.nominal, paper.L1, paper.g))
    of_fit = posterior_of(unknown, paper, [2, 3], np.diag((1e-5 * unknown[[2, 3]]) ** 2), alone=True)
    before_the_fit = posterior_of(unknown, paper, alone=True)
    assert of_fit.inertia()[0] == pytest.approx(before_the_fit.inertia()[0], rel=1e-4)
    nine, base = of_fit.parameters(of_fit.scale(), {})
    Z = {name: value.value for name, value in nine.items()}
    a = Z["J1"] + Z["m1"] * Z["l1"] ** 2 + Z["mb"] * paper.L1**2
    assert a == pytest.approx(of_fit.inertia()[0], rel=1e-6)
    assert base["a"].value == pytest.approx(unknown[0] * of_fit.b)
    assert Z["c1"] / a == pytest.approx(unknown[3] / (unknown[0] - unknown[6]), rel=1e-4)


@pytest.mark.parametrize("factor", [0.0, 100.0])
def test_an_interval_of_one_rod_contains_a_friction_that_the_fit_assumed(paper: Rig, factor: float) -> None:
    unknown = unknown_ratios(whole_parameters(paper.nominal, paper.L1, paper.g))
    unknown[RATIOS.index("c2/b")] *= factor
    posterior = posterior_of(unknown, paper, alone=True)
    for part in posterior.parameters(posterior.scale(), {}):
        for name, value in part.items():
            assert value.interval90 is not None
            assert value.interval90[0] <= value.value <= value.interval90[1], name


@pytest.mark.parametrize("alone", [False, True])
def test_a_friction_of_zero_has_the_interval_of_its_ratio(paper: Rig, alone: bool) -> None:
    unknown = unknown_ratios(whole_parameters(paper.nominal, paper.L1, paper.g))
    unknown[RATIOS.index("c1/b")] = 0.0
    five = {
        name: EstimatedValue(value=value, std=0.0, interval90=(value, value))
        for name, value in zip(RATIOS, unknown.tolist(), strict=False)
    } | {"c1/b": EstimatedValue(value=0.0, std=0.0, interval90=(0.0, 0.3))}
    posterior = posterior_of(unknown, paper, alone=alone)
    nine, base = posterior.parameters(posterior.scale(), five)
    for value in (nine["c1"], base["c1"]):
        assert (value.value, value.fixed_by) == (0.0, "bound")
        assert value.interval90 == pytest.approx((0.0, 0.3 * posterior.b))


def test_the_base_parameters_have_the_ratios_of_the_fit_although_these_are_uncertain(paper: Rig) -> None:
    """Exported models simulate with them, so they would otherwise not follow the recordings."""
    given = 1.1 * truth(paper)
    _, base = update_prior(given, np.diag((0.2 * given) ** 2), measured(paper, "m1", "m2", "mb"))
    assert [base[name[:-2]].value / base["b"].value for name in RATIOS] == pytest.approx(given, rel=1e-8)


@pytest.mark.parametrize(
    ("weighed", "source", "fixed_by"), [(True, "data", "data"), (True, "bound", "bound"), (False, "data", "bound")]
)
def test_a_friction_of_zero_has_the_source_of_its_ratio(paper: Rig, weighed: bool, source: Any, fixed_by: str) -> None:
    rig = measured(paper, "m1", "m2", "mb", "l2") if weighed else paper
    unknown = unknown_ratios(whole_parameters(TRUE, rig.L1, rig.g))
    friction = RATIOS.index("c1/b")
    unknown[friction] = 0.0
    five = {
        name: EstimatedValue(value=value, std=1e-3, interval90=(value, value + 2e-3))
        for name, value in zip(RATIOS, unknown.tolist(), strict=False)
    }
    five["c1/b"] = five["c1/b"].model_copy(update={"fixed_by": source})
    posterior = posterior_of(unknown, rig)
    scale = posterior.scale()
    for values in posterior.parameters(scale, five):
        value = values["c1"]
        assert (value.value, value.fixed_by) == (0.0, fixed_by)
        assert value.std == (scale.b * 1e-3 if fixed_by == "data" else None)


def fitted_to(true: np.ndarray, start: np.ndarray, rig: Rig, setups: list[Setup]) -> np.ndarray:
    """Ratios of a fit that keeps undetermined ratios at their start, for exact recordings with a clamped elbow."""
    unknown, visible, clamped = start.copy(), list(visible_ratios(setups)), clamped_cosine(setups)
    for _ in range(30):
        values, slopes = as_observed(unknown, rig, False, clamped)
        missing = as_observed(true, rig, False, clamped)[0] - values
        unknown[visible] += np.linalg.solve(slopes[np.ix_(visible, visible)], missing[visible])
    return unknown


CLAMPED = {"straight": [0.0], "folded": [3.1], "bent": [0.7], "several": [0.0, 1.6]}


@pytest.mark.parametrize("angles", CLAMPED.values(), ids=CLAMPED)
def test_intervals_of_base_parameters_scale_and_body_contain_the_truth_with_a_clamped_elbow(
    paper: Rig, angles: list[float]
) -> None:
    setups = [Setup("clamped", elbow=angle) for angle in angles]
    visible, clamped, rng, inside = visible_ratios(setups), clamped_cosine(setups), np.random.default_rng(5), []
    nominal = unknown_ratios(whole_parameters(paper.nominal, paper.L1, paper.g))
    for _ in range(40 if FULL else 20):
        whole = whole_parameters(rng.uniform(*paper.bounds), paper.L1, paper.g)
        true = unknown_ratios(whole)
        fitted = fitted_to(true, nominal, paper, setups)
        posterior = posterior_of(fitted, paper, visible, clamped=clamped)
        exact = {
            name: EstimatedValue(value=value, std=0.0, interval90=(value, value))
            for name, value in zip(RATIOS, fitted.tolist(), strict=False)
        }
        scale = posterior.scale()
        _, base = posterior.parameters(scale, exact)
        intervals = [value.interval90 or (np.nan, np.nan) for value in base.values()]
        body = as_observed(true, paper, False, clamped)[0][SCALE] / posterior.share
        assert scale.sizes90 is not None
        intervals += [scale.interval90, scale.sizes90]
        truths = [*whole[: len(base)].tolist(), true[SCALE], body]
        inside.append([low <= value <= high for (low, high), value in zip(intervals, truths, strict=True)])
    assert np.mean(inside, axis=0).min() >= 0.8


@pytest.mark.parametrize("angles", CLAMPED.values(), ids=CLAMPED)
def test_rigs_with_equal_observed_quantities_swing_alike_with_a_clamped_elbow(paper: Rig, angles: list[float]) -> None:
    setups = [Setup("clamped", elbow=angle) for angle in angles]
    one = unknown_ratios(whole_parameters(TRUE, paper.L1, paper.g))
    other = fitted_to(one, one * [1.3, 1.2, 1.0, 1.0, 1.0, 1.0, 1.0], paper, setups)
    exact = [round(angle / np.pi) * np.pi if abs(np.sin(angle)) < 0.05 else angle for angle in angles]
    for angle in exact:
        accelerations = []
        for a, d, e1, c1, *_ in (one, other):
            inertia = a + 1.0 + 2.0 * d * np.cos(angle)
            theta = np.linspace(-3.0, 3.0, 7)
            torque = e1 * np.sin(theta) + d * paper.g / paper.L1 * np.sin(theta + angle) - c1 * 2.0
            accelerations.append(torque / inertia)
        assert accelerations[0] == pytest.approx(accelerations[1], rel=1e-6, abs=1e-9)


def test_a_free_elbow_in_one_run_determines_the_full_ratios(paper: Rig) -> None:
    setups = [Setup(), Setup("clamped")]
    assert clamped_cosine(setups) is clamped_cosine([Setup("inner")]) is None
    unknown = unknown_ratios(whole_parameters(TRUE, paper.L1, paper.g))
    mixed = posterior_of(unknown, paper, visible_ratios(setups), clamped=clamped_cosine(setups))
    assert mixed.scale() == posterior_of(unknown, paper).scale()


def test_the_gravity_of_folded_rods_may_have_another_sign_than_in_the_rig_file(paper: Rig) -> None:
    factors = {"l2": 2.6, "m2": 1.5, "mb": 0.05, "m1": 0.35}
    longer = {
        name: Parameter(**{key: getattr(value, key) * factors.get(name, 1.0) for key in ("nominal", "lower", "upper")})
        for name, value in paper.parameters.items()
    }
    rig = paper.model_copy(update={"parameters": longer})
    unknown = unknown_ratios(whole_parameters(rig.nominal, rig.L1, rig.g))
    assert as_observed(unknown, rig, False, -1.0)[0][2] < 0.0
    unknown[2] = 1.05 * unknown[1] * rig.g / rig.L1
    posterior = posterior_of(unknown, rig, [2], clamped=-1.0)
    reached = unknown_ratios(whole_parameters(posterior.median, rig.L1, rig.g))
    assert as_observed(reached, rig, False, -1.0)[0][2] == pytest.approx(as_observed(unknown, rig, False, -1.0)[0][2])
