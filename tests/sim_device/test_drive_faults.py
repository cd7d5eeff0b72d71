"""What simulated drives do and do not tell: the faults that blind trials of driven rigs draw."""

import numpy as np

from sim_device.plant.config import DriveConfig
from sim_device.plant.drives import JointDrives
from sim_device.trials.driven import drawn_fault


def test_a_faulty_drive_acts_otherwise_than_it_tells() -> None:
    table = np.array([0.0, 1.0]), np.array([[0.1, 0.2], [0.1, 0.2]])
    config = DriveConfig(tells=("measured",), gain=(1.1, 1.0), offset_Nm=(0.0, -0.02))
    drives = JointDrives(*table, config, 1)
    assert np.allclose(drives.exerted(0, 2, 1000.0), [[0.11, 0.18]] * 2)
    assert np.allclose(drives.told(0, 0, 2, 1000.0)[:, 0] * drives.unit_Nm, [[0.1, 0.2]] * 2)


def test_chance_draws_every_fault_and_none() -> None:
    drawn = {fault.name if (fault := drawn_fault(seed)) else None for seed in range(60)}
    joints = {f"torque_{what}_joint{j}" for what in ("scale", "offset") for j in (1, 2)}
    assert drawn == {None, "input_delay", *joints}
