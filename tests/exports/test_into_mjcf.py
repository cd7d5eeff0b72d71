"""The corrected model in the user's MJCF file: agreement with dpr-lab, and no other change."""

import difflib
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.simulate import simulate
from dpr_lab.effects import effect_params
from dpr_lab.errors import ConfigError
from dpr_lab.exports.into import into_file
from dpr_lab.rig import Rig, load_rig
from dpr_lab.workflows.rig_from import rig_from_model
from tests.exports.models import X0, model_of

mujoco = pytest.importorskip("mujoco")

ROBOT = """<mujoco model="own">
  <!-- drawn > weighed: "keep" me -->
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81" timestep="0.0005" integrator="RK4"/>
  <default><joint damping="0.002"/></default>
  <worldbody>
    <geom name='floor' type='plane' size='1 1 .1' contype='0' conaffinity='0'/>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" axis="0 1 0"
             frictionloss="0"/>
      <inertial pos="0 0 -0.12" mass="0.3" diaginertia="0.002 0.0021 0.0005"/>
      <body name="encoder" pos="0 0 -.3"><inertial pos="0 0 0" mass=".08" diaginertia="1e-5 1e-5 1e-5"/></body>
      <body name="lower" pos="0 0 -0.3" quat="0.9238795325112867 0 0.3826834323650898 0">
        <joint name="elbow" axis="0 -1 0" damping="0.001"/>
        <geom type="capsule" fromto="0 0 0 0 0 -.25" size=".01" mass=".15"/>
        <body name="tool" pos="0 0 -.25"><geom type="sphere" size=".01" mass=".02"/></body>
      </body>
    </body>
  </worldbody>
  <sensor><jointpos joint="elbow"/></sensor>
</mujoco>
"""
EFFECTS = {
    "coulomb_joint2": {"torque_Nm": 0.004},
    "rotor_inertia_joint2": {"inertia_kgm2": 3e-4},
    "spring_joint1": {"stiffness_Nm_per_rad": 0.05, "constant_Nm": 0.0},
}


@pytest.fixture
def start(tmp_path: Path) -> tuple[Path, Rig]:
    (tmp_path / "robot.xml").write_text(ROBOT, encoding="utf-8")
    rig_from_model(tmp_path / "robot.xml", tmp_path / "rig.toml")
    return tmp_path / "robot.xml", load_rig(tmp_path / "rig.toml")


def identified(rig: Rig, factors: Mapping[str, float]) -> Rig:
    """Rig with other numbers, like the result of an identification."""
    given = rig.model_dump(exclude_none=True)
    for name, factor in factors.items():
        given["parameters"][name]["nominal"] *= factor
    return Rig.model_validate(given)


def swing(text: str, rig: Rig, t: np.ndarray) -> np.ndarray:
    """Absolute angles of the rods in MuJoCo, by the encoders of the rig file."""
    engine = mujoco.MjModel.from_xml_string(text)
    engine.opt.timestep = 2.5e-4
    data = mujoco.MjData(engine)
    counts = rig.positions([0.0, *X0[:2]])[1:]
    data.qpos[:] = counts * 2 * np.pi / 16384
    angles = []
    for _ in t:
        angles.append(rig.theta([0.0, *(data.qpos * 16384 / (2 * np.pi))])[1:])
        mujoco.mj_step(engine, data, round((t[1] - t[0]) / 2.5e-4))
    return np.array(angles)


def test_the_changed_file_swings_as_the_corrected_model(start: tuple[Path, Rig]) -> None:
    path, rig = start
    truth = identified(rig, {"l1": 1.07, "J2": 1.2, "l2": 0.93, "c1": 0.4, "m2": 1.1, "J1": 1.3})
    effects = {name: EFFECTS[name] for name in ("rotor_inertia_joint2", "spring_joint1")}
    patched = into_file(model_of(truth, effects, rig.name), rig, path)
    t = np.linspace(0, 1.5, 31)
    base = base_parameters(truth.nominal, truth.L1, truth.g)
    lab = simulate(base, truth.L1, truth.g, X0, t, 2.5e-4, effect_params(effects), rig_constants(rig))[:, :2]
    zero_counts_round_by = 2 * np.pi / 16384
    off = np.abs(swing(patched.text.decode(), rig, t) - lab).max()
    assert off < 8 * zero_counts_round_by
    assert np.abs(swing(ROBOT, rig, t) - lab).max() > 100 * off


def test_nothing_but_the_numbers_changes(start: tuple[Path, Rig]) -> None:
    path, rig = start
    patched = into_file(model_of(identified(rig, {"c2": 2.0, "J2": 1.1}), EFFECTS, rig.name), rig, path)
    text = patched.text.decode()
    removed = [line[2:] for line in difflib.ndiff(ROBOT.splitlines(), text.splitlines()) if line.startswith("- ")]
    assert all("joint" in line or "frictionloss" in line or "inertial" in line for line in removed)
    before, after = ElementTree.fromstring(ROBOT), ElementTree.fromstring(text)
    (inserted,) = [e for e in after.iterfind(".//body[@name='lower']/inertial")]
    lower = after.find(".//body[@name='lower']")
    assert lower is not None
    lower.remove(inserted)
    assert [element.tag for element in before.iter()] == [element.tag for element in after.iter()]
    changed = {
        (old.get("name", old.tag), key): (old.get(key), new.get(key))
        for old, new in zip(before.iter(), after.iter(), strict=True)
        for key in {*old.attrib, *new.attrib}
        if old.get(key) != new.get(key)
    }
    assert {key: after for key, (_, after) in changed.items() if key[0] == "elbow"} == {
        ("elbow", "damping"): "0.002",
        ("elbow", "frictionloss"): "0.004",
        ("elbow", "armature"): "0.0003",
    }
    assert set(changed) - {("elbow", k) for k in ("damping", "frictionloss", "armature")} == {
        ("shoulder", "stiffness"),
    }
    assert '<!-- drawn > weighed: "keep" me -->' in text


def test_what_was_read_comes_back_without_a_change(start: tuple[Path, Rig]) -> None:
    path, rig = start
    patched = into_file(model_of(rig, {}, rig.name), rig, path)
    assert [change for change in patched.changes if change.attribute != "pos"] == []
    assert patched.text == ROBOT.encode()


def test_a_longer_rod_moves_the_elbow(start: tuple[Path, Rig]) -> None:
    path, rig = start
    patched = into_file(model_of(rig, {"wrong_length_L1": {"added_m": 0.01}}, rig.name), rig, path)
    assert '<body name="lower" pos="0 0 -0.31"' in patched.text.decode()


def test_effects_without_an_attribute_are_listed(start: tuple[Path, Rig]) -> None:
    path, rig = start
    effects = {"air_drag_both": {}, "latency_joint2": {}, "input_delay": {}}
    patched = into_file(model_of(rig, effects, rig.name), rig, path)
    assert (set(patched.lost), patched.passive.effects) == ({"input_delay"}, ("air_drag_both", "latency_joint2"))


def test_a_model_of_another_rig_is_refused(start: tuple[Path, Rig], paper: Rig) -> None:
    path, _ = start
    with pytest.raises(ConfigError, match=r"its L1 is 0.3, but the model has 0.4: start from the rig file"):
        into_file(model_of(paper, {}), paper, path)


def test_masses_that_cannot_be_kept_are_named(start: tuple[Path, Rig]) -> None:
    path, rig = start
    with pytest.raises(ConfigError, match=r"body 'upper' would need the inertia -.* kg m\^2: correct the masses"):
        into_file(model_of(identified(rig, {"l2": 1.8, "J2": 0.1, "m2": 1.8}), {}, rig.name), rig, path)


def test_joints_without_a_name_can_be_read_but_not_changed(tmp_path: Path) -> None:
    file = tmp_path / "robot.xml"
    file.write_text(ROBOT.replace(' name="elbow"', "").replace('<sensor><jointpos joint="elbow"/></sensor>', ""))
    read = rig_from_model(file, tmp_path / "rig.toml")
    assert read.joints == ("shoulder", "joint 1")
    assert any("joints without a name: 1" in note for note in read.notes)
    rig = load_rig(tmp_path / "rig.toml")
    with pytest.raises(ConfigError, match="the joint listed as 'joint 1' has no name in the file"):
        into_file(model_of(rig, {}), rig, file)


def test_no_rounding_error_of_a_rotation_is_written(start: tuple[Path, Rig]) -> None:
    file, rig = start
    file.write_text(ROBOT.replace('name="upper" pos="0 0 1"', 'name="upper" pos="0 0 1" euler="0 0 1.3"'))
    longer = into_file(model_of(identified(rig, {"l1": 1.1, "l2": 1.1}), {}), rig, file)
    places = [change.after for change in longer.changes if change.attribute == "pos"]
    assert len(places) == 2
    assert all("e-" not in place for place in places)


def test_a_flag_that_switches_off_what_would_change_is_refused(tmp_path: Path) -> None:
    flag = '<option><flag frictionloss="disable"/></option>'
    (tmp_path / "robot.xml").write_text(ROBOT.replace("<default>", f"{flag}<default>"), encoding="utf-8")
    rig_from_model(tmp_path / "robot.xml", tmp_path / "rig.toml")
    rig = load_rig(tmp_path / "rig.toml")
    with pytest.raises(ConfigError, match='<flag frictionloss="disable"> switches off'):
        into_file(model_of(rig, {"coulomb_joint2": EFFECTS["coulomb_joint2"]}, rig.name), rig, tmp_path / "robot.xml")
    assert into_file(model_of(rig, {}, rig.name), rig, tmp_path / "robot.xml").changes == ()
