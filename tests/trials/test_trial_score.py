"""Scores of constructed diagnoses of known plants."""

import hashlib
import json
import math
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.cli.listener import named_by
from dpr_lab.dynamics.base import base_parameters
from dpr_lab.errors import DprError
from dpr_lab.rig import PARAMETERS, load_rig
from dpr_lab.trials.score import Cause, Claim, TrialOutcome, over_limit, read_outcome, score
from dpr_lab.trials.summary import brier, calibration_error, confusion, reliability, summary
from dpr_lab.trials.truth import Truth, assumed_inertia, read_truth, unsealed

CLEAN_ENCODERS = {"step_counts": 1, "jitter_ms": 0.0, "repeated_share": 0.0, "missing_share": 0.0}
RIG = load_rig("paper")
SCALE_B = float(base_parameters(RIG.nominal, 0.4, 9.81)[1])


def truth_of(effects=None, foreign=None, family=(), encoders=CLEAN_ENCODERS, heavier=1.0) -> Truth:
    Z = RIG.nominal * np.array([1, 1, *[heavier] * 7])
    result = {
        "effects": effects or {},
        "foreign": {foreign: {}} if foreign else {},
        "family": {foreign: list(family)} if foreign else {},
        "held_back": [],
        "parameters": dict(zip(PARAMETERS, Z.tolist(), strict=True)),
        "encoders": encoders,
    }
    return read_truth(result)


def named(name: str, probability: float = 0.9, twins=(), **values: float) -> dict:
    parameters = {key: {"value": value, "interval90": [0.98 * value, 1.02 * value]} for key, value in values.items()}
    return {"name": name, "class": [name, *twins], "probability": probability, "parameters": parameters}


def diagnosis_of(verdict: str, *effects: dict, rivals=(), findings=()) -> dict:
    return {
        "verdict": verdict,
        "effects": list(effects),
        "rivals": list(rivals),
        "gap": {"explained_share": 0.99, "closed_held_out": {"estimate": 0.95}},
        "probabilities": {"no_gap": 0.97, "unexplained": 0.6},
        "sensor_findings": [{"name": finding} for finding in findings],
        "detectable": {"coulomb_joint1": {"torque_Nm": 0.0004}},
        "scale_b": SCALE_B,
    }


def scored(diagnosis: dict, truth: Truth) -> TrialOutcome:
    return score(diagnosis, truth, RIG, kind="single", level="clear", seed=1, seconds=2.0)


COULOMB = truth_of({"coulomb_joint1": {"torque_Nm": 0.002}})


def test_the_right_name_is_right():
    outcome = scored(diagnosis_of("named", named("coulomb_joint1", torque_Nm=0.002)), COULOMB)
    assert outcome.first
    assert outcome.top3
    assert outcome.exact
    assert not outcome.invented
    assert not outcome.wrong_name
    assert outcome.claims == (Claim(0.9, True),)


def test_a_twin_in_the_class_is_right_but_its_size_is_not_compared():
    truth = truth_of({"base_tilt": {"tilt_rad": 0.004}})
    outcome = scored(
        diagnosis_of("named", named("encoder_offset_joint1", twins=["base_tilt"], offset_rad=-0.004)), truth
    )
    assert outcome.exact
    assert outcome.sizes == ()


def test_a_wrong_name_is_wrong_even_with_the_truth_among_its_rivals():
    outcome = scored(diagnosis_of("named", named("spring_joint1", 0.7), rivals=[named("coulomb_joint1", 0.2)]), COULOMB)
    assert not outcome.first
    assert outcome.top3
    assert outcome.wrong_name
    assert outcome.invented


def test_a_candidate_listed_under_unexplained_does_not_count_as_named():
    outcome = scored(diagnosis_of("unexplained", named("spring_joint1", 0.7)), truth_of(foreign="cable_snag"))
    assert outcome.named == ()
    assert not outcome.wrong_name
    assert outcome.admitted
    assert outcome.claims == (Claim(0.6, True),)


def test_an_inconclusive_diagnosis_is_scored_by_its_candidates_and_claims_nothing_without_them():
    candidates = scored(diagnosis_of("inconclusive", named("coulomb_joint1", 0.4)), COULOMB)
    assert candidates.claims == (Claim(0.4, True),)
    assert candidates.grade == "right"
    outside = scored(diagnosis_of("inconclusive", named("coulomb_joint1", 0.4)), truth_of(foreign="bearing"))
    assert outside.admitted
    unseen = scored(diagnosis_of("inconclusive"), COULOMB)
    assert unseen.claims == ()
    assert unseen.grade == "not named"


def test_a_foreign_form_is_scored_by_its_family():
    truth = truth_of(foreign="power_drag_outer", family=["air_drag_outer", "air_drag_both"])
    outcome = scored(diagnosis_of("partly_explained", named("air_drag_both"), named("spring_joint2", 0.4)), truth)
    assert outcome.first
    assert outcome.invented
    assert not outcome.exact
    assert outcome.admitted


def test_two_names_for_one_cause_are_scored_as_wrong():
    outcome = scored(diagnosis_of("named", named("coulomb_joint1"), named("coulomb_joint1")), COULOMB)
    assert outcome.first
    assert not outcome.exact


def test_a_step_found_by_the_sensor_screen_is_a_name():
    step = truth_of({"missed_counts": {"counts": 9.0, "joint": 1.0, "run": 0.0, "time_s": 4.0}})
    assert scored(diagnosis_of("no_gap", findings=["missed_counts"]), step).exact
    assert not scored(diagnosis_of("no_gap", findings=["missed_counts"]), truth_of()).silent
    assert scored(diagnosis_of("no_gap"), truth_of()).silent


def test_faults_of_the_encoders_are_to_be_named():
    truth = truth_of(encoders={**CLEAN_ENCODERS, "jitter_ms": 0.2, "missing_share": 0.015})
    assert scored(diagnosis_of("no_gap", findings=["gap"]), truth).faults_missed == ("jitter",)


@pytest.mark.parametrize(
    ("fault", "missed"),
    [
        ({"late_every": 0, "stale_every": 0, "lost_for_s": 0.0}, ()),
        ({"late_every": 9}, ("periodic_delay",)),
        ({"stale_every": 8}, ("repeated_sample",)),
        ({"repeated_share": 0.04}, ("repeated_sample",)),
        ({"lost_for_s": 0.3}, ("gap",)),
        ({"step_counts": 4}, ("undithered_quantisation",)),
    ],
)
def test_each_fault_of_the_encoders_has_its_own_finding(fault, missed):
    outcome = scored(diagnosis_of("no_gap"), truth_of(encoders=CLEAN_ENCODERS | fault))
    assert outcome.faults_missed == missed


def test_sizes_are_compared_at_the_scale_that_the_recordings_determine():
    """Everything twice as heavy swings the same; the lab gives half the true torque, at its own scale."""
    heavy = truth_of({"coulomb_joint1": {"torque_Nm": 0.004}}, heavier=2.0)
    (size,) = scored(diagnosis_of("named", named("coulomb_joint1", torque_Nm=0.00201)), heavy).sizes
    assert size.relative == pytest.approx(0.005)
    assert size.covered
    angle = truth_of({"base_tilt": {"tilt_rad": 0.004}}, heavier=2.0)
    (size,) = scored(diagnosis_of("named", named("base_tilt", tilt_rad=0.005)), angle).sizes
    assert size.relative == pytest.approx(0.25)
    assert not size.covered


def test_all_members_of_a_named_class_are_listed():
    outcome = scored(
        diagnosis_of("named", named("coulomb_joint1", twins=["stribeck_joint1"], torque_Nm=0.002)), COULOMB
    )
    assert "[coulomb_joint1] or " in named_by(outcome)
    assert "[stribeck_joint1] (named)" in named_by(read_outcome(json.loads(json.dumps(outcome.to_json()))))


def test_an_outcome_can_be_kept():
    outcome = scored(diagnosis_of("named", named("coulomb_joint1", torque_Nm=0.002)), COULOMB)
    assert read_outcome(json.loads(json.dumps(outcome.to_json()))) == outcome
    lost = scored(diagnosis_of("no_gap") | {"gap": {}}, COULOMB)
    assert math.isnan(read_outcome(json.loads(json.dumps(lost.to_json(), allow_nan=False))).closed)


def test_a_broken_seal_does_not_count():
    result = {"effects": {}, "foreign": {}, "family": {}, "held_back": [], "parameters": {}, "encoders": {}}
    text = "salt" + json.dumps(result, sort_keys=True, separators=(",", ":"))
    seal = hashlib.sha256(text.encode()).hexdigest()
    assert unsealed({"salt": "salt", "truth": result}, seal).clean
    with pytest.raises(DprError, match="does not match the seal"):
        unsealed({"salt": "salt", "truth": result | {"effects": {"base_tilt": {}}}}, seal)


def test_the_size_of_a_cause_is_relative_to_the_minimum_detectable_size():
    (cause,) = scored(diagnosis_of("named", named("coulomb_joint1")), COULOMB).causes
    assert cause == Cause("coulomb_joint1", pytest.approx(5.0), True)
    assert over_limit({"a": -3.0, "b": 1.0}, {"a": 1.0, "b": 0.2, "c": 1e-9}) == pytest.approx(5.0)
    assert over_limit({"a": 1.0}, {"a": None}) is None
    (foreign,) = scored(diagnosis_of("unexplained"), truth_of(foreign="cable_snag")).causes
    assert foreign == Cause("cable_snag", None, False)


@pytest.mark.parametrize(
    ("diagnosis", "truth", "kind", "grade"),
    [
        (diagnosis_of("named", named("coulomb_joint1")), COULOMB, "single", "right"),
        (
            diagnosis_of("partly_explained", named("coulomb_joint1"), named("base_tilt", 0.3)),
            COULOMB,
            "single",
            "right in part",
        ),
        (diagnosis_of("named", named("coulomb_joint1"), named("base_tilt", 0.9)), COULOMB, "single", "wrong"),
        (diagnosis_of("unexplained"), COULOMB, "single", "not named"),
        (diagnosis_of("named", named("base_tilt")), COULOMB, "single", "wrong"),
        (diagnosis_of("no_gap"), truth_of(), "clean", "right"),
        (diagnosis_of("named", named("base_tilt")), truth_of(), "clean", "wrong"),
        (diagnosis_of("unexplained"), truth_of(foreign="cable_snag"), "outside", "right"),
        (diagnosis_of("partly_explained", named("base_tilt", 0.9)), truth_of(foreign="cable_snag"), "outside", "wrong"),
    ],
)
def test_each_trial_gets_a_word_for_its_score(diagnosis, truth, kind, grade):
    assert score(diagnosis, truth, RIG, kind=kind, level="clear", seed=1, seconds=2.0).grade == grade


def test_calibration_distinguishes_honest_from_overconfident_probabilities():
    chance = np.random.default_rng(1)
    stated = chance.uniform(0, 1, 20_000)
    honest = [Claim(p, bool(u < p)) for p, u in zip(stated, chance.uniform(0, 1, 20_000), strict=True)]
    assert calibration_error(honest) < 0.02
    assert brier(honest) == pytest.approx(1 / 6, abs=0.01)
    assert sum(row["claims"] for row in reliability(honest)) == 20_000
    boastful = [Claim(0.95, bool(u < 0.6)) for u in chance.uniform(0, 1, 5000)]
    assert calibration_error(boastful) == pytest.approx(0.35, abs=0.03)


def test_the_net_calibration_error_contains_no_chance_although_the_claims_of_a_group_agree(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    from _net_calibration import net_calibration_error

    chance, bias, squares = np.random.default_rng(2), 0.2, []
    for _ in range(200):
        drawn = [(chance.uniform(0.2, 0.9), chance.uniform()) for _ in range(60)]
        groups = [[Claim(p, bool(u < p - bias))] * 4 for p, u in drawn]
        alone = [[claim] for group in groups for claim in group]
        squares.append([net_calibration_error(claims) ** 2 for claims in (groups, alone)])
    grouped, ungrouped = np.mean(squares, axis=0)
    assert grouped == pytest.approx(bias**2, abs=0.004)
    assert ungrouped > bias**2 + 0.008
    assert net_calibration_error([groups[0]]) == 0.0
    assert np.isnan(net_calibration_error([[]]))


def test_a_summary_counts_hidden_and_absent_effects():
    outcomes = [
        scored(diagnosis_of("named", named("coulomb_joint1", torque_Nm=0.002)), COULOMB),
        scored(diagnosis_of("named", named("spring_joint1")), COULOMB),
        scored(diagnosis_of("no_gap"), truth_of()),
        scored(diagnosis_of("unexplained"), truth_of()),
    ]
    counted = summary(outcomes)
    assert counted["first"] == counted["exact"] == counted["false_alarms"] == 0.5
    assert counted["size_error"] == pytest.approx(0.0)
    assert counted["of"]["first"] == counted["of"]["false_alarms"] == 2
    low, high = counted["interval90"]["first"]
    assert low < 0.5 < high
    assert [row["grade"] for row in counted["astray"]] == ["wrong", "wrong"]
    (row,) = counted["by_effect"]
    assert (row["effect"], row["trials"], row["named"], row["first"]) == ("coulomb_joint1", 2, 0.5, 0.5)
    (row,) = counted["by_size"]
    assert (row["from"], row["to"], row["effects"], row["named"]) == (3.0, 10.0, 2, 0.5)
    assert confusion(outcomes) == {
        "coulomb_joint1": {"coulomb_joint1": 1, "spring_joint1": 1},
        "nothing": {"no_gap": 1, "unexplained": 1},
    }


def test_sizes_of_one_rod_are_related_to_its_own_inertia() -> None:
    five = [{"value": value} for value in (5.2, 1.5, 90.0, 0.2, 0.03)]
    diagnosis = {"scale_b": 0.01, "ratios": {"e1/a": {"value": 24.0}, "c1/a": {"value": 0.1}}, "p_over_b": 3.0}
    own = assumed_inertia(diagnosis | {"fitted": five}, load_rig("furuta"))
    assert own == pytest.approx(0.01 * (5.2 - 3.0))
