"""Faults of simulated drives in blind trials: acting and reported torques."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.dynamics.base import whole_parameters
from dpr_lab.dynamics.prediction import predict
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.segments import segments
from dpr_lab.effects import effect_params
from dpr_lab.errors import ConfigError
from dpr_lab.rig import Rig
from dpr_lab.setup import Setup, Torques
from sim_device.options import SEALED_FILE, SEALED_TORQUES, Options
from sim_device.plant.config import DriveConfig, load_plant
from sim_device.plant.drives import JointDrives, load_drives
from sim_device.plant.plant import Plant
from sim_device.trials.draw import draw_plant
from sim_device.trials.driven import done_by_drives, drawn_drives, drawn_fault, driven
from sim_device.trials.request import parse_request, with_kind
from sim_device.trials.seal import opened
from sim_device.trials.trial import sealed_trial


def test_the_torque_of_a_faulty_drive_differs_from_the_reported_one() -> None:
    table = np.array([0.0, 1.0]), np.array([[0.1, 0.2], [0.1, 0.2]])
    config = DriveConfig(reports=("measured",), gain=(1.1, 1.0), offset_Nm=(0.0, -0.02))
    drives = JointDrives(*table, config, 1)
    assert np.allclose(drives.exerted(0, 2, 1000.0), [[0.11, 0.18]] * 2)
    assert np.allclose(drives.reported(0, 0, 2, 1000.0)[:, 0] * drives.unit, [[0.1, 0.2]] * 2)


def test_chance_draws_every_fault_and_none() -> None:
    drawn = {fault.name if (fault := drawn_fault(seed)) else None for seed in range(60)}
    joints = {f"torque_{what}_joint{j}" for what in ("scale", "offset", "ripple") for j in (1, 2)}
    assert drawn == {None, "input_delay", *joints}
    for seed in range(20):
        fault = drawn_fault(seed)
        result = done_by_drives(driven(load_plant("paper", seed), fault).drives)
        assert list(result) == ([fault.name] if fault else [])


def test_a_fault_may_be_asked_for_and_no_other_effect(paper: Rig) -> None:
    subtle = draw_plant(parse_request("driven:subtle:torque_scale_joint2"), load_plant("paper", 5), paper)
    assert 0 < abs(subtle.drives.gain[1] - 1) < 0.02
    with pytest.raises(ConfigError, match="the faults of drives are"):
        draw_plant(parse_request("driven:clear:coulomb_joint1"), load_plant("paper", 5), paper)
    assert all(with_kind("any:clear", seed) != "driven:clear" for seed in range(40))


def test_a_sealed_driven_plant_keeps_its_torques_and_reports_them_with_its_recordings(tmp_path: Path) -> None:
    asked = Options(draw_effects="driven:clear:torque_ripple_joint1", seed=7)
    result = sealed_trial(asked, tmp_path / "device")
    truth = opened(tmp_path / "device")["truth"]
    assert list(truth["effects"]) == ["torque_ripple_joint1"]
    plant = load_plant(tmp_path / SEALED_FILE)
    kept, drawn = load_drives(tmp_path / SEALED_TORQUES, plant.drives, plant.seed), drawn_drives(plant)
    assert np.array_equal(kept.joints, drawn.joints)
    assert np.array_equal(kept.t, drawn.t)
    assert "runs" not in result


@pytest.mark.parametrize("fault", ["torque_ripple_joint1", "torque_ripple_joint2"])
def test_a_drive_that_ripples_swings_as_the_library_says(paper: Rig, fault: str) -> None:
    """The plant scales a detent by the torque that holds, the lab has a law of its own."""
    config = draw_plant(parse_request(f"driven:clear:{fault}"), load_plant("paper", 11), paper)
    drives, start, rate = drawn_drives(config), paper.poses["X2"].theta, 1000.0
    swing = Plant(config, paper).let_go(start, np.zeros(3), rate, 1, partial(drives.exerted, rate_hz=rate))
    t = np.arange(400) / rate
    torques = Torques(t, drives.exerted(0, len(t), rate))
    read = slice(30, None)  # a segment that is read so soon starts at the release
    laid_out = segments([t[read]], setups=[Setup(torques=torques)], step=1e-3)
    initial = np.array([[*start[1:], 0.0, 0.0]])
    whole, rig = whole_parameters(config.Z, paper.L1, paper.g), rig_constants(paper)
    rippling, still = (
        predict(whole, effect_params(effects), rig, laid_out, initial)
        for effects in (done_by_drives(config.drives), {})
    )
    angles = paper.encoders.joint_angles.of_rods(swing.theta(0, len(t))[read, 1:])
    assert np.abs(angles - rippling).max() < 1e-5
    assert np.abs(angles - still).max() > 1e-3
