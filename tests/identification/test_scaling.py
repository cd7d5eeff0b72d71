from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.dynamics.base import BASE, RATIOS, base_parameters, whole_parameters
from dpr_lab.effects import EFFECTS
from dpr_lab.effects.effect import EffectParameter
from dpr_lab.fitting.estimate import ON_ELBOW, SCALE, alone_share, unknown_ratios
from dpr_lab.identification.identify import identify
from dpr_lab.identification.model import EstimatedValue
from dpr_lab.identification.prior_update import posterior_of
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.rig import PARAMETERS, Rig, load_rig
from dpr_lab.rig_tables import AddedMass, Parameter
from dpr_lab.search import load_search
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record
from tests.thinned import FULL

WEIGHED = 1e-4
"""Standard uncertainty of a weighed mass, kg."""


def known(rig: Rig, Z: np.ndarray, *names: str) -> Rig:
    weighed = {
        name: Parameter(nominal=value, measured=value, std=WEIGHED)
        for name, value in zip(PARAMETERS, Z.tolist(), strict=True)
        if name in names
    }
    return rig.model_copy(update={"parameters": {**rig.parameters, **weighed}})


def seen(rig: Rig, Z: np.ndarray) -> np.ndarray:
    return unknown_ratios(whole_parameters(Z, rig.L1, rig.g))


def scale(rig: Rig, unknown: np.ndarray) -> Scale:
    return posterior_of(unknown, rig).scale()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "weighed"),
    [
        ("paper", ("m1", "m2", "mb")),
        *(pytest.param(name, (), marks=pytest.mark.long) for name in ("paper", "multiarm")),
    ],
)
def test_the_interval_of_the_scale_holds_the_true_b_in_nine_rigs_of_ten(name: str, weighed: tuple[str, ...]) -> None:
    rig, rng, held = load_rig(name), np.random.default_rng(5), []
    for _ in range(150 if FULL else 60):
        Z = rng.uniform(*rig.bounds)
        low, high = scale(known(rig, Z, *weighed), seen(rig, Z)).interval90
        held.append(low <= base_parameters(Z, rig.L1, rig.g)[BASE.index("b")] <= high)
    assert 0.8 < np.mean(held) <= 1.0


@pytest.mark.parametrize("name", ["paper", pytest.param("multiarm", marks=pytest.mark.long)])
def test_the_intervals_of_the_inner_rod_alone_hold_its_true_values_in_nine_rigs_of_ten(name: str) -> None:
    rig, rng, held = load_rig(name), np.random.default_rng(1), []
    nominal, visible = seen(rig, rig.nominal), (RATIOS.index("e1/b"), RATIOS.index("c1/b"))
    share, carried = alone_share(nominal), nominal[ON_ELBOW] * rig.g / rig.L1
    for _ in range(100 if FULL else 50):
        Z = rng.uniform(*rig.bounds)
        without = base_parameters(Z * (np.array(PARAMETERS) != "m2"), rig.L1, rig.g)
        a, e1, c1 = (float(without[BASE.index(name)]) for name in ("a", "e1", "c1"))
        fitted = nominal.copy()
        fitted[list(visible)] = e1 / a * share + carried, c1 / a * share
        posterior = posterior_of(fitted, rig, visible, alone=True)
        of_a = posterior.scale(nominal[SCALE]).as_inertia("a", share)
        of_c1 = posterior.intervals(nominal[SCALE])["c1"]
        held.append([low <= value <= high for value, (low, high) in ((a, of_a.interval90), (c1, of_c1))])
    assert (np.mean(held, axis=0) > 0.8).all()


@pytest.mark.parametrize("alone", [True, False])
def test_gravity_of_the_wrong_sign_says_nothing_about_the_scale(paper: Rig, alone: bool) -> None:
    nominal = seen(paper, paper.nominal)
    upwards = np.where(np.array([*RATIOS, "b", "p/b"]) == "e1/b", -1.0, 1.0) * nominal
    visible = [RATIOS.index("e1/b")]
    posterior = posterior_of(upwards, paper, visible, alone=alone)
    interval = posterior.scale(nominal[SCALE]).interval90
    assert np.isfinite(interval).all()
    if not alone:
        assert interval == posterior_of(nominal, paper, []).scale(nominal[SCALE]).interval90
    for low, high in posterior.intervals(nominal[SCALE]).values():
        assert 0.0 <= low <= high < np.inf


def test_an_uncertain_ratio_of_one_rod_does_not_shift_the_interval_away_from_the_assumed_inertia(paper: Rig) -> None:
    fitted, visible = seen(paper, paper.nominal), [RATIOS.index("e1/b")]
    share, carried = alone_share(fitted), fitted[ON_ELBOW] * paper.g / paper.L1
    e1_over_a = 0.4 * (fitted[visible[0]] - carried) / share
    fitted[visible] = e1_over_a * share + carried
    b = float(fitted[SCALE])
    assert b in posterior_of(fitted, paper, visible, alone=True).scale(b).interval90  # at its edge
    variance = np.array([[(0.4 * e1_over_a * share) ** 2]])
    low, high = posterior_of(fitted, paper, visible, variance, alone=True).scale(b).interval90
    assert low < 0.95 * b
    assert high > 1.05 * b


@pytest.mark.parametrize("factor", [1.0, 0.8])
def test_friction_of_the_inner_rod_alone_is_as_uncertain_as_its_inertia(paper: Rig, factor: float) -> None:
    fitted, visible = seen(paper, paper.nominal), (RATIOS.index("e1/b"), RATIOS.index("c1/b"))
    fitted[visible[1]] *= factor
    posterior = posterior_of(fitted, paper, visible, np.zeros((2, 2)), alone=True)
    parameters, _ = posterior.parameters(posterior.scale(), {})
    interval, of_a = parameters["c1"].interval90, posterior.scale().interval90
    assert interval is not None
    assert interval == pytest.approx([fitted[visible[1]] * end for end in of_a], rel=1e-5)


def test_a_scale_fixed_only_by_bounds_is_reported_as_not_measured(paper: Rig) -> None:
    assumed = scale(paper, seen(paper, paper.nominal))
    assert assumed.fixed_by == "bound"
    assert assumed.assumption == "assuming b = 0.00533 kg m^2 (not measured)"
    assert "Only the ratios of masses, inertias and torques to b, the inertia of the outer rod" in assumed.sentence


def test_measured_values_that_fix_b_make_absolute_sizes(paper: Rig) -> None:
    rig = known(paper, paper.nominal, "l2", "m2", "J2", "m1", "mb")
    measured = scale(rig, seen(rig, rig.nominal))
    assert measured.fixed_by == "measured"
    assert "Measured values of the rig file determine" in measured.sentence


def test_an_absolute_interval_is_as_wide_as_fit_and_scale_together() -> None:
    assumed = Scale(b=0.005, interval90=(0.004, 0.006), fixed_by="bound")
    assert assumed.absolute90(2.0, (2.0, 2.0)) == pytest.approx((1.6, 2.4))
    assert assumed.absolute90(2.0, (1.7, 2.3)) == pytest.approx((1.5, 2.5))
    assert assumed.absolute90(-2.0, (-2.0, -2.0)) == pytest.approx((-2.4, -1.6))
    assert assumed.absolute90(2.0, (0.0, 4.0)) == pytest.approx((0.0, 2.0 + np.hypot(2.0, 0.4)))
    assert assumed.absolute90(2.0, (2.0, 2.0), power=-1) == pytest.approx((2.0 / 1.2, 2.5))
    assert assumed.absolute90(2.0, (1.7, 2.3), power=0) == (1.7, 2.3)
    identified = assumed.model_copy(update={"fixed_by": "data"})
    assert identified.absolute90(2.0, (1.7, 2.3)) == (1.7, 2.3)


def test_a_motor_constant_widens_absolute_sizes_although_the_recordings_determine_b() -> None:
    fitted = Scale(b=0.005, interval90=(0.004, 0.006), fixed_by="data", constants_std=0.1)
    assert fitted.absolute90(2.0, (2.0, 2.0)) == pytest.approx((2.0 - 0.329, 2.0 + 0.329), abs=1e-3)
    assert fitted.absolute90(2.0, (1.7, 2.3), power=0) == (1.7, 2.3)
    assert fitted.as_inertia("a", 3.0).factors90(1) == fitted.factors90(1) == pytest.approx((0.8355, 1.1645), abs=1e-4)


def test_a_ratio_does_not_depend_on_the_assumed_b() -> None:
    for b in (0.004, 0.005):
        assumed = Scale(b=b, interval90=(0.9 * b, 1.1 * b), fixed_by="bound")
        assert assumed.ratio(3.0 * b) == pytest.approx(3.0)
        assert assumed.ratio(3.0 / b, power=-1) == pytest.approx(3.0)


def test_every_parameter_of_an_effect_has_a_power_of_the_scale_and_the_unit_of_its_ratio() -> None:
    for effect in EFFECTS.values():
        for parameter in effect.parameters:
            assert bool(parameter.ratio_unit) == (parameter.scale_power != 0), parameter
    assert EFFECTS["coulomb_joint1"].parameters[0].ratio_unit == "1/s^2"
    assert EFFECTS["encoder_offset_joint1"].parameters[0].scale_power == 0


def test_values_that_only_bounds_fix_have_an_interval_inside_those_bounds(paper: Rig) -> None:
    unknown = seen(paper, paper.nominal)
    ratios = {
        name: EstimatedValue(value=value, std=0.0, interval90=(value, value))
        for name, value in zip(RATIOS, unknown[:5].tolist(), strict=True)
    }
    posterior = posterior_of(unknown, paper)
    nine, base = posterior.parameters(posterior.scale(), ratios)
    for name, (lower, upper) in zip(PARAMETERS, paper.bounds.T.tolist(), strict=True):
        low, high = nine[name].interval90 or (np.nan, np.nan)
        assert nine[name].fixed_by == "bound"
        assert lower <= low < nine[name].value < high <= upper
    low, high = base["a"].interval90 or (np.nan, np.nan)
    width = np.array(base["b"].interval90) / base["b"].value
    assert np.array([low, high]) / base["a"].value == pytest.approx(width, rel=1e-6)


@pytest.mark.parametrize(
    ("unit", "ratio_unit"),
    [
        ("N m (s/rad)^0.5", "N m (s/rad)^0.5 / (kg m^2)"),
        ("1/kg^2", "1/kg^2 / (kg m^2)^-1"),
        ("N m", "1/s^2"),
        ("rad", ""),
    ],
)
def test_the_ratio_of_any_unit_of_a_plugin_has_a_unit(unit: str, ratio_unit: str) -> None:
    assert EffectParameter("size", unit, 1e-3).ratio_unit == ratio_unit


@pytest.mark.parametrize(
    ("value", "interval", "to", "moved"),
    [
        (1.0, (0.8, 1.2), -0.5, (-0.7, -0.3)),
        (0.1, (0.0, 0.25), -0.5, (-0.6, -0.35)),
        (-0.1, (-0.3, 0.0), 0.5, (0.3, 0.6)),
        (0.1, (0.05, 0.25), 0.01, (0.0, 0.16)),
        (0.1, (0.0, 0.25), 0.2, (0.0, 0.35)),
        (-0.1, (-0.3, 0.0), -0.2, (-0.4, 0.0)),
    ],
)
def test_a_moved_interval_contains_the_value(
    value: float, interval: tuple[float, float], to: float, moved: tuple[float, float]
) -> None:
    estimate = EstimatedValue(value=value, std=0.1, interval90=interval).moved(to)
    assert estimate.interval90 == pytest.approx(moved)


def test_a_scale_from_a_known_torque_or_mass_states_that_its_error_is_in_no_interval() -> None:
    of_data = Scale(b=0.005, interval90=(0.0049, 0.0051), fixed_by="data")
    assert "treated as exact" in of_data.sentence
    for other in ({"constants_std": 0.02}, {"by_friction": True}):
        assert "treated as exact" not in of_data.model_copy(update=other).sentence
    assert "treated as exact" not in of_data.model_copy(update={"fixed_by": "measured"}).sentence


def test_a_mass_on_the_inner_rod_alone_determines_its_inertia_without_the_outer_rod(paper: Rig) -> None:
    rig = paper.with_rods("inner").model_copy(update={"poses": {"X2": paper.poses["X2"]}})
    heavy = rig.model_copy(update={"added_mass": AddedMass(rod="inner", mass=0.05, position=0.3)})
    plant = load_plant("paper")
    (alone,), (loaded,) = (record(plant, mounted, duration=2.0, rate_hz=200) for mounted in (rig, heavy))
    quick = load_search("segments").model_copy(update={"generations": 2})
    model = identify([alone, replace(loaded, name="with mass")], rig, settings=quick)
    assert model.scale is not None
    without_outer = plant.Z * (np.array(PARAMETERS) != "m2")
    (low, high), true = model.scale.interval90, base_parameters(without_outer, paper.L1, paper.g)[BASE.index("a")]
    assert 0.97 * true < low < true < high < 1.03 * true
