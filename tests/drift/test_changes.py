"""Significant changes between groups of runs are detected, with few false alarms."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from unittest.mock import Mock

import numpy as np
import pytest

from dpr_lab.drift import estimates
from dpr_lab.drift.changes import DriftSettings, changes
from dpr_lab.drift.estimates import Estimates, estimate_each
from dpr_lab.drift.groups import Occasion, grouped
from dpr_lab.errors import RunError
from dpr_lab.rig import load_rig
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record
from tests.thinned import thinned

FEW = DriftSettings(draws=1000)


def drawn(rng, groups=2, repeats=3, poses=("X1", "X2", "X3"), change=0.0, at=1):
    group = np.repeat(np.arange(groups), repeats * len(poses))
    of_run = poses * (groups * repeats)
    values = 10 + rng.standard_normal((len(group), 5)) + np.array([[5.0 * int(pose[1])] for pose in of_run])
    values[group >= at, 2] += change
    return Estimates(("run",) * len(group), of_run, tuple("abcde"), values, np.zeros_like(values)), group.tolist()


def drift_of(estimates, group, settings=FEW):
    return changes(estimates, group, [f"day {g + 1}" for g in range(max(group) + 1)], settings)


@pytest.mark.slow
@pytest.mark.parametrize(
    "plan", thinned([{}, {"groups": 4, "repeats": 2}, {"repeats": 6, "poses": ("X1",)}], 2), ids=str
)
def test_false_alarms_are_rare_and_three_standard_deviations_are_found(plan) -> None:
    rng = np.random.default_rng(4)
    alarms = [bool(drift_of(*drawn(rng, **plan)).moved) for _ in range(300)]
    assert np.mean(alarms) <= 0.04  # 5 of 300 are to be expected, 12 once in two hundred
    drifts = [drift_of(*drawn(rng, **plan, change=3.0)) for _ in range(60)]
    assert np.mean(["c" in [parameter.name for parameter in drift.moved] for drift in drifts]) >= 0.85


def test_the_change_point_and_its_intervals() -> None:
    estimates, group = drawn(np.random.default_rng(1), groups=5, repeats=2, change=8.0, at=3)
    drift = drift_of(estimates, group)
    (moved,) = drift.moved
    assert (moved.name, drift.groups[moved.after], drift.basis) == ("c", "day 3", "runs of one group")
    assert moved.step_interval[0] < 8.0 < moved.step_interval[1]
    assert moved.p < 0.001
    constant = [parameter for parameter in drift.parameters if parameter is not moved]
    assert all(d.interval[0] < 0 < d.interval[1] for parameter in constant for d in parameter.differences)
    assert drift == drift_of(estimates, group)


def test_poses_that_no_two_groups_share_cannot_be_compared() -> None:
    estimates, group = drawn(np.random.default_rng(2), poses=("X1",))
    apart = replace(estimates, poses=("X1",) * 3 + ("X2",) * 3)
    with pytest.raises(RunError, match="the group day 2 shares no pose with the others"):
        drift_of(apart, group)


def test_single_runs_per_group_use_successive_runs_or_the_noise() -> None:
    rng = np.random.default_rng(3)
    daily, group = drawn(rng, groups=12, repeats=1, poses=("X1",), change=9.0, at=6)
    drift = drift_of(daily, group)
    assert (drift.basis, [parameter.name for parameter in drift.moved]) == ("neighbouring runs", ["c"])
    pair, group = drawn(rng, repeats=1, poses=("X1",))
    noisy = replace(pair, std=np.ones_like(pair.std))
    assert drift_of(noisy, group).basis == "the noise of each run"
    assert not drift_of(noisy, group).moved


MONDAY = datetime(2026, 11, 16, 9, tzinfo=UTC)


def test_days_sessions_and_labels() -> None:
    times = [MONDAY, MONDAY + timedelta(minutes=5), MONDAY + timedelta(hours=3), MONDAY + timedelta(days=1)]
    runs = [Occasion(f"{k}", when, "cold" if k < 1 else "warm") for k, when in enumerate(times)]
    shuffled = [runs[i] for i in (2, 0, 3, 1)]
    assert grouped(shuffled, "day").order == (1, 3, 0, 2)
    assert grouped(shuffled, "day").group == (0, 0, 0, 1)
    assert grouped(shuffled, "session").group == (0, 0, 1, 2)
    assert grouped(shuffled, "label").names == ("cold", "warm")
    with pytest.raises(RunError, match="all 2 runs are of one day"):
        grouped(runs[:2], "day")
    with pytest.raises(RunError, match="the run is of one day"):
        grouped(runs[:1], "day")


@pytest.mark.slow
@pytest.mark.timeout(900)  # kernels may have to be compiled
def test_sizes_of_named_effects_are_estimated_too() -> None:
    rig = load_rig("paper")
    runs = record(load_plant("paper", 1), rig, 2.0, 250)
    estimates = estimate_each(runs, rig, {"coulomb_joint2": {"torque_Nm": 1e-4}})
    assert estimates.names[5:] == ("coulomb_joint2.torque_Nm/b",)
    assert np.isfinite(estimates.std).all()


def test_a_change_names_the_two_groups_that_differ_most() -> None:
    rng = np.random.default_rng(8)
    late = drift_of(*drawn(rng, groups=4, change=20.0, at=2))
    (moved,) = late.moved
    assert moved.between == ("day 2", "day 3")
    assert moved.change_interval[0] < 20.0 < moved.change_interval[1]
    estimates, group = drawn(rng, groups=3)
    estimates.values[np.array(group) == 2, 2] += 30.0
    estimates.values[np.array(group) == 1, 2] -= 0.0
    (last,) = drift_of(estimates, group).moved
    assert last.between[1] == "day 3"


def test_a_run_that_the_model_cannot_follow_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    lost = Mock(fit=Mock(chi2=np.inf, free=(), linear=Mock(flat=(np.ones((4, 1)), np.ones(4)))))
    for name, value in (("record", None), ("refuse_without_motion", None), ("Recordings", None)):
        monkeypatch.setattr(estimates, name, lambda *_, value=value: value)
    monkeypatch.setattr(estimates, "fit_bare_model", lambda *_: (None, Mock(measured=np.ones(4)), lost))
    with pytest.raises(RunError, match="X1: the model cannot follow this run"):
        estimate_each([Mock(file="X1")], load_rig("paper"))
