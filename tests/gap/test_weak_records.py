"""Recordings that determine little: the fit uses nominal values and bounds of the rig file, with wide intervals."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.dynamics.base import RATIOS, base_parameters, ratios, whole_parameters
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import SCALE, unknown_ratios
from dpr_lab.gap.conclusion.ratios import determined, fitted_scale
from dpr_lab.gap.conclusion.ratios import ratios as ratios_of
from dpr_lab.gap.conclusion.uncertainty import covariance
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.identification.identify import identify
from dpr_lab.identification.model import Model
from dpr_lab.identification.prior_update import as_observed, clamped_cosine
from dpr_lab.rig import PARAMETERS, Rig, load_rig, parse_rig
from dpr_lab.rig_tables import AddedMass
from dpr_lab.run import Run
from dpr_lab.search import load_search
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.workflows.rig_file import RigMeasures, draft_rig
from dpr_lab.workflows.rig_toml import Measure
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record
from tests.one_rod import Rod, recorded, swing
from tests.thinned import candidates, thinned

TABLES = Path(__file__).parents[2] / "configs" / "tables"
LIGHT = {"m2": 0.05, "J2": 0.000167}
"""A light outer rod: a/b = 72."""


def told_roughly(paper: Rig, true: np.ndarray, seed: int, rods: dict[str, str]) -> Rig:
    """A rig file with nominal values up to 10 % off, and bounds 20 % about them."""
    off = np.random.default_rng(seed).uniform(0.9, 1.1, len(PARAMETERS))
    described = paper.model_dump(exclude_none=True)
    for name, value in zip(PARAMETERS, (off * true).tolist(), strict=True):
        described["parameters"][name].update(nominal=value, lower=0.8 * value, upper=1.2 * value)
    return Rig.model_validate(described).with_rods(**rods)


def gravity_torque(rig: Rig, diagnosis: Diagnosis) -> float:
    """Gravity torque of the inner rod alone according to a diagnosis, N m."""
    assert diagnosis.p_over_b is not None
    carried = diagnosis.p_over_b * rig.g / rig.L1
    return diagnosis.scale_b * (diagnosis.all_ratios["e1/b"].value - carried)


def case(
    paper: Rig, rods: dict[str, str], effects: dict | None = None, seed: int = 1
) -> tuple[Rig, list[Run], np.ndarray]:
    plant = load_plant("paper")
    changes = {"parameters": plant.parameters | LIGHT, "effects": effects or {}, "seed": seed}
    plant = plant.model_copy(update=changes)
    rig = told_roughly(paper, plant.Z, seed, rods)
    truth = ratios(base_parameters(plant.Z, paper.L1, paper.g))
    return rig, record(plant, rig, duration=5.0, rate_hz=200), truth


@pytest.mark.long
@pytest.mark.parametrize("seed", thinned([1, 2], 2))
@pytest.mark.parametrize(
    ("drag", "size"), [pytest.param("air_drag_outer", 0.02, marks=pytest.mark.long), ("air_drag_both", 0.01)]
)
def test_drag_with_the_elbow_clamped_has_an_interval_that_holds_the_truth(
    paper: Rig, drag: str, size: float, seed: int
) -> None:
    rig, runs, truth = case(paper, {"elbow": "clamped"}, {drag: {"coefficient_kg_per_m2": size}}, seed)
    diagnosis = diagnose(runs, rig)
    (effect,) = diagnosis.effects
    assert drag in effect.members
    (result,) = effect.parameters.values()
    assert result.value == pytest.approx(size, rel=0.5)
    assert diagnosis.scale is not None
    assert result.interval90_with_scale is not None
    low, high = result.interval90_with_scale
    assert low < size < high
    for name, true in zip(RATIOS, truth, strict=True):
        low, high = diagnosis.ratios[name].interval90
        assert low < true < high
        assert high - low < 2.0 * true
    assert f"b = {diagnosis.scale_b:.4g} kg m^2" in " ".join(diagnosis.assumptions)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rods", "poses"),
    [
        pytest.param({"mounted": "inner"}, ["X2"], marks=pytest.mark.long, id="inner rod alone"),
        pytest.param({"mounted": "outer"}, ["X2"], marks=pytest.mark.long, id="outer rod alone"),
        pytest.param({"elbow": "clamped"}, ["X1"], id="one elbow clamped"),
    ],
)
def test_one_release_gives_wide_and_finite_ratios(paper: Rig, rods: dict[str, str], poses: list[str]) -> None:
    rig, runs, truth = case(paper, rods)
    runs = [run for run in runs if run.name in poses]
    nominal = ratios(base_parameters(rig.nominal, rig.L1, rig.g))
    quick = load_search("segments").model_copy(update={"generations": 2})
    model, diagnosis = identify(runs, rig, settings=quick), diagnose(runs, rig)
    for i, name in enumerate(RATIOS):
        estimate, (low, high) = model.all_ratios[name], diagnosis.all_ratios[name].interval90
        assert np.isfinite([estimate.value, estimate.std, low, high]).all()
        assert abs(estimate.value - truth[i]) < 4 * estimate.std or estimate.value == 0.0
        assert low - 0.5 * (high - low) < truth[i] < high + 0.5 * (high - low)
        if name not in model.covariance.order:
            assert estimate.value == pytest.approx(nominal[i], rel=1e-9)
            assert estimate.std > 0.02 * nominal[i]


def test_stated_ratios_of_a_clamped_elbow_contain_the_uncertainty_of_undetermined_ratios(paper: Rig, bare) -> None:
    rig, runs, truth = case(paper, {"elbow": "clamped"})
    alone = [run for run in runs if run.pose == "X1"]
    problem, model = bare(alone, rig)
    of_fit = covariance(problem, model, rig)
    stated, of_stated = determined(problem, model.fit, of_fit, rig)
    assert set(stated) == {"d/b", "e1/b", "c1/b"}
    for (name, ratio), variance in zip(stated.items(), np.diag(of_stated), strict=True):
        low, high = ratio.interval90
        assert 0.0 <= low < truth[RATIOS.index(name)] < high
        assert high - ratio.value == pytest.approx(NORMAL_Q90 * variance**0.5)
        assert ratio == ratios_of(problem, model, of_fit, rig)[name]


def mass_on_a_clamped_elbow(paper: Rig) -> tuple[Rig, list[Run], float, float]:
    """Releases without and with a mass; the true b and the true inertia of the whole body, kg m^2."""
    plant = load_plant("paper")
    rig = told_roughly(paper, plant.Z, 1, {"elbow": "clamped"})
    rig = rig.model_copy(update={"poses": {"X1": rig.poses["X1"]}})
    heavy = rig.model_copy(update={"added_mass": AddedMass(rod="outer", mass=0.05, position=0.3)})
    alone, loaded = (record(plant, mounted, duration=2.0, rate_hz=200) for mounted in (rig, heavy))
    runs = [*alone, *(replace(run, name=f"{run.name} with mass") for run in loaded)]
    true = unknown_ratios(whole_parameters(plant.Z, paper.L1, paper.g))
    return rig, runs, float(true[SCALE]), float(of_body(true, rig, runs))


def of_body(unknown: np.ndarray, rig: Rig, runs: list[Run]) -> float:
    """Inertia of the whole body with a clamped elbow, kg m^2."""
    clamped = clamped_cosine(run.setup for run in runs)
    return as_observed(unknown, rig, alone=False, clamped=clamped)[0][SCALE]


def test_a_mass_on_a_clamped_elbow_determines_the_whole_body_and_not_b(paper: Rig, bare) -> None:
    rig, runs, b, body = mass_on_a_clamped_elbow(paper)
    problem, model = bare(runs, rig)
    fitted = fitted_scale(problem, model.fit, covariance(problem, model, rig), rig)
    assert fitted is not None
    assert fitted.fixed_by == "data"
    assert "added masses are treated as exact" in fitted.condition
    low, high = fitted.interval90
    assert low < b < high
    assert fitted.sizes90 is not None
    share = of_body(model.fit.estimate.ratios, rig, runs) / fitted.b
    assert fitted.b == pytest.approx(body / share, rel=0.02)
    assert fitted.sizes90[1] - fitted.sizes90[0] < 0.1 * (high - low)


def test_identify_states_one_interval_of_b_for_a_mass_on_a_clamped_elbow(paper: Rig) -> None:
    rig, runs, b, _ = mass_on_a_clamped_elbow(paper)
    model = identify(runs, rig, settings=load_search("segments").model_copy(update={"generations": 2}))
    assert isinstance(model, Model)
    assert model.scale is not None
    assert model.scale.fixed_by == "data"
    low, high = model.scale.interval90
    assert low < b < high
    assert model.base["b"].interval90 == (low, high)


@pytest.mark.slow
def test_a_clamped_elbow_that_is_nearly_straight_shows_the_gravity_of_the_outer_rod(paper: Rig) -> None:
    """The rods hang 8 degrees aside, which no other ratio explains."""
    rig, runs, _ = case(paper, {"elbow": "clamped"})
    alone = [run for run in runs if run.pose == "X1"]
    assert 0.05 < abs(np.sin(alone[0].elbow)) < 0.15
    quick = load_search("segments").model_copy(update={"generations": 2})
    assert identify(alone, rig, settings=quick).fit.chi2_per_dof < 2.0


@pytest.mark.slow
def test_several_clamped_elbows_are_identified_within_the_bounds(paper: Rig) -> None:
    rig, runs, truth = case(paper, {"elbow": "clamped"})
    quick = load_search("segments").model_copy(update={"generations": 2})
    model = identify(runs, rig, settings=quick)
    for name, true in zip(RATIOS, truth, strict=True):
        assert abs(model.ratios[name].value - true) < 3 * model.ratios[name].std
    assert 0.01 < model.ratios["a/b"].std / model.ratios["a/b"].value < 0.25


@pytest.mark.slow
def test_a_zero_offset_and_dry_friction_of_one_rod_are_not_called_cogging(tmp_path: Path) -> None:
    rod = Rod()
    rig, runs = recorded(rod, 0, tmp_path)
    diagnosis = diagnose(runs, rig, library=candidates("coulomb", "encoder", "base_", "com_", "detent", "rotor"))
    named = {effect.name: effect for effect in diagnosis.effects}
    assert set(named) & {"encoder_offset_joint1", "base_tilt", "com_offset_link1"}
    assert "coulomb_joint1" in named
    assert len(named) == 2
    # The recordings show the torque relative to the inertia of what swings, of which the rig file holds a guess.
    of_gravity = named["coulomb_joint1"].parameters["torque_Nm"].value / gravity_torque(rig, diagnosis)
    assert of_gravity == pytest.approx(rod.dry, rel=0.3)
    assert diagnosis.absorbed["rotor_inertia_joint1"] == {"inertia_kgm2": "e1/b"}
    assert "rotor_inertia_joint1 is indistinguishable from e1/a" in " ".join(diagnosis.assumptions)


@pytest.mark.long
@pytest.mark.parametrize(
    "rod",
    [
        pytest.param(Rod(dry=0.0, offset=2.4e-3, drift=-4e-4, noise=1.2e-3), id="one-that-crosses-the-true-zero"),
        pytest.param(Rod(dry=0.006, offset=0.0, drift=6e-4, noise=1.5e-3), marks=pytest.mark.long, id="dry-friction"),
    ],
)
def test_a_zero_that_drifts_is_no_tilt(rod: Rod, tmp_path: Path) -> None:
    rig, runs = recorded(rod, 3, tmp_path)
    result = {effect.name: effect for effect in diagnose(runs, rig, library=candidates("enc", "base_", "coul")).effects}
    assert set(result) == {"encoder_drift_joint1"} | ({"coulomb_joint1"} if rod.dry else set())
    assert result["encoder_drift_joint1"].parameters["rate_rad_per_s"].value == pytest.approx(rod.drift, rel=0.1)


@pytest.mark.long
def test_friction_unequal_in_both_directions_does_not_stand_for_a_zero_offset(tmp_path: Path) -> None:
    rod = replace(Rod(), dry=0.0103, damping=0.0029, length=0.256, mass=0.0655, noise=1.9e-3, duration=12.0)
    rig, runs = recorded(rod, 1, tmp_path)
    library = candidates("coulomb", "encoder", "base_", "com_", "friction")
    named = {effect.name for effect in diagnose(runs, rig, library=library).effects}
    assert "coulomb_joint1" in named
    assert named & {"encoder_offset_joint1", "base_tilt", "com_offset_link1"}
    assert "friction_curve_joint1" not in named


@pytest.mark.slow
def test_a_swing_without_information_names_no_cause(tmp_path: Path, few_readings: Callable[[str], None]) -> None:
    few_readings("radians|degrees")
    rows = np.loadtxt(TABLES / "low.csv", delimiter=",", skiprows=1)
    rows[:, 1:] *= np.pi / 180  # radians under a header of degrees: a swing of 6 mrad
    np.savetxt(tmp_path / "low.csv", rows, "%.10g", ",", header="time_s,angle1_deg,angle2_deg", comments="")
    rig = load_rig(TABLES / "bench.toml")
    run = import_csv(tmp_path / "low.csv", rig, ImportOptions(unit="deg", angles="relative", zero="hanging"))
    diagnosis = diagnose([run], rig, library=candidates("coulomb", "spring"))
    assert (diagnosis.verdict, diagnosis.effects, diagnosis.checks) == ("unexplained", [], [])
    assert "the angles are in radians (import with --unit rad)" in diagnosis.sentence


def filmed(folder: Path) -> tuple[Rig, Run]:
    """A rod of 0.9 m filmed for three swings, read from a zero at -42 mrad by a bent scale: up to 3 mrad."""
    rng = np.random.default_rng([7, 88])
    rod, t = Rod(length=0.9, dry=0.0, damping=0.004, noise=0.54e-3, duration=5.0), np.arange(0.0, 5.0, 1 / 30)
    true = swing(rod, -0.544, t)
    bent = -0.010 * true**2 + 0.0187 * true**3
    read = true - 0.042 + bent + rng.normal(0.0, rod.noise, len(t))
    rows = np.column_stack([t, read])
    np.savetxt(folder / "film.csv", rows, "%.6f", ",", header="t_s,theta1_rad", comments="")
    rig = parse_rig(draft_rig(RigMeasures("film", 1.0, None, Measure(0.2), None, mounted="inner")))
    return rig, import_csv(folder / "film.csv", rig, ImportOptions(zero="hanging"))


@pytest.mark.long
def test_a_spring_that_needs_gravity_to_lift_the_rod_does_not_stand_for_a_zero_offset(tmp_path: Path) -> None:
    rig, run = filmed(tmp_path)
    diagnosis = diagnose([run], rig, library=candidates("coulomb", "spring", "encoder", "base_", "com_", "detent"))
    named = {effect.name: effect for effect in diagnosis.effects}
    assert "spring_joint1" not in named
    zero = named.keys() & {"encoder_offset_joint1", "base_tilt", "com_offset_link1"}
    assert zero
    assert named[zero.pop()].probability > 0.5
    assert gravity_torque(rig, diagnosis) > 0.0


@pytest.mark.long
def test_whole_turns_between_recordings_show_a_wrong_number_of_counts(tmp_path: Path) -> None:
    """An encoder with 4000 counts, of which the rig file says 4096; the rod was turned once between the releases."""
    rig, runs = recorded(Rod(scale=-0.0234, turns=(0, 1)), 5, tmp_path)
    library = candidates("coulomb", "spring", "encoder", "detent")
    result = {effect.name: effect for effect in diagnose(runs, rig, library=library).effects}
    scale = result["encoder_scale_joint1"]
    assert scale.probability > 0.9
    assert next(iter(scale.parameters.values())).value == pytest.approx(-0.0234, abs=2e-3)
