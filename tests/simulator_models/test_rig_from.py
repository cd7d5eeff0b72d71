"""Rig file from a simulator model: values of the model, and messages for models that are not a double pendulum."""

import math
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.exports import FORMATS
from dpr_lab.rig import Rig, load_rig
from dpr_lab.simulator_models import read_model
from dpr_lab.workflows.rig_file import check_rig
from dpr_lab.workflows.rig_from import rig_from_model
from tests.exports.models import model_of, typical

pytest.importorskip("mujoco")
INNER = 'pos="0 0 .1" mass=".2" diaginertia="1e-3 2e-3 1.5e-3"'
OUTER = 'pos="0 0 -.07" mass=".1" diaginertia="3e-4 4e-4 2e-4"'


def two_hinges(
    *, first: str = "", second: str = "", arm: str = "", more: str = "", inside: str = "", axis: str = "0 1 0"
) -> str:
    """Model with inner rod upright and outer rod hanging at zero, which is unusual."""
    b = f'<body name="b" pos="0 0 .25"><joint name="elbow" axis="{axis}" {second}/><inertial {OUTER}/>{inside}</body>'
    rods = f'<body name="a" pos="0 -.2 0"><joint name="shoulder" axis="0 1 0" {first}/><inertial {INNER}/>{b}</body>'
    weight = '<inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/>'
    world = f'<body name="c"><joint name="yaw" {arm}/>{weight}{rods}</body>'
    return f'<mujoco model="own"><worldbody>{world if arm else rods}</worldbody>{more}</mujoco>'


def written(folder: Path, text: str, name: str = "model.xml", **options):
    (folder / name).write_text(text, encoding="utf-8")
    (folder / "rig.toml").unlink(missing_ok=True)
    return rig_from_model(folder / name, folder / "rig.toml", **options), load_rig(folder / "rig.toml")


def base(z: dict[str, float], L1: float, g: float) -> list[float]:
    """a, b, d, e1, e2 of docs/theory.md, c1 and c2, computed separately."""
    tip = z["m2"] + z["mb"]
    return [
        z["J1"] + z["m1"] * z["l1"] ** 2 + tip * L1**2,
        z["J2"] + z["m2"] * z["l2"] ** 2,
        z["m2"] * z["l2"] * L1,
        g * (z["m1"] * z["l1"] + tip * L1),
        g * z["m2"] * z["l2"],
        z["c1"],
        z["c2"],
    ]


@pytest.mark.parametrize("form", ["mjcf", "urdf", "sdf"])
def test_an_exported_model_comes_back_with_its_numbers(paper: Rig, tmp_path: Path, form: str) -> None:
    if form == "sdf":
        pytest.importorskip("pydrake", reason="Drake has no wheel for this computer")
    effects = typical("coulomb_joint1") | typical("rotor_inertia_joint2") | typical("com_offset_link1")
    text = FORMATS[form].written(model_of(paper, effects), paper)[FORMATS[form].main]
    assert isinstance(text, str)
    read, rig = written(tmp_path, text, FORMATS[form].main)
    given = {name: p.nominal for name, p in paper.parameters.items()}
    numbers = {name: p.nominal for name, p in rig.parameters.items()}
    assert base(numbers, rig.L1, rig.g) == pytest.approx(base(given, paper.L1, paper.g), rel=2e-5)
    if form != "sdf":  # there the encoder of joint 2 is part of the inner rod
        assert numbers == pytest.approx(given, rel=1e-6)
        assert rig.L2 == pytest.approx(paper.L2 or 2 * given["l2"])
    terms = {term.quantity: term.value for term in read.terms}
    assert terms["Coulomb friction"] == pytest.approx(1e-3)
    assert ("rotor inertia (armature)" in terms) == (form == "mjcf")
    assert list(rig.encoders.zero_counts) == [0, 8192, 0]
    assert not [finding for finding in check_rig(tmp_path / "rig.toml") if finding.state != "missing"]


def test_numbers_zeros_and_signs_of_a_hand_written_model(tmp_path: Path) -> None:
    more = '<option gravity="0 0 -9.7"/><actuator><motor name="m" joint="elbow" gear="30"/></actuator>'
    second = 'damping=".02" frictionloss=".03" armature=".004" stiffness=".5" springref="20" range="-90 90"'
    inside = '<geom type="capsule" fromto="0 0 0 0 0 -.15" size=".01" mass="0"/>'
    text = two_hinges(second=second, more=more, inside=inside, axis="0 -1 0")
    read, rig = written(tmp_path, text)
    z = {name: p.nominal for name, p in rig.parameters.items()}
    wanted = {"l1": 0.1, "l2": 0.07, "m1": 0.2, "m2": 0.1, "J1": 2e-3, "J2": 4e-4, "c2": 0.02}
    assert {name: z[name] for name in wanted} == pytest.approx(wanted)
    assert (rig.L1, rig.L2, rig.g) == pytest.approx((0.25, 0.15, 9.7))
    assert rig.joints.geared == (2,)
    # theta1 = q1; the outer rod hangs at zero while the inner one is upright, and its joint turns the other way.
    q = np.array([[0.0, 0.0], [math.pi, math.pi], [0.3, 0.1]])
    counts = np.column_stack([np.zeros(3), q]) * 16384 / (2 * math.pi)
    turns = (rig.theta(counts)[:, 1:] - np.column_stack([q[:, 0], q[:, 0] + math.pi - q[:, 1]])) / (2 * math.pi)
    assert turns == pytest.approx(np.round(turns), abs=1e-9)
    reversed_joints = [note for note in read.notes if "turns opposite to the angle of dpr-lab" in note]
    assert [note.split("'")[1] for note in reversed_joints] == [read.joints[1]]
    terms = {term.quantity: term.value for term in read.terms}
    assert terms == pytest.approx(
        {
            "Coulomb friction": 0.03,
            "rotor inertia (armature)": 0.004,
            "spring stiffness": 0.5,
            "joint angle with the spring relaxed": math.radians(20),
        }
    )
    assert any("gear 30" in note for note in read.notes)
    assert any("stops at -1.5708 and 1.5708 rad" in note for note in read.notes)
    assert "c1 (viscous friction of joint 1, N m s/rad) is 0 in the model, but must be positive" in (
        tmp_path / "rig.toml"
    ).read_text(encoding="utf-8")


def test_an_arm_is_found_with_its_motor(tmp_path: Path) -> None:
    more = '<actuator><motor name="m" joint="yaw" gear="5"/></actuator>'
    read, rig = written(tmp_path, two_hinges(arm='axis="0 0 -1" damping=".1"', more=more))
    assert read.joints == ("shoulder", "elbow", "yaw")
    assert (rig.L0, rig.arm.mode, rig.encoders.direction) == (pytest.approx(0.2), "driven", (-1, 1, 1))
    assert rig.motor is not None
    assert (rig.motor.input, rig.motor.gear) == ("torque", 5.0)
    assert rig.arm.A is not None
    assert rig.arm.A.nominal == pytest.approx(0.01 + (0.3 + 1e-6) * 0.2**2)


def test_named_joints_and_what_is_held(tmp_path: Path) -> None:
    weight = '<inertial pos="0 0 0" mass=".05" diaginertia="1e-5 1e-5 1e-5"/>'
    hand = f'<body pos="0 0 -.1"><joint name="wrist" axis="1 0 0"/>{weight}</body>'
    text = two_hinges(inside=hand, axis="0.05 1 0")
    read, rig = written(tmp_path, text, joints=("shoulder", "elbow"))
    assert rig.parameters["m2"].nominal == pytest.approx(0.15)
    assert any("'wrist'" in note and "0.05 kg" in note for note in read.notes)
    assert any("2.86 degrees away" in note for note in read.notes)


def test_masses_do_not_come_from_meshes_and_plugins_are_listed(tmp_path: Path) -> None:
    mesh = '<asset><mesh name="big" file="/nowhere/big.stl"/></asset>'
    plugins = '<extension><plugin plugin="own.evil"/></extension>'
    geom = '<geom type="mesh" mesh="big"/>'
    read, _ = written(tmp_path, two_hinges(more=mesh + plugins, inside=geom))
    assert {"plugins, not loaded: 1", "meshes, not loaded: 1"} <= set(read.notes)
    bare = two_hinges(more=mesh, inside=geom).replace(f"<inertial {OUTER}/>", "")
    with pytest.raises(ConfigError, match="mass of body 'b' is defined by the mesh 'big'"):
        written(tmp_path, bare)


def test_an_include_inside_the_folder_is_read(tmp_path: Path) -> None:
    (tmp_path / "option.xml").write_text('<mujoco><option gravity="0 0 -5"/></mujoco>', encoding="utf-8")
    _, rig = written(tmp_path, two_hinges(more='<include file="option.xml"/>'))
    assert rig.g == 5.0


def test_what_the_file_switches_off_is_zero_and_listed(tmp_path: Path) -> None:
    flag = '<option><flag damper="disable" spring="disable" frictionloss="disable" limit="disable"/></option>'
    second = 'damping=".02" frictionloss=".03" stiffness=".5" range="-90 90" limited="true"'
    text = two_hinges(second=second, more=flag).replace('<body name="b"', '<body name="b" gravcomp="0.5"')
    read, _ = written(tmp_path, text)
    assert read.nominal["c2"] == 0
    assert not read.terms
    off = [note.removeprefix("joint 'elbow': ") for note in read.notes if "switched off" in note]
    assert off == [
        f"{key}, switched off by a <flag> of the file: {value}"
        for key, value in (("damping", "0.02"), ("frictionloss", "0.03"), ("stiffness", "0.5"))
    ]
    assert "body 'b': gravcomp 0.5, the share of its weight that is compensated" in read.notes
    assert not any("stops" in note for note in read.notes)


def test_point_masses_keep_their_mass_matrix(tmp_path: Path) -> None:
    link = '<inertial><origin xyz="0 0 -1"/><mass value="1"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>'
    links = "".join(f'<link name="{name}">{link}</inertial></link>' for name in ("a", "b"))
    joints = "".join(
        f'<joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 {z}"/><axis xyz="0 1 0"/></joint>'
        for name, parent, child, z in (("s", "world", "a", 0), ("e", "a", "b", -1))
    )
    read, rig = written(tmp_path, f'<robot name="points">{links}{joints}</robot>', "points.urdf")
    assert any(
        note.startswith("J1 (inertia of the inner rod about its centre of mass, kg m^2) is 0") for note in read.notes
    )
    z = {name: p.nominal for name, p in rig.parameters.items()}
    assert base(z, rig.L1, rig.g)[:5] == pytest.approx([2.0, 1.0, 1.0, 2 * 9.81, 9.81], rel=1e-5)


def test_the_radius_of_the_arm_does_not_depend_on_the_angles_of_the_rods(tmp_path: Path) -> None:
    raised = two_hinges(arm='axis="0 0 1"').replace(
        '<body name="a" pos="0 -.2 0"', '<body name="a" pos="0 -.2 0" euler="0 70 0"'
    )
    read, rig = written(tmp_path, raised)
    assert rig.L0 == pytest.approx(0.2)
    assert not any("radius of the arm" in note or "apart" in note for note in read.notes)
    aside = (
        two_hinges(arm='axis="0 0 1"')
        .replace('pos="0 -.2 0"', 'pos=".01 -.2 0"')
        .replace('pos="0 0 .25"', 'pos="0 -.02 .25"')
    )
    notes = written(tmp_path, aside)[0].notes
    assert "the axis of the rods passes that of the arm at 10 mm: treated as zero" in notes
    assert "along the arm, the rods are 20 mm apart: L0 is the distance of their common centre of mass" in notes


ROBOT = "".join(f'<link name="{name}"/>' for name in "ab")

BAD = {
    "one hinge": (two_hinges().replace("elbow", "e").replace('<joint name="e" axis="0 1 0" />', ""), "only one hinge"),
    "no hinge": ("<mujoco><worldbody><body><geom size='1'/></body></worldbody></mujoco>", "has no hinge"),
    "four hinges": (
        two_hinges(
            arm='axis="0 0 1"',
            inside='<body><joint name="w"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>',
        ),
        "has 4 hinges, 'yaw', 'shoulder', 'elbow', 'w'",
    ),
    "axes": (two_hinges(axis="1 1 0"), "45 degrees away"),
    "outside": (two_hinges(more='<include file="/etc/passwd"/>'), "is outside the folder"),
    "above": (two_hinges(more='<include file="../x.xml"/>'), "is outside the folder"),
    "circle": (two_hinges(more='<include file="model.xml"/>'), "includes itself"),
    "not there": (two_hinges(more='<include file="gone.xml"/>'), "there is no such file"),
    "laughs": ('<!DOCTYPE m [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]><mujoco>&b;</mujoco>', "document type or entities"),
    "outer file": ('<!DOCTYPE m SYSTEM "file:///etc/passwd"><mujoco/>', "document type or entities"),
    "not xml": ("joint = 3", "not well-formed"),
    "deep": ("<mujoco>" + "<body>" * 5000 + "</body>" * 5000 + "</mujoco>", "deep"),
    "other": ("<scene/>", "root element is <scene>"),
    "macro": (
        two_hinges(inside='<replicate count="1000000"><geom size="1"/></replicate>'),
        "<replicate> is not expanded",
    ),
    "no engine": ("<mujoco><worldbody><nonsense/></worldbody></mujoco>", "MuJoCo cannot read it"),
    "weightless": (two_hinges(more='<option gravity="0 0 0"/>'), "has no gravity"),
    "flat": (two_hinges(more='<option gravity="0 -9.81 0"/>'), "gravity across the axis"),
    "xacro": ('<robot xmlns:xacro="http://x"><xacro:macro name="a"/></robot>', "macros of xacro"),
    "circular robot": (
        '<robot name="r"><link name="a"/><link name="b"/>'
        '<joint name="j" type="fixed"><parent link="a"/><child link="b"/></joint>'
        '<joint name="k" type="fixed"><parent link="b"/><child link="a"/></joint></robot>',
        "joints form a loop: no link is without a parent",
    ),
    "robot of equal links": (f'<robot name="r">{ROBOT}<link name="a"/></robot>', "2 links are named 'a'"),
    "robot without a link": (
        f'<robot name="r">{ROBOT}<joint name="j" type="fixed"><parent link="a"/><child link="c"/></joint></robot>',
        "joint 'j': its child 'c' is no link of the file",
    ),
    "substitution": (
        f'<robot name="r">{ROBOT}<joint name="j" type="fixed"><origin xyz="0 0 ${{h}}"/></joint></robot>',
        "macros of xacro",
    ),
    "include of nothing": (two_hinges(more="<include/>"), "<include> has no attribute file"),
    "gravity switched off": (two_hinges(more='<option><flag gravity="disable"/></option>'), "has no gravity"),
    "half a robot": (
        '<robot name="r"><link name="a"><inertial><mass/></inertial></link></robot>',
        "valid URDF",
    ),
    "bare sdf": (
        '<sdf version="1.10"><include><uri>model://x</uri></include></sdf>',
        "library of SDFormat|no hinge|needs Drake",
    ),
}


@pytest.mark.parametrize(("text", "message"), BAD.values(), ids=BAD)
def test_a_model_that_is_not_a_double_pendulum_is_refused_with_a_sentence(
    tmp_path: Path, text: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=message):
        written(tmp_path, text)
    assert not (tmp_path / "rig.toml").exists()


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (("elbow", "shoulder"), "give the inner joint first"),
        (("shoulder",), "takes two or three joint names"),
        (("shoulder", "knee"), "no hinge is named 'knee'; hinges of the model: 'shoulder', 'elbow'"),
    ],
)
def test_names_that_do_not_fit(tmp_path: Path, names: tuple[str, ...], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        written(tmp_path, two_hinges(), joints=names)


def test_a_link_to_another_folder_is_not_followed(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "secret.xml").write_text("<mujoco/>", encoding="utf-8")
    (inner / "link.xml").symlink_to(tmp_path / "secret.xml")
    with pytest.raises(ConfigError, match="is outside the folder"):
        written(inner, two_hinges(more='<include file="link.xml"/>'))


def test_a_file_too_large_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "model.xml").write_text("<mujoco>" + " " * 6_000_000 + "</mujoco>", encoding="utf-8")
    with pytest.raises(ConfigError, match="larger than 5 MB"):
        read_model(tmp_path / "model.xml")
