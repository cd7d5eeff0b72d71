"""Drift of a rig with a driven arm: only the increased friction of the arm is reported."""

from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.drift.changes import changes
from dpr_lab.drift.estimates import estimate_each, estimate_each_arm
from dpr_lab.dynamics.arm import ArmParameters
from dpr_lab.errors import RunError
from dpr_lab.run import Run
from tests.identification.test_moving_arm_fit import NOISE, rig_with
from tests.whole_swing import simulate_arm

T = np.arange(0, 2, 0.005)
PUSH = 0.25 * np.sin(4 * T) + 0.2 * np.sin(7.3 * T + 1)


def runs_of(rig, c0, rng, name):
    arm = ArmParameters(J0=0.02, c0=c0, mode="free")
    runs = []
    for k in range(3):
        start = [0.0, np.pi + 0.6 + 0.02 * k, np.pi + 0.3, 0.0, 0.0, 0.0]
        angles = simulate_arm(rig.nominal, (rig.L0, rig.L1, rig.g), arm, start, T, drive=PUSH)[:, :3]
        noise = rng.normal(0, NOISE, angles.shape)
        noise[:, 2] += noise[:, 1]
        runs.append(
            Run(f"{name}{k}", T, angles + noise, None, "X1", rig.name, "", 200.0, arm_mode="driven", arm_input=PUSH)
        )
    return runs


@pytest.mark.slow
def test_friction_of_the_arm_that_rises_is_named():
    rng, rig = np.random.default_rng(2), rig_with("driven", "torque")
    runs = runs_of(rig, 0.02, rng, "monday")[:2] + runs_of(rig, 0.026, rng, "friday")[:2]
    estimates = estimate_each_arm(runs, rig)
    assert {"A/b", "c0/b", "1/b"} <= set(estimates.names)
    drift = changes(estimates, [0, 0, 1, 1], ["monday", "friday"])
    (moved,) = drift.moved
    assert moved.name == "c0/b"
    b = 1 / estimates.values[:, estimates.names.index("1/b")].mean()
    assert abs(moved.change * b - 0.006) < 0.0015


def test_runs_of_two_modes_are_not_compared():
    rng, rig = np.random.default_rng(2), rig_with("driven", "torque")
    first, *others = runs_of(rig, 0.02, rng, "a")
    with pytest.raises(RunError, match="driven in some runs and free in others"):
        estimate_each_arm([replace(first, arm_mode="free", arm_input=None), *others], rig)


@pytest.mark.slow
def test_effects_of_a_diagnosis_are_compared_too():
    rng, rig = np.random.default_rng(2), rig_with("driven", "torque")
    runs = runs_of(rig, 0.02, rng, "monday")[:2] + runs_of(rig, 0.026, rng, "friday")[:2]
    effects = {"free_arm": {"inertia_kgm2": 0.08, "viscous_Nms": 0.02}, "coulomb_joint0": {"torque_Nm": 0.001}}
    estimates = estimate_each(runs, rig, effects)
    assert {"a/b", "A/b", "c0/b", "b"} <= set(estimates.names)
    assert "coulomb_joint0.torque_Nm" in estimates.names
    alone = estimate_each_arm(runs[:1], rig)  # fits A/b itself
    std = [dict(zip(each.names, each.std[0], strict=True)) for each in (estimates, alone)]
    first, second = (each["A/b"] / each["a/b"] for each in std)
    assert first == pytest.approx(second, rel=0.2)
    drift = changes(estimates, [0, 0, 1, 1], ["monday", "friday"])
    assert [parameter.name for parameter in drift.moved] == ["c0/b"]
