"""Twelve models in the styles of public repositories, written here: each is read, or refused with the exact reason."""

from pathlib import Path

import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.simulator_models import read_model
from dpr_lab.simulator_models.double_pendulum import double_pendulum

pytest.importorskip("mujoco")
pytest.importorskip("urdf_parser_py")


def urdf_link(name: str, mass: float, reach: float) -> str:
    inertia = '<inertia ixx="0.01" iyy="0.01" izz="0.001" ixy="0" ixz="0" iyz="0"/>'
    shape = f'<geometry><cylinder length="{2 * reach}" radius="0.02"/></geometry>'
    visual = f'<visual><origin xyz="0 0 {-reach}"/>{shape}<material name="red"/></visual>'
    inertial = f'<inertial><origin xyz="0 0 {-reach}"/><mass value="{mass}"/>{inertia}</inertial>'
    return f'<link name="{name}">{inertial}{visual}</link>'


def urdf_joint(name: str, parent: str, child: str, z: float, axis: str = "0 1 0", kind: str = "continuous") -> str:
    limit = '<limit lower="-3" upper="3" effort="5" velocity="9"/>' if kind == "revolute" else ""
    ends = f'<parent link="{parent}"/><child link="{child}"/><origin xyz="0 0 {z}"/><axis xyz="{axis}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}<dynamics damping="0.1"/>{limit}</joint>'


ARM_OF_SEVEN = "".join(
    urdf_link(f"link{i}", 1.0, 0.1) + urdf_joint(f"joint{i}", f"link{i - 1}", f"link{i}", 0.2, "0 0 1", "revolute")
    for i in range(1, 8)
)
RODS = urdf_link("upper", 1.0, 0.5) + urdf_link("lower", 1.0, 1.0)

READ = {
    "mjcf, acrobot of a control suite": (
        "model.xml",
        """<mujoco model="acrobot"><default><joint damping=".05"/><geom type="capsule" mass="1"/></default>
        <option timestep="0.01" integrator="RK4"><flag constraint="disable" energy="enable"/></option>
        <worldbody><light name="light" pos="0 0 6"/><geom name="floor" size="3 3 .2" type="plane"/>
          <camera name="fixed" pos="0 -6 2" zaxis="0 -1 0"/>
          <body name="upper_arm" pos="0 0 2"><joint name="shoulder" type="hinge" axis="0 1 0"/>
            <geom name="upper_arm" fromto="0 0 0 0 0 1" size="0.049"/>
            <body name="lower_arm" pos="0 0 1"><joint name="elbow" type="hinge" axis="0 1 0"/>
              <geom name="lower_arm" fromto="0 0 0 0 0 1" size="0.049"/><site name="tip" pos="0 0 1" size="0.01"/>
          </body></body></worldbody>
        <actuator><motor name="elbow" joint="elbow" gear="2" ctrllimited="true" ctrlrange="-1 1"/></actuator>
        </mujoco>""",
        ("shoulder", "elbow"),
        1.0,
        "",
    ),
    "mjcf, double pendulum on a cart": (
        "model.xml",
        """<mujoco model="cartpole"><compiler inertiafromgeom="true" coordinate="local"/>
        <default><joint damping="0.05"/><geom contype="0" friction="1 0.1 0.1"/></default><worldbody>
        <body name="cart"><joint axis="1 0 0" limited="true" name="slider" range="-1 1" type="slide"/>
          <geom name="cart" size="0.1 0.1" type="capsule" quat="0.707 0 0.707 0"/>
          <body name="pole"><joint axis="0 1 0" name="hinge" type="hinge"/>
            <geom fromto="0 0 0 0 0 0.6" size="0.045" type="capsule"/>
            <body name="pole2" pos="0 0 0.6"><joint axis="0 1 0" name="hinge2" type="hinge"/>
              <geom fromto="0 0 0 0 0 0.6" size="0.045" type="capsule"/></body></body></body>
        </worldbody><actuator><motor joint="slider" gear="500"/></actuator></mujoco>""",
        ("hinge", "hinge2"),
        0.6,
        "joint 'slider' (slide) is treated as fixed at zero",
    ),
    "mjcf, arm with meshes, classes and inertials": (
        "model.xml",
        """<mujoco model="arm"><compiler angle="radian" meshdir="assets"/>
        <asset><mesh name="link1" file="huge.stl"/></asset>
        <default><default class="arm"><joint axis="0 1 0" armature="0.01" damping="0.1"/>
          <default class="visual"><geom type="mesh" contype="0" conaffinity="0" group="2"/></default></default>
        </default>
        <worldbody><body name="base" childclass="arm"><body name="link1" pos="0 0 0.3">
          <inertial pos="0 0 -0.1" mass="1" diaginertia="0.01 0.01 0.001"/><joint name="j1"/>
          <geom class="visual" mesh="link1"/>
          <body name="link2" pos="0 0 -0.25"><inertial pos="0 0 -0.1" mass="0.5" diaginertia="0.005 0.005 0.001"/>
            <joint name="j2"/><geom class="visual" mesh="link1"/></body></body></body></worldbody>
        <keyframe><key name="home" qpos="0 0"/></keyframe></mujoco>""",
        ("j1", "j2"),
        0.25,
        "meshes, not loaded: 2",
    ),
    "mjcf, pendulum with an equality constraint": (
        "model.xml",
        """<mujoco><worldbody><body name="a"><joint name="q1" axis="0 1 0"/>
        <inertial pos="0 0 -.1" mass="1" diaginertia=".01 .01 .01"/>
        <body name="b" pos="0 0 -.2"><joint name="q2" axis="0 1 0"/>
        <inertial pos="0 0 -.1" mass="1" diaginertia=".01 .01 .01"/></body></body></worldbody>
        <equality><joint joint1="q1" joint2="q2"/></equality></mujoco>""",
        ("q1", "q2"),
        0.2,
        "equality constraints (closed chains, couplings), not in the rig file: 1",
    ),
    "urdf, acrobot with transmissions on the world that its engine adds": (
        "model.urdf",
        f"""<?xml version="1.0"?><robot xmlns="https://a.org" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
        xsi:schemaLocation="https://a.org a.xsd" name="acrobot"><material name="red"><color rgba="1 0 0 1"/></material>
        <link name="base"><visual><geometry><box size="0.2 0.2 0.2"/></geometry></visual></link>{RODS}
        <joint name="weld" type="fixed"><parent link="world"/><child link="base"/></joint>
        {urdf_joint("shoulder", "base", "upper", 0.0)}{urdf_joint("elbow", "upper", "lower", -1.0)}
        <transmission name="elbow_trans" type="SimpleTransmission"><actuator name="elbow"/><joint name="elbow"/>
        <mechanicalReduction>1</mechanicalReduction></transmission></robot>""",
        ("shoulder", "elbow"),
        1.0,
        "",
    ),
    "urdf, double pendulum of a physics engine with gazebo tags": (
        "model.urdf",
        f"""<robot name="double_pendulum"><link name="world"/><link name="base"><visual><geometry>
        <mesh filename="package://meshes/base.dae"/></geometry></visual></link>{RODS}
        <joint name="fix" type="fixed"><parent link="world"/><child link="base"/></joint>
        {urdf_joint("joint1", "base", "upper", 0.0)}{urdf_joint("joint2", "upper", "lower", -1.0)}
        <gazebo reference="upper"><mu1>0.2</mu1></gazebo>
        <gazebo><plugin name="control" filename="libgazebo_ros_control.so"/></gazebo></robot>""",
        ("joint1", "joint2"),
        1.0,
        "plugins, not loaded: 1",
    ),
    "mjcf, rotary pendulum": (
        "model.xml",
        """<mujoco><worldbody><body name="arm"><joint name="yaw" axis="0 0 1"/>
        <inertial pos=".1 0 0" mass=".1" diaginertia="1e-3 1e-3 1e-3"/><body name="rod" pos=".2 0 0">
        <joint name="swing" axis="1 0 0"/><geom type="capsule" fromto="0 0 0 0 0 -.3" size=".004" mass=".1"/>
        </body></body></worldbody></mujoco>""",
        ("swing",),
        0.3,
        "",
    ),
}

REFUSED = {
    "mjcf, shared folder of a suite": (
        "model.xml",
        '<mujoco><include file="./common/skybox.xml"/><worldbody/></mujoco>',
        'common/skybox.xml">: there is no such file',
    ),
    "urdf, macros": (
        "model.urdf",
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="l" value="1"/></robot>',
        "holds macros of xacro|contains macros|xacro",
    ),
    "urdf, planar arm whose axes are vertical": (
        "model.urdf",
        f"""<robot name="rr"><link name="base"/>{RODS}{urdf_joint("q1", "base", "upper", 0.0, "0 0 1")}
        {urdf_joint("q2", "upper", "lower", -1.0, "0 0 1")}</robot>""",
        "gravity",
    ),
    "urdf, arm of seven joints": (
        "model.urdf",
        f'<robot name="seven"><link name="link0"/>{ARM_OF_SEVEN}</robot>',
        "7 hinges.*--joints INNER,OUTER",
    ),
    "sdf, models of another file": (
        "model.sdf",
        """<sdf version="1.6"><world name="w"><include><uri>model://double_pendulum</uri></include>
        <plugin name="p" filename="libp.so"/></world></sdf>""",
        "no hinge",
    ),
}


def test_there_are_twelve() -> None:
    assert len(READ) + len(REFUSED) == 12


@pytest.mark.parametrize(("name", "text", "joints", "length", "note"), READ.values(), ids=READ)
def test_a_model_is_read(
    tmp_path: Path, name: str, text: str, joints: tuple[str, ...], length: float, note: str
) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")
    chain = double_pendulum(read_model(tmp_path / name))
    assert tuple(rod.joint.name for rod in chain.rods) == joints
    assert chain.rods[0].length == pytest.approx(length)
    assert chain.rods[-1].mass > 0
    assert (chain.arm is None) == (len(joints) == 2)
    assert note in "; ".join(chain.notes)


@pytest.mark.parametrize(("name", "text", "reason"), REFUSED.values(), ids=REFUSED)
def test_a_model_is_refused_with_the_reason(tmp_path: Path, name: str, text: str, reason: str) -> None:
    if name.endswith("sdf"):
        pytest.importorskip("pydrake")
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=reason):
        double_pendulum(read_model(tmp_path / name))
