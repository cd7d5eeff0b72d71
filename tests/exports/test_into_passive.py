"""Effects that the user's file cannot contain, as passive forces in MuJoCo at the joints of that file."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.exports.into import into_file
from dpr_lab.exports.into.replay import Simulation
from dpr_lab.exports.programs import Replay
from dpr_lab.rig import Rig, load_rig
from dpr_lab.workflows.rig_from import rig_from_model
from tests.exports.models import X0, lab_states, model_of, run_source, typical
from tests.exports.planted_errors import ROBOT

pytest.importorskip("mujoco")

MJCF = ROBOT.replace('name="elbow" axis="0 1 0"', 'name="elbow" axis="0 -1 0"')
"""Model whose elbow turns in the opposite direction."""
URDF = """<robot name="own">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 -0.12"/><mass value="0.3"/>
    <inertia ixx="0.002" iyy="0.0021" izz="0.0005" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0 0 -0.125"/><mass value="0.15"/>
    <inertia ixx="0.0008" iyy="0.0008" izz="0.00002" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <dynamics damping="0.002" friction="0"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -0.3"/>
    <axis xyz="0 -1 0"/><dynamics damping="0.001" friction="0"/></joint>
</robot>
"""
FILES = {"robot.xml": MJCF, "robot.urdf": URDF}
T = np.linspace(0, 1.5, 31)


def start(folder: Path, name: str) -> tuple[Path, Rig]:
    (folder / name).write_text(FILES[name], encoding="utf-8")
    rig_from_model(folder / name, folder / "rig.toml", g=9.81)
    return folder / name, load_rig(folder / "rig.toml")


def chosen_of(*names: str) -> dict[str, dict[str, float]]:
    return {name: values for effect in names for name, values in typical(effect).items()}


def swing_by_hand(module: str, text: bytes, file: Path) -> np.ndarray:
    """Angles (n, 2) with the written module and the written file, simulated as by a user."""
    file.write_bytes(text)
    names = run_source(module, file.parent)
    names["EngineSwing"].file = str(file)
    return names["simulate"](X0, T, kind=names["EngineSwing"])[:, :2]


def replay_of(lab: np.ndarray) -> Replay:
    return Replay("", T, lab, lab, 0.0, np.array(X0), np.zeros(2), np.zeros((1, 2)))


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_smooth_effects_agree_with_dpr_lab(tmp_path: Path, name: str) -> None:
    path, rig = start(tmp_path, name)
    effects = chosen_of("air_drag_both", "friction_drift_joint2")
    patched = into_file(model_of(rig, effects, rig.name), rig, path)
    assert (patched.lost, set(patched.passive.effects)) == ({}, set(effects))
    swing = swing_by_hand(patched.passive.module, patched.text, path)
    assert np.abs(swing - lab_states(rig, effects, T, 2.5e-4)[:, :2]).max() < 1e-6
    bare = lab_states(rig, {}, T, 2.5e-4)[:, :2]
    assert np.abs(swing - bare).max() > 1e-3


@pytest.mark.slow
def test_friction_at_rest_is_simulated_by_the_engine_and_the_rest_of_the_curve_by_the_module(tmp_path: Path) -> None:
    path, rig = start(tmp_path, "robot.xml")
    effects = chosen_of("stribeck_joint2")
    patched = into_file(model_of(rig, effects, rig.name), rig, path)
    limit = effects["stribeck_joint2"]["torque_Nm"] + effects["stribeck_joint2"]["extra_at_rest_Nm"]
    (friction,) = (change for change in patched.changes if change.attribute == "frictionloss")
    assert float(friction.after) == pytest.approx(limit)
    lab = lab_states(rig, effects, T, 2.5e-4)[:, :2]
    alone = Simulation.of(path, patched.text, (), rig.g).angles(replay_of(lab))
    swing = swing_by_hand(patched.passive.module, patched.text, path)
    assert np.abs(swing - lab).max() < min(2e-3, 0.1 * np.abs(alone - lab).max())


@pytest.mark.slow
@pytest.mark.parametrize("name", FILES)
def test_the_replay_runs_the_module_with_the_file(tmp_path: Path, name: str) -> None:
    path, rig = start(tmp_path, name)
    effects = chosen_of("air_drag_both")
    patched = into_file(model_of(rig, effects, rig.name), rig, path)
    lab = lab_states(rig, effects, T, 2.5e-4)[:, :2]
    swing = replay_of(lab)
    simulation = Simulation.of(path, patched.text, (), rig.g)
    forced = simulation.with_module(patched.passive.module, rig, np.ones(2))
    assert np.abs(forced(swing) - lab)[1:].max() < 1e-5
    assert np.abs(simulation.angles(swing) - lab).max() > 1e-3


def lost_in(folder: Path, name: str, effects: Mapping[str, Mapping[str, float]]) -> dict[str, str]:
    path, rig = start(folder, name)
    return into_file(model_of(rig, effects, rig.name), rig, path).lost


def test_what_adds_inertia_is_no_passive_force(tmp_path: Path) -> None:
    lost = lost_in(tmp_path, "robot.urdf", chosen_of("rotor_inertia_joint2", "air_drag_both"))
    assert lost == {"rotor_inertia_joint2": "URDF has no element for armature"}


def test_a_wrong_torque_constant_is_the_gear_of_the_motor(tmp_path: Path) -> None:
    effects = {"torque_scale_joint2": {"excess": 0.2}}
    path, rig = start(tmp_path, "robot.xml")
    motors = '<actuator><motor joint="shoulder"/><motor joint="elbow" gear="5 0 0 0 0 1"/></actuator>'
    path.write_text(MJCF.replace("</worldbody>", f"</worldbody>{motors}"), encoding="utf-8")
    patched = into_file(model_of(rig, effects, rig.name), rig, path)
    gears = [(c.element, c.after) for c in patched.changes if c.attribute == "gear"]
    assert gears == [("motor of joint elbow", "6 0 0 0 0 1")]
    assert (patched.lost, patched.passive.effects) == ({}, ())


@pytest.mark.parametrize("name", FILES)
def test_a_file_without_a_motor_has_no_gear(tmp_path: Path, name: str) -> None:
    lost = lost_in(tmp_path, name, {"torque_scale_joint2": {"excess": 0.2}})
    assert lost == {"torque_scale_joint2": "the inputs of the model are the acting torques, without drives"}


def test_a_program_with_shorter_steps_gets_the_torque_of_the_step_it_is_in() -> None:
    torques = np.arange(8.0).reshape(4, 2)
    swing = Replay("", T, np.zeros((31, 2)), np.zeros((31, 2)), 0.1, np.array(X0), np.zeros(2), torques)
    firsts = [swing.driven(0.1 + k * 5e-4, None)[0] for k in range(8)]
    assert firsts == [0.0, 0.0, 2.0, 2.0, 4.0, 4.0, 6.0, 6.0]
