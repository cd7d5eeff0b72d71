"""Public functions accept recordings and models of a clamped and of a moving arm."""

import numpy as np
import pytest

import dpr_lab as dpr
from dpr_lab.dynamics.arm import ArmParameters
from dpr_lab.identification.moving_arm.identifiability import ArmIdentifiability
from dpr_lab.run import Run
from tests.whole_swing import simulate_arm


@pytest.fixture(scope="module")
def pendulum() -> tuple[Run, dpr.Rig]:
    """A swing of the built-in rotary pendulum with a free arm."""
    table = dpr.load_rig("furuta").model_dump(exclude_none=True)
    rig = dpr.Rig.model_validate({**table, "arm": {**table["arm"], "mode": "free"}})
    t = np.arange(0, 3, 0.005)
    l1, m1, c1, J1 = rig.nominal[[0, 2, 5, 7]]
    Z = [l1, 0.1, m1, 1e-9, 1e-9, c1, 0.0, J1, 1e-9]
    arm = ArmParameters(J0=4e-5, c0=1e-4, mode="free")
    start = [0.0, np.pi - 1.0, np.pi - 1.0, 0.0, 0.0, 0.0]
    theta = simulate_arm(Z, (rig.L0, rig.L1, rig.g), arm, start, t)[:, :3]
    theta[:, :2] += np.random.default_rng(5).normal(0, 3e-4, (len(t), 2))
    theta[:, 2] = theta[:, 1]
    run = Run("free", t, theta, None, None, rig.name, "", 200.0, mounting="inner", arm_mode="free")
    return run, rig


@pytest.mark.slow
def test_one_function_identifies_loads_and_compares_a_moving_arm(pendulum, tmp_path):
    run, rig = pendulum
    model = dpr.identify(run, rig)
    assert isinstance(model, dpr.MovingArmModel)
    assert {"e1/a", "A/a"} <= set(model.ratios)
    model.save(tmp_path / "model.json")
    loaded = dpr.load_model(tmp_path / "model.json")
    assert loaded == model
    comparison = dpr.compare(run, rig, loaded)
    assert isinstance(comparison, dpr.ArmComparison)
    assert comparison.rms_rad["joint 0"] < 4e-4
    assert repr(comparison).splitlines()[1].split() == ["mrad", "rms", "joint", "0", "joint", "1"]
    assert "array(" not in repr(comparison)
    with pytest.raises(dpr.DprError, match="no search to plot"):
        dpr.plot_search(model)
    analysis = dpr.identifiability(run, rig)
    assert isinstance(analysis, ArmIdentifiability)
    assert "A/a" in analysis.combinations


def test_a_model_of_a_clamped_arm_does_not_take_a_run_of_a_moving_one(pendulum):
    run, rig = pendulum
    with pytest.raises(dpr.DprError, match="its arm was free, but the arm of the model is clamped"):
        dpr.compare(run, rig, dpr.Model.model_construct())
