"""Models in the styles of public repositories: each is read, or refused with the exact reason."""

import math
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.simulator_models import read_model
from dpr_lab.simulator_models.chain import ModelChain
from dpr_lab.simulator_models.double_pendulum import double_pendulum
from dpr_lab.simulator_models.mjcf import compile_mjcf
from dpr_lab.simulator_models.tree import Vector

mujoco: ModuleType = pytest.importorskip("mujoco")
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
    "mjcf, frames, nested classes, radian ranges, inertia tensors": (
        "model.xml",
        """<mujoco><compiler angle="radian" autolimits="true"/><default><default class="arm">
        <joint axis="0 1 0" armature="0.002" frictionloss="0.01"/><default class="visual">
        <geom type="mesh" density="0" group="2"/></default></default></default><worldbody>
        <frame pos="0 0 1" euler="0 0 .4"><body name="l1" childclass="arm"><joint name="j1" range="-300 300"/>
          <inertial pos=".003 0 -.11" mass=".8" fullinertia=".01 .011 .002 0 1e-4 0"/>
          <frame pos="0 .03 -.24" euler="0 .1 0"><geom class="visual" mesh="skin"/><body name="l2"><joint name="j2"/>
            <inertial pos="0 0 -.09" mass=".4" diaginertia=".004 .004 .0005"/></body></frame></body></frame>
        </worldbody></mujoco>""",
        ("j1", "j2"),
        0.24,
        "meshes, not loaded: 1",
    ),
    "mjcf, degrees in another order of angles, joints off the origins of bodies": (
        "model.xml",
        """<mujoco><compiler angle="degree" eulerseq="ZYX"/><worldbody><body pos="0 0 2" euler="25 0 0">
        <joint name="pin" axis="0 -1 0" pos="0 0 .5" ref="30"/><geom type="cylinder" size=".05 .5" mass="1"/>
        <body pos="0 .1 -.5" euler="0 30 0"><joint name="pin2" axis="0 -1 0"/>
          <geom type="cylinder" size=".05 .5" pos="0 0 -.5" mass=".5"/></body></body></worldbody></mujoco>""",
        ("pin", "pin2"),
        1.0,
        "",
    ),
    "mjcf, free base, meshes without mass by their group": (
        "model.xml",
        """<mujoco><compiler inertiafromgeom="true" inertiagrouprange="0 1"/><worldbody>
        <body name="base"><freejoint name="root"/><geom type="box" size=".2 .2 .1"/><body name="u" pos="0 .3 0">
          <joint name="q1" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 0 0 -.5"/>
          <geom type="mesh" mesh="skin" group="2"/><body name="l" pos="0 0 -.5"><joint name="q2" axis="0 1 0"/>
            <geom type="capsule" size=".02" fromto="0 0 0 0 0 -.4"/></body></body></body></worldbody></mujoco>""",
        ("q1", "q2"),
        0.5,
        "meshes, not loaded: 1; joint 'root' (free) is treated as fixed at zero",
    ),
    "urdf, joint that follows another one": (
        "model.urdf",
        f'<robot name="m"><link name="world"/>{RODS}{urdf_joint("q1", "world", "upper", 0.0)}'
        + urdf_joint("q2", "upper", "lower", -1.0).replace("<dynamics", '<mimic joint="q1" multiplier="2"/><dynamics')
        + "</robot>",
        ("q1", "q2"),
        1.0,
        "joint 'q2': follows another joint (mimic), which is not in the rig file: 2 x 'q1'",
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
    "mjcf, mass of a mesh within a frame": (
        "model.xml",
        """<mujoco><worldbody><body name="a"><joint name="q1" axis="0 1 0"/><geom size=".01" pos="0 0 -.1"/>
        <frame pos="0 0 -.1"><geom type="mesh" mesh="rod"/></frame><body pos="0 0 -.2"><joint name="q2" axis="0 1 0"/>
        <geom size=".01" pos="0 0 -.1"/></body></body></worldbody></mujoco>""",
        "the mass of body 'a' is defined by the mesh 'rod'",
    ),
    "urdf, planar joint": (
        "model.urdf",
        f'<robot name="p"><link name="base"/>{RODS}{urdf_joint("q1", "base", "upper", 0.0, kind="planar")}'
        f"{urdf_joint('q2', 'upper', 'lower', -1.0)}</robot>",
        "only one hinge, 'q2' \\(joints of other kinds: planar\\)",
    ),
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
        r"the axis is \(0, 0, 1\), and gravity \(0, 0, -9.81\)",
    ),
    "mjcf, rotary pendulum with the backlash of its servo as a hinge": (
        "model.xml",
        """<mujoco><worldbody><body><joint name="motor" axis="0 0 1" armature=".002"/><geom size=".01"/>
        <body><joint name="backlash" axis="0 0 1" range="-.3 .3"/><geom size=".01" pos=".05 0 0"/><body pos=".1 0 0">
        <joint name="pend" axis="1 0 0"/><geom type="capsule" fromto="0 0 0 0 0 .12" size=".002"/></body></body></body>
        </worldbody></mujoco>""",
        "three hinges, 'motor', 'backlash', 'pend'.*ROD,ARM; the other joints are fixed",
    ),
    "mjcf, pendulum that swings along its arm": (
        "model.xml",
        """<mujoco><worldbody><body><joint name="arm" axis="0 0 1"/><geom size=".02" pos="0 .1 0"/><body pos="0 .18 0">
        <joint name="rod" axis="1 0 0"/><geom type="capsule" fromto="0 0 0 0 0 -.15" size=".01"/></body></body>
        </worldbody></mujoco>""",
        "must point along the arm, but it passes the axis of 'arm' at 180 mm",
    ),
    "mjcf, two hinges in one body": (
        "model.xml",
        """<mujoco><worldbody><body name="a"><joint name="q1" axis="0 1 0"/>
        <joint name="q2" axis="0 1 0" pos="0 0 -.1"/><geom size=".02" pos="0 0 -.25"/></body></worldbody></mujoco>""",
        "joint 'q1' moves no mass: 'a'",
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


def of_lab(chain: ModelChain, q: Vector, v: Vector) -> tuple[Vector, Vector]:
    """(2, 2) mass matrix with rotors and (2,) bias torques in the joints of the model (docs/theory.md)."""
    inner, outer = chain.rods
    z, length = chain.parameters, inner.length or math.nan
    a = z["J1"] + z["m1"] * math.hypot(z["l1"], inner.offset) ** 2 + (z["mb"] + z["m2"]) * length**2
    d, b = z["m2"] * z["l2"] * length, z["J2"] + z["m2"] * z["l2"] ** 2
    e1, e2 = z["m1"] * z["l1"] + (z["mb"] + z["m2"]) * length, z["m2"] * z["l2"]
    turn = np.array([[inner.direction, 0.0], [inner.direction, outer.direction]])
    theta = math.pi + turn @ (q - [inner.hanging, outer.hanging])
    omega, sine = turn @ v, math.sin(theta[0] - theta[1])
    mixed = d * math.cos(theta[0] - theta[1])
    side = z["m1"] * inner.offset * math.cos(theta[0])
    bias = [
        d * sine * omega[1] ** 2 - chain.gravity * (e1 * math.sin(theta[0]) + side),
        -d * sine * omega[0] ** 2 - chain.gravity * e2 * math.sin(theta[1]),
    ]
    rotors = np.diag([rod.joint.armature for rod in chain.rods])
    return turn.T @ np.array([[a, mixed], [mixed, b]]) @ turn + rotors, turn.T @ bias


@pytest.mark.parametrize("style", [style for style, (*_, joints, _, _) in READ.items() if len(joints) == 2])
def test_mass_matrix_and_torques_are_those_of_mujoco(tmp_path: Path, style: str) -> None:
    name, text, joints, *_ = READ[style]
    path = tmp_path / name
    urdf = path.suffix == ".urdf"
    if urdf:
        text = re.sub("<(visual|collision)>.*?</(visual|collision)>", "", text, flags=re.DOTALL)
        text = text if '<link name="world"' in text else text.replace("<link ", '<link name="world"/><link ', 1)
    path.write_text(text, encoding="utf-8")
    model = mujoco.MjModel.from_xml_path(str(path)) if urdf else compile_mjcf(path).model
    model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    data, rng = mujoco.MjData(model), np.random.default_rng(29)
    scalar = [int(model.jnt_qposadr[j]) for j in range(model.njnt) if model.jnt_type[j] in (2, 3)]
    places = [(int(model.joint(joint).qposadr[0]), int(model.joint(joint).dofadr[0])) for joint in joints]
    positions, freedoms = (list(column) for column in zip(*places, strict=True))
    chain = double_pendulum(read_model(path))
    for _ in range(3):
        q, v = rng.uniform(-3, 3, 2), rng.uniform(-4, 4, 2)
        data.qpos[scalar] = 0.0
        data.qpos[positions], data.qvel[freedoms] = q, v
        mujoco.mj_forward(model, data)
        columns = np.zeros((model.nv, model.nv))
        for freedom, unit in enumerate(np.eye(model.nv)):
            mujoco.mj_mulM(model, data, columns[freedom], unit)
        mass, bias = of_lab(chain, q, v)
        assert mass == pytest.approx(columns[np.ix_(freedoms, freedoms)], rel=1e-9)
        assert bias == pytest.approx(data.qfrc_bias[freedoms], rel=1e-9, abs=1e-9)


def test_rotors_of_drake_are_read(tmp_path: Path) -> None:
    """The inertia at the joint is that of the rotor times the squared gear ratio."""
    rotor = '<drake:rotor_inertia value="1e-4"/><drake:gear_ratio value="10"/>'
    moving = urdf_joint("q1", "base", "upper", 0.0) + urdf_joint("q2", "upper", "lower", -1.0)
    (tmp_path / "model.urdf").write_text(
        f'<robot name="a" xmlns:drake="http://drake.mit.edu"><link name="base"/>{RODS}{moving}'
        f'<transmission name="t"><joint name="q2"/><actuator name="m">{rotor}</actuator></transmission></robot>',
        encoding="utf-8",
    )
    chain = double_pendulum(read_model(tmp_path / "model.urdf"))
    assert [rod.joint.armature for rod in chain.rods] == pytest.approx([0.0, 0.01])


MIMICS = {
    "of its axis": "<axis>{}<mimic joint='q1'><multiplier>2</multiplier><offset>0.5</offset></mimic></axis>",
    "of Drake": "<axis>{}</axis><drake:mimic joint='q1' multiplier='2' offset='0.5'/>",
}


@pytest.mark.parametrize("mimic", MIMICS.values(), ids=MIMICS)
def test_a_joint_of_sdformat_that_follows_another_one_is_listed(tmp_path: Path, mimic: str) -> None:
    pytest.importorskip("pydrake")
    inertial = "<inertial><pose>0 0 -.1 0 0 0</pose><mass>1</mass></inertial>"
    axis = "<xyz>0 1 0</xyz>"
    (tmp_path / "model.sdf").write_text(
        f"""<sdf version="1.11" xmlns:drake="http://drake.mit.edu"><model name="m">
        <link name="u">{inertial}</link><link name="l"><pose>0 0 -.3 0 0 0</pose>{inertial}</link>
        <joint name="q1" type="revolute"><parent>world</parent><child>u</child><axis>{axis}</axis></joint>
        <joint name="q2" type="revolute"><parent>u</parent><child>l</child>{mimic.format(axis)}</joint></model>
        </sdf>""",
        encoding="utf-8",
    )
    notes = double_pendulum(read_model(tmp_path / "model.sdf")).notes
    assert any("'q2': follows another joint" in note and "2 x 'q1' + 0.5" in note for note in notes)


def test_rotors_of_drake_are_read_from_sdformat(tmp_path: Path) -> None:
    pytest.importorskip("pydrake")
    inertia = "<inertial><pose>0 0 -.1 0 0 0</pose><mass>1</mass></inertial>"
    rotor = "<drake:rotor_inertia>1e-4</drake:rotor_inertia><drake:gear_ratio>10</drake:gear_ratio>"
    axis = "<axis><xyz>0 1 0</xyz><limit><effort>1</effort></limit></axis>"
    links = "".join(f'<link name="{n}"><pose>0 0 {z} 0 0 0</pose>{inertia}</link>' for n, z in (("u", 0), ("l", -0.3)))
    ends = ("world", "u", ""), ("u", "l", rotor)
    joints = "".join(
        f'<joint name="to_{child}" type="revolute"><parent>{parent}</parent><child>{child}</child>{axis}{more}</joint>'
        for parent, child, more in ends
    )
    (tmp_path / "model.sdf").write_text(
        f'<sdf version="1.9" xmlns:drake="http://drake.mit.edu"><model name="m">{links}{joints}</model></sdf>',
        encoding="utf-8",
    )
    chain = double_pendulum(read_model(tmp_path / "model.sdf"))
    assert [rod.joint.armature for rod in chain.rods] == pytest.approx([0.0, 0.01])


@pytest.mark.parametrize(("name", "text", "reason"), REFUSED.values(), ids=REFUSED)
def test_a_model_is_refused_with_the_reason(tmp_path: Path, name: str, text: str, reason: str) -> None:
    if name.endswith("sdf"):
        pytest.importorskip("pydrake")
    (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(ConfigError, match=reason):
        double_pendulum(read_model(tmp_path / name))
