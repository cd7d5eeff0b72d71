"""Sequential trials: releases requested one by one, strategies, and their summary."""

import json
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import ConfigError, DprError
from dpr_lab.rig import Rig, load_rig, parse_rig
from dpr_lab.trials.campaign import TRIALS, Campaign, run_campaign
from dpr_lab.trials.next_release import SEQUENTIAL, STRATEGIES, Situation, limits_of
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
    release, plan = STRATEGIES["menu"].choose(Situation(rig, [], None, np.random.default_rng(0), limits_of(rig)))
    assert plan is None
    assert (release.theta1, release.theta2) == (rig.poses["X1"].theta1, rig.poses["X1"].theta2)


@pytest.mark.parametrize(("mode", "state"), [("clamped", "held"), ("free", "free"), ("driven", "driven")])
def test_every_release_has_the_mode_of_the_arm(mode: str, state: str) -> None:
    rig = load_rig("furuta")
    rig = rig.model_copy(update={"arm": rig.arm.model_copy(update={"mode": mode})})
    now = Situation(rig, [], None, np.random.default_rng(0), limits_of(rig, 2.0))
    assert now.limits.arm.modes == (state,)
    for name in ("menu", "random"):
        release, _ = STRATEGIES[name].choose(now)
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


def look(decided: bool, *forecast: float, bench_check: bool = False, seconds: float = 1.0) -> dict[str, object]:
    """Result of one strategy, as written by `run_sequential_case`."""
    return {"forecast": list(forecast), "decided": decided, "bench_check": bench_check, "plan_seconds": seconds}


def test_a_summary_counts_undecided_plants_and_forecasts() -> None:
    decided = {
        "recordings": 2,
        "minutes": 1.5,
        "right": True,
        "true": True,
        "looks": [look(False), look(True, 0.9, seconds=2.0)],
    }
    undecided = {
        "recordings": None,
        "minutes": 4.0,
        "right": False,
        "true": True,
        "looks": [look(False, 0.9, seconds=3.0)],
    }
    (one,) = sequential_summary([{"plan": decided}, {"plan": undecided}]).values()
    assert one["mean_releases"] == (2 + SEQUENTIAL.most + 1) / 2
    assert one["mean_minutes"] == 2.75
    assert (one["decided"], one["right_when_stopped"], one["forecasts"]) == (0.5, 1.0, 2)
    assert one["forecast_calibration_error"] == pytest.approx(0.4)
    by_chance = 0.81 * 0.1 + 0.18 * 0.4 + 0.01 * 0.9  # both, one or none of two events with a probability of 0.9
    assert one["forecast_error_if_exact"] == pytest.approx(by_chance, abs=0.03)
    assert one["plan_seconds"] == 2.0


@pytest.mark.parametrize(
    ("looks", "forecasts", "error"),
    [
        ([look(False, 0.7, 0.9), look(True)], 2, (0.7 + 0.1) / 2),  # not by the first release, but by the second
        ([look(True, 0.7, 0.9)], 2, (0.3 + 0.1) / 2),  # a decision by the first counts for both
        ([look(False, 0.7, 0.9)], 1, 0.7),  # ends at the maximum number: nothing is known of the second
        ([look(False, 0.7, 0.9, bench_check=True)], 2, (0.3 + 0.1) / 2),  # enough: a bench check decides the rest
    ],
)
def test_a_forecast_of_several_releases_is_judged_by_all_of_them(
    looks: list[dict[str, object]], forecasts: int, error: float
) -> None:
    outcome = {"recordings": None, "minutes": 1.0, "right": False, "true": False, "looks": looks}
    (one,) = sequential_summary([{"plan": outcome}]).values()
    assert one["forecasts"] == forecasts
    assert one["forecast_calibration_error"] == pytest.approx(error)


def test_a_campaign_whose_trials_all_failed_has_no_strategies(tmp_path: Path) -> None:
    assert sequential_summary(read_strategies(tmp_path, 2)) == {}


def test_strategies_are_scored_on_the_first_n_trials(tmp_path: Path) -> None:
    lines = [json.dumps({"number": number, "strategies": {"plan": {"trial": number}}}) for number in (2, 0, 1)]
    (tmp_path / TRIALS).write_text("\n".join(lines), encoding="utf-8")
    assert read_strategies(tmp_path, 2) == [{"plan": {"trial": 0}}, {"plan": {"trial": 1}}]


def test_only_the_plan_that_may_choose_them_records_for_other_durations(paper: Rig) -> None:
    permitted = {}
    for name, strategy in STRATEGIES.items():
        times = limits_of(paper, times=strategy.times).recording
        permitted[name] = (times.shortest_s, times.longest_s)
    assert permitted == {"plan": (10.0, 10.0), "free": (10.0, 30.0), "menu": (10.0, 10.0), "random": (10.0, 10.0)}


@pytest.mark.long
def test_every_strategy_records_for_a_permitted_duration(paper: Rig) -> None:
    durations = {}
    for name, strategy in STRATEGIES.items():
        now = Situation(paper, [], None, np.random.default_rng(0), limits_of(paper, times=strategy.times))
        durations[name] = strategy.choose(now)[0].duration_s
    assert durations == {"plan": 10.0, "free": 30.0, "menu": 10.0, "random": 10.0}


@pytest.mark.long
def test_a_plant_is_played_by_every_strategy(tmp_path: Path) -> None:
    campaign = Campaign((Kind.SINGLE,), seed=1, strategies=tuple(STRATEGIES))
    (outcome,) = run_campaign(campaign, 1, tmp_path).outcomes
    (strategies,) = read_strategies(tmp_path, 1)
    assert list(strategies) == ["plan", "free", "menu", "random"]
    assert strategies["plan"]["score"]["named"] == list(outcome.named)
    looks = strategies["plan"]["looks"]
    assert strategies["plan"]["recordings"] == len(looks)
    assert looks[-1]["decided"] or looks[-1]["bench_check"]
    assert not any(look["decided"] or look["bench_check"] for look in looks[:-1])
