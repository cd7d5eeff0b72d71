"""Models sampled from a posterior: their distribution, their files, and the bands that they predict."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.dynamics.base import RATIOS, base_parameters
from dpr_lab.effects import effect_params
from dpr_lab.errors import RunError
from dpr_lab.exports.ensemble import bands
from dpr_lab.exports.ensemble.bands import BANDS, fewest_models, level_of, predictive_band, quantiles_of
from dpr_lab.exports.ensemble.calibrate import CALIBRATED, calibrated, pooled, widened
from dpr_lab.exports.ensemble.sampled import drawn_values, ensemble_posterior, sampled_models
from dpr_lab.exports.ensemble.scatter import scatter_of_ratios
from dpr_lab.exports.ensemble.starts import drawn_starts
from dpr_lab.fitting.estimate import Estimate, unknown_ratios
from dpr_lab.gap.result.posterior import PosteriorComponent
from dpr_lab.identification import compare
from dpr_lab.identification.model import Model
from dpr_lab.identification.preprocess import PreprocessedRun, preprocess
from dpr_lab.identification.scaling.scale import Scale
from dpr_lab.report.plain import write_json
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.workflows.export_ensemble import export_ensemble
from sim_device.plant.config import load_plant
from sim_device.trials.driven import DriveFault, done_by_drives, driven_runs
from sim_device.trials.offline_recorder import record
from sim_device.trials.parameters import weighed
from tests.a_diagnosis import made
from tests.exports.models import base_of
from tests.exports.test_export_command import whole_model

FREE = ["a/b", "d/b", "coulomb_joint2.torque_Nm"]
STD = np.array([0.01, 0.005, 5e-4])
CORRELATION = np.array([[1.0, 0.8, 0.0], [0.8, 1.0, 0.0], [0.0, 0.0, 1.0]])


@pytest.fixture
def model(paper: Rig) -> Model:
    estimate = Estimate.of(unknown_ratios(base_of(paper)), effect_params({}), np.zeros((1, 4)))
    result = whole_model(paper, estimate)
    return result.model_copy(update={"effects": {"coulomb_joint2": {"torque_Nm": 1e-3}}})


def component(model: Model, probability: float = 1.0, **effects: dict[str, float]) -> PosteriorComponent:
    return PosteriorComponent(
        probability=probability,
        ratios={name: estimate.value for name, estimate in model.ratios.items()},
        effects=effects or model.effects,
        free=FREE if not effects else FREE[:2],
        covariance=((STD[:, None] * CORRELATION * STD) if not effects else np.zeros((2, 2))).tolist(),
    )


def values(models: list[Model]) -> np.ndarray:
    rows = ((m.ratios["a/b"].value, m.ratios["d/b"].value, m.effects["coulomb_joint2"]["torque_Nm"]) for m in models)
    return np.array(list(rows))


@pytest.mark.slow
def test_samples_have_the_covariance_of_the_posterior_and_frictions_are_not_negative(model: Model) -> None:
    drawn = values(sampled_models(model, [component(model)], 1500, 1))
    assert (drawn[:, 2] > 0).all()
    assert drawn[:, 2].mean() == pytest.approx(1e-3 + 0.055 * STD[2], abs=0.05 * STD[2])  # truncated at -2 std
    assert drawn[:, :2].std(axis=0) == pytest.approx(STD[:2], rel=0.05)
    assert np.corrcoef(drawn[:, :2].T)[0, 1] == pytest.approx(0.8, abs=0.03)
    once, again = (values(sampled_models(model, [component(model)], 20, 1)) for _ in range(2))
    assert np.array_equal(once, again)
    wide = values(sampled_models(model, widened([component(model)], 2.0), 1500, 1))
    assert wide[:, 0].std() == pytest.approx(2 * STD[0], rel=0.05)


@pytest.mark.slow
def test_values_of_another_recording_scatter_between_recordings_too(model: Model) -> None:
    own = component(model)
    other = own.model_copy(update={"between": (3 * np.array(own.covariance)).tolist()})
    assert values(sampled_models(model, [other], 1500, 1))[:, 0].std() == pytest.approx(2 * STD[0], rel=0.05)
    wide = widened([other], 2.0)
    assert values(sampled_models(model, wide, 1500, 1))[:, 0].std() == pytest.approx(4 * STD[0], rel=0.05)


@pytest.mark.slow
def test_ratios_of_an_identification_scatter_if_its_recordings_differ(model: Model) -> None:
    """Recordings of one plant do not; if one of them is of a rig with more friction, the ensemble is wider."""
    plant, rig = weighed(load_plant("paper", 6), load_rig("paper"))
    truth = unknown_ratios(base_parameters(plant.Z, rig.L1, rig.g))
    identified = whole_model(rig, Estimate.of(truth, effect_params({}), np.zeros((1, 4))))
    identified = identified.model_copy(update={"effects": {}})
    oiled = plant.model_copy(update={"parameters": plant.parameters | {"c1": 1.5 * plant.parameters["c1"]}})
    same, other = (list(record(each, rig, duration=2.0)) for each in (plant, oiled))
    alike = scatter_of_ratios(identified, same, rig)
    assert alike.names == RATIOS
    assert not alike.between.any()
    assert alike.left_out == pytest.approx(np.repeat([identified.ratio_values], 3, axis=0), rel=0.02)
    scatter = scatter_of_ratios(identified, [*same[:2], other[2]], rig)
    assert scatter.between[3, 3] ** 0.5 > 0.05 * identified.ratios["c1/b"].value
    (wider,) = ensemble_posterior(identified, None, scatter)
    (own,) = ensemble_posterior(identified, None)
    assert wider.left_out[2][3] < 0.95 * wider.left_out[0][3]  # without the recording with more friction
    assert np.array(wider.between)[3, 3] == scatter.between[3, 3]
    assert wider.predictive[3, 3] == pytest.approx(own.predictive[3, 3] + scatter.between[3, 3])


@pytest.mark.slow
def test_models_of_the_inner_rod_alone_contain_its_base_parameters(model: Model, paper: Rig, tmp_path: Path) -> None:
    alone = {
        "fitted": list(model.ratios.values()),
        "p_over_b": paper.parameters["m2"].nominal * paper.L1**2 / model.base["b"].value,
    }
    write_json(json.loads(model.model_copy(update=alone | {"effects": {}}).model_dump_json()), tmp_path / "model.json")
    export_ensemble(tmp_path / "model.json", "paper", 2, 0, [], tmp_path)
    for member in json.loads((tmp_path / "ensemble.json").read_text(encoding="utf-8"))["models"]:
        (rod,), base = member["rods"], member["base"]
        assert set(base) == {"a", "e1", "c1"}
        assert rod["inertia_kgm2"] + rod["mass_kg"] * rod["centroid_m"] ** 2 == pytest.approx(base["a"])
        assert rod["mass_kg"] * rod["centroid_m"] * paper.g == pytest.approx(base["e1"])


def test_causes_are_drawn_by_their_probability(model: Model) -> None:
    two = [component(model, 0.7), component(model, 0.3, viscous_ground_link2={"friction_Nms": 1e-4})]
    sets = [tuple(member.effects) for member in sampled_models(model, two, 1000, 2)]
    assert sets.count(("viscous_ground_link2",)) / 1000 == pytest.approx(0.3, abs=0.04)


def test_the_scale_moves_inertias_and_torques_together(model: Model) -> None:
    unsure = model.model_copy(
        update={
            "scale": Scale(
                b=model.base["b"].value,
                interval90=(0.5 * model.base["b"].value, 2.0 * model.base["b"].value),
                fixed_by="bound",
            )
        }
    )
    certain = component(model).model_copy(update={"covariance": np.zeros((3, 3)).tolist()})
    members = sampled_models(unsure, [certain], 200, 3)
    scales = np.array([member.base["b"].value / model.base["b"].value for member in members])
    torques = np.array([member.effects["coulomb_joint2"]["torque_Nm"] / 1e-3 for member in members])
    assert torques == pytest.approx(scales)
    assert {member.ratios["a/b"].value for member in members} == {model.ratios["a/b"].value}
    assert np.mean((scales > 0.5) & (scales < 2.0)) == pytest.approx(0.9, abs=0.06)


def test_a_scale_that_the_recordings_determine_is_drawn_with_the_ratios(model: Model) -> None:
    """Known torques determine b, a friction and a/b together: no draw moves b alone, or the friction twice."""
    b, std = model.base["b"].value, np.array([0.02, 2e-5, 1e-5])
    together = component(model).model_copy(
        update={
            "ratios": component(model).ratios | {"b": b},
            "free": ["a/b", "b", FREE[2]],
            "covariance": (np.outer(std, std) * (1 - 1e-9) + np.diag(1e-9 * std**2)).tolist(),
        }
    )
    unsure = Scale(b=b, interval90=(0.5 * b, 2.0 * b), fixed_by="data")
    members = sampled_models(model.model_copy(update={"scale": unsure}), [together], 50, 3)
    steps = np.array([(member.base["b"].value - b) / std[1] for member in members])
    ratios, _, frictions = values(members).T
    assert steps.std() == pytest.approx(1.0, abs=0.3)
    assert (ratios - model.ratios["a/b"].value) / std[0] == pytest.approx(steps, abs=1e-3)
    assert (frictions - 1e-3) / std[2] == pytest.approx(steps, abs=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("count", [18, 19, *(pytest.param(count, marks=pytest.mark.long) for count in (5, 50))])
def test_the_band_of_few_models_has_its_nominal_coverage(count: int) -> None:
    rng = np.random.default_rng(count)
    low, high = quantiles_of(rng.standard_normal((count, 8_000, 1)))
    readings = rng.standard_normal((8_000, 1))
    assert ((readings >= low) & (readings <= high)).mean() == pytest.approx(level_of(count), abs=0.01)
    assert (level_of(count) < BANDS.level) == (count < fewest_models())


def test_frictions_of_zero_keep_their_correlation(model: Model) -> None:
    """Two frictions whose sum is determined: no draw has a larger sum because one of them cannot be negative."""
    frictions = ("coulomb_joint1.torque_Nm", "coulomb_joint2.torque_Nm")
    both = {name.split(".")[0]: {"torque_Nm": 2e-4} for name in frictions}
    spread = np.array([[1.0, -0.999], [-0.999, 1.0]]) * 1e-6
    unsure = component(model, **both).model_copy(update={"free": list(frictions), "covariance": spread.tolist()})  # pyright: ignore[reportArgumentType]
    rng = np.random.default_rng(0)
    drawn = [drawn_values(unsure, rng) for _ in range(200)]
    sums = np.array([sum(values[name] for name in frictions) for values in drawn])
    assert min(values[name] for values in drawn for name in frictions) >= 0.0
    assert sums.mean() == pytest.approx(4e-4, abs=1e-5)
    assert sums.std() < 6e-5


def test_a_posterior_without_physical_draws_is_refused(model: Model) -> None:
    impossible = component(model)
    impossible = impossible.model_copy(update={"ratios": {**impossible.ratios, "a/b": -1.0}})
    with pytest.raises(RunError, match="almost no sample"):
        sampled_models(model, [impossible], 1, 0)


def test_a_diagnosis_without_a_posterior_is_refused(model: Model) -> None:
    with pytest.raises(RunError, match="diagnose the recordings again"):
        ensemble_posterior(model, made())
    (own,) = ensemble_posterior(model, None)
    assert own.free == list(RATIOS)


def released(seconds: float, hand_s: float) -> tuple[Run, Rig, Model]:
    """A release whose rods a hand still moves for some time, with its rig and its true model."""
    plant, rig = weighed(load_plant("paper", 5), load_rig("paper"))
    run = record(plant, rig, duration=seconds)[0]
    step = float(np.median(np.diff(run.t)))
    hand = np.cumsum(np.where((run.t >= 0) & (run.t < hand_s), 1.0 - np.cos(4 * np.pi * run.t), 0.0)) * step
    truth = unknown_ratios(base_parameters(plant.Z, rig.L1, rig.g))
    model = whole_model(rig, Estimate.of(truth, effect_params({}), np.zeros((1, 4))))
    held = replace(run, theta=run.theta - 3.0 * (hand - hand[-1])[:, None] * np.array([0.0, 1.0, 1.0]), counts=None)
    return held, rig, model.model_copy(update={"effects": {}})


def test_a_recording_that_a_hand_shakes_all_the_time_is_refused() -> None:
    run, rig, model = released(1.0, 0.0)
    shaken = run.theta + np.where(run.t > 0, 1.0 - np.cos(20 * run.t), 0.0)[:, None] * np.array([0.0, 1.0, 1.0])
    with pytest.raises(RunError, match=r"first 1 s, so no band.*hand"):
        predictive_band(model, [model], replace(run, theta=shaken, counts=None), rig, 0)


@pytest.mark.slow
def test_a_band_starts_when_the_hand_has_let_go() -> None:
    """A wide band from the readings of a held rod covers everything."""
    run, rig, model = released(2.5, 0.5)
    held = predictive_band(model, [model] * 19, run, rig, 0)
    free = predictive_band(model, [model] * 19, released(2.5, 0.0)[0], rig, 0)
    assert (held.delay_s, free.delay_s) == pytest.approx((0.5, 0.0), abs=0.01)
    assert held.t[0] == pytest.approx(free.t[0] + 0.5, abs=0.02)
    assert held.width_rad < 3.0 * free.width_rad
    assert held.covered > 0.6


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_bands_cover_the_readings_of_the_true_model_and_a_wrong_one_is_widened(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    prepared: list[Run] = []

    def counted(run: Run, rig: Rig) -> PreprocessedRun:
        prepared.append(run)
        return preprocess(run, rig)

    for module in (bands, compare):
        monkeypatch.setattr(module, "preprocess", counted)
    plant, rig = weighed(load_plant("paper", 5), load_rig("paper"))
    runs = record(plant, rig, 1.5, 250)[:2]
    base = base_parameters(plant.Z, rig.L1, rig.g)
    truth = whole_model(rig, Estimate.of(unknown_ratios(base), effect_params({}), np.zeros((1, 4))))
    truth = truth.model_copy(update={"effects": {}})
    exact = component(truth).model_copy(update={"free": FREE[:1], "covariance": [[1e-16]], "effects": {}})
    members = sampled_models(truth, [exact], 50, 0)
    covered = pooled([predictive_band(truth, members, run, rig, 0) for run in runs])
    assert len(prepared) == 2 * len(runs)  # however many models follow it
    assert 0.86 < covered < 0.94  # a band without one of its ends covers 0.95
    off = {**exact.ratios, "a/b": 1.002 * exact.ratios["a/b"]}
    wrong = exact.model_copy(update={"ratios": off, "covariance": [[(5e-4 * off["a/b"]) ** 2]]})

    def drawn(factor: float, count: int) -> list[Model]:
        return sampled_models(truth, widened([wrong], factor), count, 0)

    factor = calibrated(drawn, lambda members, run: predictive_band(truth, members, run, rig, 0), runs)
    assert factor > 1.0
    assert pooled([predictive_band(truth, drawn(factor, CALIBRATED.members), run, rig, 0) for run in runs]) > 0.85


@pytest.mark.slow
@pytest.mark.parametrize("fault", [None, DriveFault("torque_offset_joint1", {"offset_Nm": (8e-3, 0.0)})])
def test_the_band_of_a_driven_recording_has_all_torques_and_their_noise(fault: DriveFault | None) -> None:
    rig = load_rig("paper")
    plant, runs = driven_runs(rig, 3, fault=fault, duration=2.0)
    base = base_parameters(plant.Z, rig.L1, rig.g)
    truth = whole_model(rig, Estimate.of(unknown_ratios(base), effect_params({}), np.zeros((1, 4))))
    truth = truth.model_copy(update={"effects": done_by_drives(plant.drives)})
    band = predictive_band(truth, [truth] * 13, runs[1], rig, 0)
    assert band.covered > 0.8
    assert band.width_rad < 0.2


@pytest.mark.slow
def test_rods_in_stiction_start_at_no_speed_that_their_readings_exclude(model: Model) -> None:
    """Friction stops them at once, so no derivative shows that a speed is wrong, and the misfit is large."""
    plant, rig = weighed(load_plant("paper", 5), load_rig("paper"))
    run = preprocess(record(plant, rig, duration=0.5)[0], rig)
    sticky = model.model_copy(update={"effects": {f"coulomb_joint{j}": {"torque_Nm": 2.0} for j in (1, 2)}})
    fitted = compare.follow_preprocessed(run, rig, sticky).fitted
    rng = np.random.default_rng(0)
    starts = np.concatenate([drawn_starts(fitted.problem, fitted.fit, rng).initial for _ in range(20)])
    assert np.abs(starts[:, 2:]).max() < 10.0
