import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS, OF_FREE_SWINGS, effect_params
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.hypothesis.detectable import detectable
from dpr_lab.gap.hypothesis.hypothesis import free_parameters, hypothesis
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.report.gap.tables import per_reading
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.workflows.diagnose import failures
from sim_device.plant.config import load_plant
from tests.thinned import FULL, candidates, thinned

LIKELY = ("coulomb", "spring", "backlash", "encoder")
DRY = ("coulomb", "stribeck", "friction_curve", "hysteresis")
NOT_SEEN = ("rotor_inertia_joint1",)
"""The base parameter a takes it up exactly."""


@pytest.fixture(autouse=True)
def brief_evidence() -> None:
    """Compute all of the evidence and of the gap: both are a subject here."""


def scaled(diagnosis: Diagnosis, effect: str, parameter: str) -> float:
    """A torque at the plant's own scale: a free swing fixes none."""
    b = load_plant("paper", 1).parameters
    (result,) = [result for result in diagnosis.effects if effect in result.members]
    return result.parameters[parameter].value * (b["J2"] + b["m2"] * b["l2"] ** 2) / diagnosis.scale_b


@pytest.mark.slow
def test_both_of_two_effects_are_named_with_their_sizes(two_found: Diagnosis):
    assert (two_found.verdict, two_found.hints) == ("named", []), two_found.sentence
    assert {effect.name for effect in two_found.effects} == {"coulomb_joint1", "latency_joint2"}
    assert scaled(two_found, "coulomb_joint1", "torque_Nm") == pytest.approx(1.5e-3, rel=0.03)
    (latency,) = [effect for effect in two_found.effects if effect.name == "latency_joint2"]
    low, high = latency.parameters["delay_s"].interval90
    assert low < latency.parameters["delay_s"].value < high
    assert latency.parameters["delay_s"].value == pytest.approx(5e-4, rel=0.03)


@pytest.mark.slow
def test_the_gap_closes_in_cross_validation_across_releases(two_found: Diagnosis):
    closed = two_found.gap.closed_held_out
    assert closed.estimate > 0.9
    assert closed.interval90[0] <= closed.estimate <= closed.interval90[1]
    assert set(closed.per_run) == {run for run in two_found.gap.free_run_rad}
    for lengths in two_found.gap.by_horizon.values():
        assert lengths["after"] < 0.5 * lengths["before"]
    assert len(two_found.gap.waterfall) == 2
    assert two_found.gap.by_horizon["0.5"]["after"] == pytest.approx(two_found.gap.waterfall[-1]["gap_rad"])
    assert two_found.gap.by_horizon["0.5"]["before"] == pytest.approx(per_reading(two_found.gap, "before_rad"))


@pytest.mark.slow
def test_the_result_has_the_keys_of_the_interface(two_found: Diagnosis):
    document = json.loads(json.dumps(two_found.to_json()))
    assert {
        "verdict", "sentence", "gap", "where", "effects", "rivals", "probabilities", "detectable", "sensor_findings",
        "advice", "ratios", "seconds",
    } <= set(document)  # fmt: skip
    assert {"floor_rad", "before_rad", "after_rad", "explained_share", "closed_held_out"} <= set(document["gap"])
    assert {"name", "class", "probability", "parameters", "share"} <= set(document["effects"][0])
    # encoder 0 read the same angle throughout, and no reading is off by two counts or more
    assert set(document["detectable"]) == set(OF_FREE_SWINGS) - {"arm_compliance", "missed_counts"}


@pytest.mark.long
def test_same_runs_same_answer(two_found: Diagnosis, two_runs, paper: Rig):
    again = diagnose(two_runs, paper)
    when: Any = {"seconds": True, "evidence": {"made_utc"}}
    assert again.model_dump(exclude=when) == two_found.model_dump(exclude=when)


@pytest.mark.slow
@pytest.mark.parametrize(
    "dirt",
    thinned([{"jitter_ms": 0.2}, {"repeated_share": 0.003}, {"missing_share": 0.02}, {"noise_counts": 2.0}], 4),
    ids=lambda dirt: next(iter(dirt)),
)
def test_dirty_sensors_are_no_effect(recorded, paper: Rig, dirt: dict[str, float]):
    diagnosis = diagnose(recorded({}, seed=4, **dirt), paper)
    assert (diagnosis.verdict, diagnosis.effects, diagnosis.hints) == ("no_gap", [], [])
    assert failures(diagnosis, ["gap", "unexplained"]) == []
    assert diagnosis.probabilities["no_gap"] > 0.9
    assert diagnosis.sensor_findings


@pytest.mark.slow
def test_indistinguishable_effects_form_one_class_with_a_bench_check(recorded, paper: Rig):
    runs = recorded({"encoder_offset_joint1": {"offset_rad": 2e-3}}, duration=2.5)
    diagnosis = diagnose(runs, paper, library=candidates(*LIKELY, "base_"))
    (result,) = diagnosis.effects
    assert set(result.members) == {"encoder_offset_joint1", "base_tilt"}
    assert any("spirit level" in check.text for check in diagnosis.checks)
    assert len(diagnosis.advice) == 1


@pytest.mark.slow
def test_the_residual_map_shows_the_joint_and_its_speed(recorded, paper: Rig):
    diagnosis = diagnose(recorded({"coulomb_joint2": {"torque_Nm": 1e-3}}), paper, library=candidates(*LIKELY))
    assert (diagnosis.where[0].site, diagnosis.where[0].coordinate) == ("joint2", "speed")
    assert diagnosis.where[0].share > 0.6
    assert "braking most at low speed" in diagnosis.where_sentence


@pytest.mark.slow
def test_detectable_size_is_five_standard_deviations_of_its_own_fit(recorded, bare, tested):
    problem, base = bare(recorded({}, duration=2.0))
    least = detectable(base, tested(problem, base.fit, (EFFECTS["base_tilt"],)))["base_tilt"]["tilt_rad"]
    at = base.fit.estimate
    A, _ = fit(problem, at, free_parameters(at, ("base_tilt",), problem), iterations=0).linear.flat
    std = np.sqrt(np.linalg.inv(A.T @ A)[-1, -1] * base.inflation)
    assert least == pytest.approx(5 * std, rel=1e-3)


@pytest.mark.slow
def test_detectable_size_does_not_depend_on_the_order_of_the_fitted_parameters(recorded, bare, tested):
    problem, base = bare(recorded({}, duration=2.0))
    at, names = base.fit.estimate, ("base_tilt", "coulomb_joint2", "air_drag_both")
    forward, backward = (
        fit(problem, at, free_parameters(at, order, problem), iterations=0) for order in (names, names[::-1])
    )
    least = detectable(hypothesis(problem, names, backward), tested(problem, forward, ()))
    same = detectable(hypothesis(problem, names, forward), tested(problem, forward, ()))
    assert least == same


@pytest.mark.long
def test_detectable_size_is_five_standard_deviations_of_repeated_fits(recorded, bare, paper: Rig):
    result, sizes = None, []
    for seed in range(5, 13):
        runs = recorded({}, seed=seed, duration=3.0)
        if result is None:
            result = diagnose(runs, paper).detectable["base_tilt"]["tilt_rad"]
        problem, base = bare(runs)
        at = base.fit.estimate
        sizes.append(float(fit(problem, at, free_parameters(at, ("base_tilt",), problem)).values[-1]))
    assert result == pytest.approx(5 * np.sqrt(np.mean(np.square(sizes))), rel=0.7)


@pytest.mark.slow
def test_an_effect_that_is_visible_at_no_size_has_no_detectable_size(recorded, bare, tested):
    problem, base = bare(recorded({}, duration=3.0))
    after = {"counts": 3.0, "joint": 1.0, "run": 0.0, "time_s": 60.0}  # past the end of the recording
    at = base.fit.estimate.changed(params=effect_params({"missed_counts": after}))
    blind = hypothesis(
        problem, ("missed_counts",), fit(problem, at, free_parameters(at, ("missed_counts",), problem), iterations=0)
    )
    assert detectable(blind, tested(problem, blind.fit, ()))["missed_counts"] == {"counts": None}


SEEN = [name for name in OF_FREE_SWINGS if name not in (*NOT_SEEN, "missed_counts")]


@pytest.mark.long
@pytest.mark.parametrize("name", SEEN)
def test_every_effect_is_named_from_its_own_recording(recorded, paper: Rig, name: str):
    effect = EFFECTS[name]
    values = {p.name: (0.5 * p.typical if p.role == "amplitude" else p.default) for p in effect.parameters}
    long = FULL or name.startswith("friction_drift")  # grows with time, so 4 s contain a fourth of what 8 s do
    diagnosis = diagnose(recorded({name: values}, seed=7, duration=8.0 if long else 4.0), paper)
    classes = [set(result.members) for result in diagnosis.effects]
    family = {name, *effect.nested}
    assert classes, diagnosis.sentence
    assert classes[0] & family, (diagnosis.sentence, classes)


REAL = Path(__file__).parents[3] / "shared" / "data" / "real" / "multiarm" / "dp_freeswing_1khz.csv"


@pytest.mark.long
@pytest.mark.timeout(600)
@pytest.mark.skipif(not REAL.is_file(), reason="the real recording is not here")
def test_a_real_rig_is_predicted_three_and_a_half_times_better_than_by_viscous_friction() -> None:
    """The record is cut into parts of 10 s, of which every second one is held out."""
    rig, table = load_rig("multiarm"), np.loadtxt(REAL, delimiter=",", skiprows=1)
    theta = np.column_stack([np.zeros(len(table)), table[:, 1:3] + np.pi])
    diagnosis = diagnose(Run("swing", table[:, 0] - table[0, 0] + 0.05, theta, None, None, "multiarm", "", 1000.0), rig)
    held_out = [
        errors
        for name, errors in diagnosis.gap.free_run_rad.items()
        if "10-20" in name or "30-40" in name or "50-60" in name or "70-80" in name
    ]
    assert len(held_out) == 4, list(diagnosis.gap.free_run_rad)
    viscous, corrected = (np.median([errors[model] for errors in held_out]) for model in ("before", "after"))
    assert viscous / corrected > 3.5
    dry = {name for effect in diagnosis.effects for name in effect.members if name.startswith(DRY)}
    assert {name[-1] for name in dry} == {"1", "2"}, dry
    assert all(ratio.value >= 0 for ratio in diagnosis.ratios.values())
    assert diagnosis.verdict == "partly_explained"
