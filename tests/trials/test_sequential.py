"""Sequential trials: releases that are asked for one by one, strategies, and their summary."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import ConfigError, DprError
from dpr_lab.rig import load_rig, parse_rig
from dpr_lab.trials.campaign import Campaign, run_campaign
from dpr_lab.trials.next_release import CHOOSERS, SEQUENTIAL, Situation, limits_of
from dpr_lab.trials.sealing import Kind, PlantRequest, sealed_in_memory
from dpr_lab.trials.sequential_summary import read_strategies, sequential_summary
from sim_device.options import Options
from sim_device.trials.trial import drawn_trial, recorded_next


@pytest.mark.slow
def test_a_held_plant_records_what_is_asked_for_and_then_opens() -> None:
    path = load_rig("paper").path
    assert path is not None
    wanted = {"theta1": 2.0, "theta2": 1.0, "duration_s": 0.5}
    with sealed_in_memory(PlantRequest(Kind.CLEAN, seed=3), path.read_text(), direct=False) as plant:
        assert "runs" not in plant.public
        rig = parse_rig(plant.public["rig"])
        first, again = (plant.record(wanted) for _ in range(2))
        for recording in (first, again):
            counts = np.array(recording["counts"])
            theta = rig.theta(counts)[np.argmin(np.abs(recording["t"]))]
            assert theta[1:] == pytest.approx([2.0, 1.0], abs=0.1)
        assert first["counts"] != again["counts"]
        assert plant.opened()["truth"]["effects"] == {}
    with (
        sealed_in_memory(PlantRequest(Kind.CLEAN, seed=3), path.read_text(), direct=False) as plant,
        pytest.raises(DprError, match="no such release"),
    ):
        plant.record({**wanted, "rods": {"mounted": "none"}})


def test_the_menu_goes_through_the_poses_of_the_rig_file_first() -> None:
    rig = load_rig("paper")
    release, plan = CHOOSERS["menu"](Situation(rig, [], None, np.random.default_rng(0), limits_of(rig)))
    assert plan is None
    assert (release.theta1, release.theta2) == (rig.poses["X1"].theta1, rig.poses["X1"].theta2)


@pytest.mark.parametrize(("mode", "state"), [("clamped", "held"), ("free", "free"), ("driven", "driven")])
def test_every_release_has_the_mode_of_the_arm(mode: str, state: str) -> None:
    rig = load_rig("furuta")
    rig = rig.model_copy(update={"arm": rig.arm.model_copy(update={"mode": mode})})
    now = Situation(rig, [], None, np.random.default_rng(0), limits_of(rig, 2.0))
    assert now.limits.arm.modes == (state,)
    for name in ("menu", "random"):
        release, _ = CHOOSERS[name](now)
        assert (release.arm, release.mounting, release.torques) == (state, "inner", None)


def test_a_driven_plant_replays_the_input_of_a_plan() -> None:
    rig = load_rig("furuta")
    trial = drawn_trial(Options(plant="furuta", seed=4, draw_effects="clean", arm="driven"), rig)
    largest = trial.report(direct=False)["largest_input"]
    t, values = np.arange(100) / 200.0, largest * np.sin(np.arange(100))
    wanted = {"theta1": np.pi, "theta2": np.pi, "duration_s": 0.5}
    recording = recorded_next(trial, wanted | {"input": {"t": t.tolist(), "values": values.tolist()}}, 0)
    swing = np.array(recording["t"]) >= 0.0
    reported = np.array(recording["arm_input"])[swing]
    row = np.searchsorted(t, np.array(recording["t"])[swing] + 1e-9, side="right") - 1
    assert reported[:-1] == pytest.approx(values[row][:-1], abs=1e-3)
    still = drawn_trial(Options(seed=4, draw_effects="clean"), load_rig("paper"))
    with pytest.raises(ConfigError, match="has no drive"):
        recorded_next(still, {"theta1": 2.0, "theta2": 1.0, "duration_s": 0.5, "input": {"t": [], "values": []}}, 0)


def test_a_summary_counts_undecided_plants_and_forecasts() -> None:
    looks = [
        {"stated": None, "decided": False, "plan_seconds": 1.0},
        {"stated": 0.9, "decided": True, "plan_seconds": 2.0},
    ]
    decided = {"recordings": 2, "right": True, "looks": looks}
    undecided = {"recordings": None, "right": False, "looks": [{"stated": 0.9, "decided": False, "plan_seconds": 3.0}]}
    (one,) = sequential_summary([{"plan": decided}, {"plan": undecided}]).values()
    assert one["mean_releases"] == (2 + SEQUENTIAL.most + 1) / 2
    assert (one["decided"], one["right_when_stopped"], one["forecasts"]) == (0.5, 1.0, 2)
    assert one["forecast_calibration_error"] == pytest.approx(0.4)
    assert one["plan_seconds"] == 2.0


@pytest.mark.long
def test_a_plant_is_played_by_every_strategy(tmp_path: Path) -> None:
    campaign = Campaign((Kind.SINGLE,), seed=1, strategies=tuple(CHOOSERS))
    (outcome,) = run_campaign(campaign, 1, tmp_path).outcomes
    (strategies,) = read_strategies(tmp_path)
    assert list(strategies) == ["plan", "menu", "random"]
    assert strategies["plan"]["score"]["named"] == list(outcome.named)
    looks = strategies["plan"]["looks"]
    assert strategies["plan"]["recordings"] == len(looks)
    assert looks[-1]["decided"] or looks[-1]["bench_check"]
    assert not any(look["decided"] or look["bench_check"] for look in looks[:-1])
