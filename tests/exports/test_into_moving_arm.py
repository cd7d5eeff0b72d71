"""The model of a rig with a moving arm written into the user's MJCF file, against MuJoCo models with other numbers."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from dpr_lab.cli.app import app
from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS
from dpr_lab.errors import ConfigError
from dpr_lab.exports.into import into_file
from dpr_lab.identification.model import EstimatedValue, RigFacts
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.rig import Rig, load_rig
from dpr_lab.workflows.rig_from import rig_from_model

mujoco = pytest.importorskip("mujoco")

ROBOT = """<mujoco model="own">
  <!-- drawn > weighed: "keep" me -->
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81" timestep="0.0005" integrator="RK4"/>
  <default><joint damping="0.002"/></default>
  <worldbody>
    <body name="carrier" pos="0 0 1">
      <joint name="yaw" axis="0 0 -1" damping="0.02" armature="0.001"/>
      <inertial pos="0 0 0" mass="0.5" diaginertia="0.004 0.004 0.008"/>
      <body name="upper" pos="0 0.2 0">
        <joint name="shoulder" axis="0 1 0"/>
        <inertial pos="0 0 -0.12" mass="0.3" diaginertia="0.002 0.002 1e-9"/>
        <body name="encoder" pos="0 0 -.3"><inertial pos="0 0 0" mass=".08" diaginertia="1e-9 1e-9 1e-9"/></body>
        <body name="lower" pos="0 0 -0.3">
          <joint name="elbow" axis="0 -1 0" damping="0.001"/>
          <inertial pos="0 0 -0.125" mass="0.15" diaginertia="0.0008 0.0008 1e-9"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="servo" joint="yaw" gear="2 0 0 0 0 0"/></actuator>
</mujoco>
"""
PLANTED = {
    "damping of the arm": ('axis="0 0 -1" damping="0.02"', 'axis="0 0 -1" damping="0.05"'),
    "inertia of the arm": ('diaginertia="0.004 0.004 0.008"', 'diaginertia="0.006 0.006 0.012"'),
    "length of the arm": ('<body name="upper" pos="0 0.2 0">', '<body name="upper" pos="0 0.21 0">'),
    "spring of the arm": ('armature="0.001"', 'armature="0.001" stiffness="0.3"'),
    "gear": ('gear="2 0 0 0 0 0"', 'gear="2.4 0 0 0 0 0"'),
    "centre of mass of the outer rod": ('pos="0 0 -0.125"', 'pos="0 0 -0.135"'),
    "damping of the elbow": ('damping="0.001"', 'damping="0.0004"'),
}
T = np.arange(0, 2, 0.005)


def swing(text: str, rig: Rig, start: tuple[float, float], t: np.ndarray, input_gear: float = 2.0) -> np.ndarray:
    """Angles (n, 3) of arm and rods by the encoders of the rig file, under an input of the motor."""
    engine = mujoco.MjModel.from_xml_string(text)
    engine.opt.timestep = 2.5e-4
    data, count = mujoco.MjData(engine), 2 * np.pi / 16384
    data.qpos[:] = count * np.array(rig.positions([0.0, *start]))
    angles = []
    for torque in push(t):
        angles.append(rig.theta(data.qpos / count))
        data.ctrl[:] = rig.encoders.direction[0] * torque / input_gear
        mujoco.mj_step(engine, data, round((t[1] - t[0]) / 2.5e-4))
    return np.array(angles)


def push(t: np.ndarray) -> np.ndarray:
    """Torque on the arm that the user computes with the gear of the file, N m."""
    return 0.4 * np.sin(4 * t) + 0.3 * np.sin(7.3 * t + 1)


def files(folder: Path, planted: str) -> tuple[Path, Rig, str]:
    """The user's file, its rig, and the true file."""
    wrong, right = PLANTED[planted]
    assert ROBOT.count(wrong) == 1
    file = folder / "robot.xml"
    file.write_text(ROBOT, encoding="utf-8")
    rig_from_model(file, folder / "rig.toml")
    return file, load_rig(folder / "rig.toml"), ROBOT.replace(wrong, right)


def model_like(truth: str, rig: Rig, folder: Path, gain: float) -> MovingArmModel:
    """Model that a perfect identification of the true file gives. Fields that no export reads have default values."""
    (folder / "truth.xml").write_text(truth, encoding="utf-8")
    rig_from_model(folder / "truth.xml", folder / "truth.toml")
    true = load_rig(folder / "truth.toml")
    a, b, d, e1, c1, c2 = base_parameters(true.nominal, true.L1, true.g)
    assert true.arm.A is not None
    assert true.arm.c0 is not None
    k0 = true.arm.k0.nominal if true.arm.k0 else 0.0
    values = (a, b, d, e1, c1, c2, true.arm.A.nominal, true.arm.c0.nominal, k0, 0.0, gain, true.L0)
    swing = [v if n == "L0" else v / b for n, v in zip(SWING_PARAMETERS, values, strict=True)]
    one = EstimatedValue(value=b, std=1e-5, interval90=(b, b), fixed_by="data")
    return MovingArmModel.model_construct(
        rig=RigFacts.model_construct(name=rig.name, sha256="", L1=rig.L1, g=rig.g), mounted="both", input="torque",
        scale="b", ratios={"A/b": one}, absolute={"b": one}, swing=swing, effects={}, scale_sentence="",
    ).with_arm_effects()  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("planted", PLANTED)
def test_the_changed_file_swings_as_the_rig_does(planted: str, tmp_path: Path) -> None:
    file, rig, truth = files(tmp_path, planted)
    patched = into_file(model_like(truth, rig, tmp_path, 1.2 if planted == "gear" else 1.0), rig, file)
    elements = {(change.element, change.attribute) for change in patched.changes}
    assert len(elements) == 1, elements
    of_rig = swing(truth, rig, (2.3, 3.6), T)
    before, after = (np.abs(swing(text, rig, (2.3, 3.6), T) - of_rig).max() for text in (ROBOT, patched.text.decode()))
    assert after < 1e-3 * before


def test_what_cannot_be_changed_is_refused(tmp_path: Path) -> None:
    file, rig, _ = files(tmp_path, "gear")
    model = model_like(ROBOT, rig, tmp_path, 1.0)
    assert into_file(model, rig, file).changes == ()
    light = ROBOT.replace('diaginertia="0.004 0.004 0.008"', 'diaginertia="1e-5 1e-5 1e-5"')
    light = light.replace('inertial pos="0 0 0" mass="0.5"', 'inertial pos="0.1 0 0" mass="0.5"')
    file.write_text(light, encoding="utf-8")
    (tmp_path / "less").mkdir()
    less = model_like(light.replace('pos="0.1 0 0"', 'pos="0.05 0 0"'), rig, tmp_path / "less", 1.0)
    with pytest.raises(ConfigError, match="body 'carrier' of the arm would need the inertia -0"):
        into_file(less, rig, file)
    alone = ROBOT.replace('<joint name="yaw" axis="0 0 -1" damping="0.02" armature="0.001"/>', "")
    file.write_text(alone.replace('joint="yaw"', 'joint="elbow"'), encoding="utf-8")
    with pytest.raises(ConfigError, match="the identified arm moves, but no joint of the file is assigned to it"):
        into_file(model, rig, file)


@pytest.mark.long
def test_identified_numbers_go_into_the_file_and_are_replayed_with_their_input(tmp_path: Path) -> None:
    file, rig, truth = files(tmp_path, "damping of the arm")
    rng, runs = np.random.default_rng(1), []
    t = np.arange(0, 2.5, 0.005)
    for number, start in enumerate([(2.3, 3.6), (3.9, 3.0)]):
        theta = swing(truth, rig, start, t) + rng.normal(0, 3e-4, (len(t), 3))
        table = tmp_path / f"swing{number}.csv"
        rows = np.column_stack([t, theta, push(t)])
        np.savetxt(table, rows, delimiter=",", header="t,theta0,theta1,theta2,torque", comments="", fmt="%.9f")
        runs.append(tmp_path / f"swing{number}.mcap")
        args = ["import", "table", str(table), "--rig", str(tmp_path / "rig.toml"), "--out", str(runs[-1])]
        done = CliRunner().invoke(app, [*args, "--keep-rest"])
        assert done.exit_code == 0, done.output
    of_rig, model = ["--rig", str(tmp_path / "rig.toml")], tmp_path / "m.json"
    done = CliRunner().invoke(app, ["identify", str(runs[0]), *of_rig, "--out", str(model)])
    assert done.exit_code == 0, done.output
    args = ["export", str(model), *of_rig, "--into", str(file), "--check", str(runs[1]), "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, [*args, "--json"])
    assert done.exit_code == 0, done.output
    (replay,) = json.loads(done.stdout)["replays"]
    assert replay["after_rad"] == pytest.approx(replay["lab_rad"], rel=0.05)
    assert replay["before_rad"] > 5 * replay["after_rad"]
    assert 'damping="0.0' in (tmp_path / "out" / "robot.xml").read_text(encoding="utf-8")
