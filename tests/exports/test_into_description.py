"""Corrected model in the user's own URDF or SDFormat file: only its numbers change."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.exports.into import into_file
from dpr_lab.exports.into.replay import replay_files
from dpr_lab.rig import Rig, load_rig
from dpr_lab.simulator_models import read_model
from dpr_lab.simulator_models.double_pendulum import double_pendulum
from dpr_lab.workflows.rig_from import rig_from_model
from tests.exports.models import identified_model, model_of

pytest.importorskip("urdf_parser_py")

URDF = """<?xml version="1.0"?>
<!-- drawn > weighed: "keep" me -->
<robot name="own">
  <link name="base"/>
  <link name="upper">
    <inertial>
      <origin xyz="0 0.12 0" rpy="0 0 0"/>
      <mass value="0.3"/>
      <inertia ixx="0.002" ixy="0" ixz="0" iyy="0.0005" iyz="0" izz="0.0021"/>
    </inertial>
    <visual><geometry><mesh filename="package://own/upper.stl"/></geometry></visual>
  </link>
  <link name="encoder"><inertial><mass value="0.08"/><inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/>
  </inertial></link>
  <link name="lower">
    <inertial>
      <origin rpy="0 0 0.3" xyz="0 0 -0.125"/>
      <mass value="0.15"/>
      <inertia ixx="0.0008" ixy="0" ixz="0" iyy="0.0008" iyz="0" izz="0.00002"/>
    </inertial>
  </link>
  <joint name="shoulder" type="continuous">
    <parent link="base"/><child link="upper"/>
    <origin xyz="0 0 1" rpy="-1.5707963267948966 0 0"/>
    <axis xyz="0 0 -1"/>
    <dynamics damping="0.002"/>
  </joint>
  <joint name="carries" type="fixed"><parent link="upper"/><child link="encoder"/><origin xyz="0 0.3 0"/></joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/><child link="lower"/>
    <origin xyz="0 0.3 0" rpy="1.5707963267948966 0 0"/>
    <axis xyz="0 1 0"/>
    <dynamics damping="0.001"/>
  </joint>
</robot>
"""
SDF = """<?xml version="1.0"?>
<sdf version="1.10">
  <!-- drawn > weighed: "keep" me -->
  <world name="lab">
    <gravity>0 0 -9.81</gravity>
    <model name="own">
      <pose>0 0 1 0 0 0.4</pose>
      <link name="upper">
        <inertial><pose>0 0 -0.12 0 0 0</pose><mass>0.3</mass>
          <inertia><ixx>0.002</ixx><iyy>0.0021</iyy><izz>0.0005</izz><ixy>0</ixy><ixz>0</ixz><iyz>0</iyz></inertia>
        </inertial>
      </link>
      <link name="encoder">
        <pose relative_to="upper">0 0 -0.3 0 0 0</pose>
        <inertial><mass>0.08</mass><inertia><ixx>1e-5</ixx><iyy>1e-5</iyy><izz>1e-5</izz></inertia></inertial>
      </link>
      <joint name="carries" type="fixed"><parent>upper</parent><child>encoder</child></joint>
      <link name="lower">
        <pose relative_to="upper">0 0 -0.3 0 0.7 0</pose>
        <inertial><pose>0 0 -0.125 0 0 0</pose><mass>0.15</mass>
          <inertia><ixx>0.0008</ixx><iyy>0.0008</iyy><izz>2e-5</izz></inertia>
        </inertial>
      </link>
      <joint name="shoulder" type="revolute">
        <parent>world</parent><child>upper</child>
        <axis><xyz>0 1 0</xyz><dynamics><damping>0.002</damping></dynamics></axis>
      </joint>
      <joint name="elbow" type="revolute">
        <parent>upper</parent><child>lower</child>
        <axis><xyz>0 1 0</xyz><dynamics><damping>0.001</damping></dynamics></axis>
      </joint>
    </model>
  </world>
</sdf>
"""
FILES = {"urdf": URDF, "sdf": SDF}
each_format = pytest.mark.parametrize("name", FILES)


@pytest.fixture
def file(tmp_path: Path, name: str) -> Path:
    if name == "sdf":
        pytest.importorskip("pydrake")
    path = tmp_path / f"own.{name}"
    path.write_text(FILES[name], encoding="utf-8")
    return path


def rig_of(file: Path) -> Rig:
    rig_from_model(file, file.with_suffix(".toml"))
    return load_rig(file.with_suffix(".toml"))


def identified(rig: Rig, **factors: float) -> Rig:
    given = rig.model_dump(exclude_none=True)
    for name, factor in factors.items():
        given["parameters"][name]["nominal"] *= factor
    return Rig.model_validate(given)


@each_format
def test_what_was_read_comes_back_without_a_change(file: Path, name: str) -> None:
    rig = rig_of(file)
    patched = into_file(model_of(rig, {}, rig.name), rig, file)
    assert patched.text == file.read_bytes()
    assert patched.changes == ()


@each_format
def test_the_changed_file_has_the_numbers_of_the_corrected_model(file: Path, name: str) -> None:
    rig = rig_of(file)
    truth = identified(rig, l1=1.07, J2=1.2, l2=0.93, c1=0.4, J1=1.3)
    effects = {"coulomb_joint2": {"torque_Nm": 0.004}}
    patched = into_file(model_of(truth, effects, rig.name), rig, file)
    chain = double_pendulum(read_model(file, patched.text), (), rig.g)
    values = {key: parameter.nominal for key, parameter in truth.parameters.items()}
    inner, outer = chain.rods
    assert inner.joint.damping == pytest.approx(values["c1"])
    assert (outer.joint.friction, inner.joint.friction) == (pytest.approx(0.004), 0.0)
    assert outer.mass == pytest.approx(values["m2"])
    assert outer.centroid == pytest.approx(values["l2"])
    assert outer.inertia == pytest.approx(values["J2"])
    moment = inner.mass * inner.centroid
    assert moment == pytest.approx(values["m1"] * values["l1"])
    assert b'drawn > weighed: "keep" me' in patched.text
    for line in ("upper.stl", "<mass", "<parent"):
        assert patched.text.count(line.encode()) == FILES[name].count(line)


@each_format
def test_only_the_numbers_change(file: Path, name: str) -> None:
    rig = rig_of(file)
    patched = into_file(model_of(identified(rig, J2=1.1, c1=2.0), {}, rig.name), rig, file)
    before, after = FILES[name].splitlines(), patched.text.decode().splitlines()
    assert len(before) == len(after)
    lines = [new for old, new in zip(before, after, strict=True) if old != new]
    assert len(lines) == 2
    assert all(word in line for word, line in zip(("ixx", "damping"), lines, strict=True))


@each_format
def test_a_longer_rod_moves_the_elbow(file: Path, name: str) -> None:
    rig = rig_of(file)
    patched = into_file(model_of(rig, {"wrong_length_L1": {"added_m": 0.01}}, rig.name), rig, file)
    chain = double_pendulum(read_model(file, patched.text), (), rig.g)
    assert chain.rods[0].length == pytest.approx(0.31)
    assert chain.rods[1].centroid == pytest.approx(rig.parameters["l2"].nominal * 0.3 / 0.31)  # the moment stays
    moved = {change.element for change in patched.changes if change.attribute in ("xyz", "pose")}
    assert {"urdf": "joint elbow", "sdf": "link lower"}[name] in moved | {each.partition(",")[0] for each in moved}


@each_format
def test_effects_that_the_format_does_not_hold_are_listed(file: Path, name: str) -> None:
    rig = rig_of(file)
    effects = {"rotor_inertia_joint2": {"inertia_kgm2": 3e-4}, "spring_joint1": {"stiffness_Nm_per_rad": 0.05}}
    patched = into_file(model_of(rig, effects, rig.name), rig, file)
    assert set(patched.lost) == {"rotor_inertia_joint2"}
    assert patched.passive.effects == (() if name == "sdf" else ("spring_joint1",))
    assert (b"<spring_stiffness>0.05</spring_stiffness>" in patched.text) is (name == "sdf")


@pytest.mark.slow
@each_format
def test_a_replay_shows_both_files(file: Path, name: str) -> None:
    pytest.importorskip("mujoco")
    from tests.exports.planted_errors import recordings

    rig = rig_of(file)
    truth = identified(rig, c1=0.2, J2=1.3)
    right = into_file(model_of(truth, {}, rig.name), rig, file)
    runs = recordings(_mujoco(file, right.text), rig, seconds=2.0)[:1]
    (replay,) = replay_files(file, right, (), identified_model(truth, {}, rig.name), rig, runs)
    assert replay.until_s > 1.0
    assert replay.after_rad < 1.5 * replay.lab_rad < 0.1 * replay.before_rad


def _mujoco(file: Path, text: bytes) -> str:
    """The same rods as MJCF, with the zeros and signs of the joints of the file."""
    chain = double_pendulum(read_model(file, text), (), 9.81)
    joints, places = [], []
    for rod in chain.rods:
        axis = rod.direction * np.array([0.0, 1.0, 0.0])
        joints.append(f'axis="{axis[0]} {axis[1]} {axis[2]}" damping="{rod.joint.damping}" ref="{rod.hanging}"')
        inertia = f"{rod.inertia} {rod.inertia} 1e-6"
        places.append(f'<inertial pos="0 0 {-rod.centroid}" mass="{rod.mass}" diaginertia="{inertia}"/>')
    mass = max(chain.elbow_mass, 1e-9)
    return f"""<mujoco><compiler angle="radian" balanceinertia="true"/>
      <option gravity="0 0 {-chain.gravity}" integrator="RK4"/><worldbody><body><joint {joints[0]}/>{places[0]}
      <body pos="0 0 -0.3"><inertial pos="0 0 0" mass="{mass}" diaginertia="1e-9 1e-9 1e-9"/></body>
      <body pos="0 0 -0.3"><joint {joints[1]}/>{places[1]}</body></body></worldbody></mujoco>"""


def test_a_default_inertia_of_sdformat_becomes_an_element(tmp_path: Path) -> None:
    pytest.importorskip("pydrake")
    file = tmp_path / "own.sdf"
    inertia = "<inertia><ixx>0.0008</ixx><iyy>0.0008</iyy><izz>2e-5</izz></inertia>"
    file.write_text(SDF.replace(inertia, ""), encoding="utf-8")
    rig = rig_of(file)
    assert rig.parameters["J2"].nominal == pytest.approx(1.0)
    patched = into_file(model_of(identified(rig, J2=0.9), {}, rig.name), rig, file)
    assert patched.text.count(b"<ixx>0.9</ixx>") == 1
    assert {change.element for change in patched.changes} == {"link lower, inertia"}


@each_format
def test_an_element_with_mixed_content_is_refused(file: Path, name: str) -> None:
    if name != "sdf":
        pytest.skip("URDF has attributes only")
    rig = rig_of(file)
    file.write_text(SDF.replace("<damping>0.002", "<damping><!-- guess -->0.002"), encoding="utf-8")
    with pytest.raises(ConfigError, match="contains more than text"):
        into_file(model_of(identified(rig, c1=2.0), {}, rig.name), rig, file)


def test_a_rotor_of_drake_cannot_be_changed(tmp_path: Path) -> None:
    file = tmp_path / "own.urdf"
    rotor = '<drake:rotor_inertia value="1e-4"/>'
    motor = f'<transmission name="t"><joint name="elbow"/><actuator name="m">{rotor}</actuator></transmission>'
    head, tail = URDF.rsplit("</robot>", 1)
    drake = head.replace("<robot ", '<robot xmlns:drake="http://drake.mit.edu" ', 1)
    file.write_text(f"{drake}{motor}</robot>{tail}", encoding="utf-8")
    rig = rig_of(file)
    with pytest.raises(
        ConfigError, match=r"the rotor inertia of joint 'elbow' \(drake:rotor_inertia\) cannot be changed"
    ):
        into_file(model_of(rig, {}, rig.name), rig, file)
