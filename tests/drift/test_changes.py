"""What moved between groups of runs is found, and what did not is left alone."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from dpr_lab.drift.changes import DriftSettings, changes
from dpr_lab.drift.estimates import Estimates, estimate_each
from dpr_lab.drift.groups import Occasion, grouped
from dpr_lab.errors import RunError
from dpr_lab.rig import load_rig
from sim_device.plant.config import load_plant
from sim_device.trials.offline_recorder import record

FEW = DriftSettings(draws=1000)


def drawn(rng, groups=2, repeats=3, poses=("X1", "X2", "X3"), change=0.0, at=1):
    group = np.repeat(np.arange(groups), repeats * len(poses))
    of_run = poses * (groups * repeats)
    values = 10 + rng.standard_normal((len(group), 5)) + np.array([[5.0 * int(pose[1])] for pose in of_run])
    values[group >= at, 2] += change
    return Estimates(("run",) * len(group), of_run, tuple("abcde"), values, np.zeros_like(values)), group.tolist()


def said(found, group, settings=FEW):
    return changes(found, group, [f"day {g + 1}" for g in range(max(group) + 1)], settings)


@pytest.mark.slow
@pytest.mark.parametrize("plan", [{}, {"groups": 4, "repeats": 2}, {"repeats": 6, "poses": ("X1",)}], ids=str)
def test_false_alarms_are_rare_and_three_standard_deviations_are_found(plan) -> None:
    rng = np.random.default_rng(4)
    alarms = [bool(said(*drawn(rng, **plan)).moved) for _ in range(300)]
    assert np.mean(alarms) <= 0.04  # 5 of 300 are to be expected, 12 once in two hundred
    found = [said(*drawn(rng, **plan, change=3.0)) for _ in range(60)]
    assert np.mean(["c" in [item.name for item in drift.moved] for drift in found]) >= 0.85


def test_the_change_point_and_its_intervals() -> None:
    found, group = drawn(np.random.default_rng(1), groups=5, repeats=2, change=8.0, at=3)
    drift = said(found, group)
    (moved,) = drift.moved
    assert (moved.name, drift.groups[moved.after], drift.basis) == ("c", "day 3", "runs of one group")
    assert moved.step_interval[0] < 8.0 < moved.step_interval[1]
    assert moved.p < 0.001
    still = [item for item in drift.parameters if item is not moved]
    assert all(d.interval[0] < 0 < d.interval[1] for item in still for d in item.differences)
    assert drift == said(found, group)


def test_poses_that_no_two_groups_share_cannot_be_compared() -> None:
    found, group = drawn(np.random.default_rng(2), poses=("X1",))
    apart = replace(found, poses=("X1",) * 3 + ("X2",) * 3)
    with pytest.raises(RunError, match="the group day 2 shares no pose with the others"):
        said(apart, group)


def test_one_run_a_day_is_judged_by_its_neighbours_or_by_its_noise() -> None:
    rng = np.random.default_rng(3)
    daily, group = drawn(rng, groups=12, repeats=1, poses=("X1",), change=9.0, at=6)
    drift = said(daily, group)
    assert (drift.basis, [item.name for item in drift.moved]) == ("neighbouring runs", ["c"])
    pair, group = drawn(rng, repeats=1, poses=("X1",))
    noisy = replace(pair, std=np.ones_like(pair.std))
    assert said(noisy, group).basis == "the noise of each run"
    assert not said(noisy, group).moved


MONDAY = datetime(2026, 11, 16, 9, tzinfo=UTC)


def test_days_sessions_and_labels() -> None:
    at = [MONDAY, MONDAY + timedelta(minutes=5), MONDAY + timedelta(hours=3), MONDAY + timedelta(days=1)]
    runs = [Occasion(f"{k}", when, "cold" if k < 1 else "warm") for k, when in enumerate(at)]
    shuffled = [runs[i] for i in (2, 0, 3, 1)]
    assert grouped(shuffled, "day").order == (1, 3, 0, 2)
    assert grouped(shuffled, "day").group == (0, 0, 0, 1)
    assert grouped(shuffled, "session").group == (0, 0, 1, 2)
    assert grouped(shuffled, "label").names == ("cold", "warm")
    with pytest.raises(RunError, match="all 2 runs are of one day"):
        grouped(runs[:2], "day")


@pytest.mark.slow
@pytest.mark.timeout(500)  # kernels may have to be compiled
def test_sizes_of_named_effects_are_watched_too() -> None:
    rig = load_rig("paper")
    runs = record(load_plant("paper", 1), rig, 2.0, 250)
    found = estimate_each(runs, rig, {"coulomb_joint2": {"torque_Nm": 1e-4}})
    assert found.names[5:] == ("coulomb_joint2.torque_Nm/b",)
    assert np.isfinite(found.std).all()


def test_a_change_names_the_two_groups_that_differ_most() -> None:
    rng = np.random.default_rng(8)
    late = said(*drawn(rng, groups=4, change=20.0, at=2))
    (moved,) = late.moved
    assert moved.between == ("day 2", "day 3")
    assert moved.change_interval[0] < 20.0 < moved.change_interval[1]
    found, group = drawn(rng, groups=3)
    found.values[np.array(group) == 2, 2] += 30.0
    found.values[np.array(group) == 1, 2] -= 0.0
    (last,) = said(found, group).moved
    assert last.between[1] == "day 3"
