"""Joint drives that replay a table: acting torques, reported torques, and refusals."""

import os
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.errors import ConfigError
from dpr_lab.rig import Rig
from firmware_protocol.messages import Event, Hello, Hold, Release, Sample, Stream, Torque, TorqueKind, decode, encode
from sim_device.assemble import assemble
from sim_device.options import Options
from sim_device.plant.config import DriveConfig, load_plant
from sim_device.plant.drives import JointDrives, load_drives
from sim_device.plant.foreign.engine import Body
from sim_device.plant.plant import Plant

ROWS = "0.0,0.1,0.02\n0.0105,-0.2,0.02\n0.5,0.0,0.0\n"


@pytest.fixture
def table(tmp_path: Path) -> Path:
    file = tmp_path / "torques.csv"
    file.write_text(f"t_s,tau1_Nm,tau2_Nm\n{ROWS}")
    return file


def test_a_torque_holds_from_its_tick_on_and_equals_the_reported_one(table: Path) -> None:
    drives = load_drives(table, DriveConfig(delay_s=0.002), 1)
    asked = drives.reported(1, 9, 4, 1000.0)[:, 1]
    assert asked.tolist() == [[1000, 200], [1000, 200], [-2000, 200], [-2000, 200]]
    assert drives.reported(1, 11, 3, 1000.0)[:, 0].tolist() == [[1000, 200], [1000, 200], [-2000, 200]]  # 2 ms later
    assert drives.exerted(11, 3, 1000.0) == pytest.approx(drives.reported(1, 11, 3, 1000.0)[:, 0] * 1e-4)
    assert drives.exerted(0, 3, 1000.0)[:, 0] == pytest.approx([0.0, 0.0, 0.1])
    noisy = JointDrives(drives.t, drives.joints, DriveConfig(noise_Nm=0.01, reports=("measured",)), 1)
    assert noisy.kinds == (TorqueKind.MEASURED,)
    assert noisy.reported(1, 20, 400, 1000.0)[:, 0, 0].std() == pytest.approx(100.0, rel=0.15)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("t_s,tau1_Nm\n0,1\n1,1\n", "needs a line with the names t_s, tau1_Nm, tau2_Nm"),
        ("x,tau1_Nm,tau2_Nm\n0,1,1\n1,1,1\n", "needs a line with the names"),
        ("t_s,tau1_Nm,tau2_Nm\n0,1,1\n1,1\n", "one number for each name in every line"),
        ("", "needs a line with the names"),
        ("t_s,tau1_Nm,tau2_Nm\n0,1,1\n0,1,1\n", "finite numbers and increasing times"),
        ("t_s,tau1_Nm,tau2_Nm\n0,1,1\n1,4,1\n", "4 N m is more than a message can contain in units of 100 uN m"),
    ],
)
def test_what_cannot_be_replayed_is_refused(tmp_path: Path, text: str, reason: str) -> None:
    file = tmp_path / "bad.csv"
    file.write_text(text)
    with pytest.raises(ConfigError, match=reason):
        load_drives(file, DriveConfig(), 1)
    with pytest.raises(ConfigError, match="cannot be read"):
        load_drives(tmp_path / "none.csv", DriveConfig(), 1)
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(ConfigError, match="is a named pipe"):
        load_drives(tmp_path / "pipe.csv", DriveConfig(), 1)


def test_a_driven_swing_is_that_of_the_equation_under_its_torques(paper: Rig) -> None:
    config = load_plant("paper")
    torques = np.random.default_rng(1).uniform(-0.1, 0.1, (60, 2)).round(4)
    start, still = np.array([0.0, 3.0, 2.8]), np.zeros(3)
    swing = Plant(config, paper).let_go(start, still, 200.0, 1, lambda first, count: torques[first : first + count])
    torques = np.concatenate([torques, np.zeros((200, 2))])
    body, x, result = Body.of(config.Z, paper.L1, paper.L1, paper.g), np.array([3.0, 2.8, 0, 0]), [(3.0, 2.8)]
    for k in range(59):

        def slope(t: float, x: np.ndarray, tau: np.ndarray = torques[k]) -> list[float]:
            theta1, theta2, omega1, omega2 = x
            return [omega1, omega2, *body.accelerations(theta1, theta2, omega1, omega2, tau[0] - tau[1], tau[1])]

        x = solve_ivp(slope, (k / 200, (k + 1) / 200), x, "DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        result.append(tuple(x[:2]))
    assert swing.theta(0, 60)[:, 1:] == pytest.approx(np.array(result), abs=1e-8)


@pytest.mark.parametrize("firmware", ["python", "c"])
def test_every_sample_of_a_driven_device_is_followed_by_its_torques(table: Path, firmware: str, request) -> None:
    if firmware == "c":
        request.getfixturevalue("library")
    board, link, _ = assemble(Options(link="tcp:0", torques=table, firmware=firmware))
    link.close()
    for message in (Hello(1), Hold(2, 1), Stream(3, 1000)):
        board.receive(encode(message), 100.0)
    frames = board.service(100.05)
    released = [decode(frame) for frame in board.receive(encode(Release(4)), 100.05)][-1]
    assert isinstance(released, Event)
    result = [decode(frame) for frame in (*frames, *board.service(100.08))]
    result = [message for message in result if isinstance(message, Sample | Torque)]
    assert [type(message) for message in result] == [Sample, Torque, Torque] * (len(result) // 3)
    assert [message.tick for message in result[::3]] == [message.tick for message in result[2::3]]
    commanded = {m.tick: m.torque1 for m in result if isinstance(m, Torque) and m.kind is TorqueKind.COMMANDED}
    assert {torque for tick, torque in commanded.items() if tick < released.tick} == {0}
    assert [commanded[released.tick + k] for k in (0, 10, 11)] == [1000, 1000, -2000]


def test_drives_need_both_rods_and_none_of_the_effects_of_drives(paper: Rig) -> None:
    alone = replace_rods(paper)
    with pytest.raises(ConfigError, match="need both rods"):
        Plant(load_plant("paper"), alone).refuse_drives()
    off = load_plant("paper").model_copy(update={"effects": {"torque_scale_joint1": {"excess": 0.1}}})
    with pytest.raises(ConfigError, match="simulated drives have no torque_scale_joint1"):
        Plant(off, paper).refuse_drives()


def replace_rods(rig: Rig) -> Rig:
    return rig.model_copy(update={"rods": rig.rods.model_copy(update={"mounted": "inner"})})
