"""Numbers in MJCF, URDF and SDFormat: an invalid number is refused with file, element and attribute."""

import re
from pathlib import Path

import pytest

from dpr_lab.errors import ConfigError
from dpr_lab.rig import load_rig
from dpr_lab.simulator_models import read_model
from dpr_lab.workflows.rig_from import rig_from_model

pytest.importorskip("mujoco")
JOINT = 'damping="0.01" frictionloss="0.02" armature="0.001" stiffness="0.3" springref="0.05" range="-3 3"'
MJCF = f"""<mujoco><compiler angle="radian"/><option gravity="0 0 -9.81"/><worldbody><body name="a" pos="0 0 1">
<joint name="s" axis="0 1 0" {JOINT}/><inertial pos="0 0 -.1" mass="0.3" diaginertia="0.002 0.003 0.001"/>
<body name="b" pos="0 0 -0.3"><joint name="e" axis="0 1 0"/>
<inertial pos="0 0 -.1" mass="0.2" diaginertia="0.002 0.002 0.001"/></body></body></worldbody></mujoco>"""
TENSOR = '<inertia ixx="0.002" iyy="0.003" izz="0.001" ixy="0" ixz="0" iyz="0"/>'
URDF = f"""<robot name="r"><link name="w"/>
<link name="a"><inertial><origin xyz="0 0 -0.1"/><mass value="0.3"/>{TENSOR}</inertial></link>
<link name="b"><inertial><origin xyz="0 0 -.1"/><mass value="0.2"/>{TENSOR}</inertial></link>
<joint name="s" type="revolute"><parent link="w"/><child link="a"/><axis xyz="0 1 0"/>
<dynamics damping="0.01" friction="0.02"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="e" type="continuous"><parent link="a"/><child link="b"/><origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/></joint>
</robot>"""
MOMENTS = "<inertia><ixx>0.002</ixx><iyy>0.003</iyy><izz>0.001</izz></inertia>"
DYNAMICS = (
    "<damping>0.01</damping><friction>0.02</friction><spring_stiffness>0.3</spring_stiffness>"
    "<spring_reference>0.05</spring_reference>"
)
SDF = f"""<sdf version="1.9"><world name="x"><gravity>0 0 -9.81</gravity><model name="m">
<link name="a"><pose>0 0 1 0 0 0</pose>
<inertial><pose>0 0 -0.1 0 0 0</pose><mass>0.3</mass>{MOMENTS}</inertial></link>
<link name="b"><pose>0 0 0.7 0 0 0</pose>
<inertial><pose>0 0 -.1 0 0 0</pose><mass>0.2</mass>{MOMENTS}</inertial></link>
<joint name="s" type="revolute"><parent>world</parent><child>a</child><axis><xyz>0 1 0</xyz>
<dynamics>{DYNAMICS}</dynamics>
<limit><lower>-3</lower><upper>3</upper></limit></axis></joint>
<joint name="e" type="revolute"><parent>a</parent><child>b</child><axis><xyz>0 1 0</xyz></axis></joint>
</model></world></sdf>"""
PLACES = [
    (MJCF, 'mass="0.3"', "<inertial> of body 'a': attribute mass"),
    (MJCF, 'diaginertia="0.002 0.003 0.001"', "<inertial> of body 'a': attribute diaginertia"),
    (MJCF, 'damping="0.01"', "<joint> 's': attribute damping"),
    (MJCF, 'frictionloss="0.02"', "<joint> 's': attribute frictionloss"),
    (MJCF, 'armature="0.001"', "<joint> 's': attribute armature"),
    (MJCF, 'springref="0.05"', "<joint> 's': attribute springref"),
    (MJCF, 'range="-3 3"', "<joint> 's': attribute range"),
    (MJCF, 'pos="0 0 -0.3"', "<body> 'b': attribute pos"),
    (MJCF, 'gravity="0 0 -9.81"', "<option>: attribute gravity"),
    (URDF, 'value="0.3"', "<mass> of link 'a': attribute value"),
    (URDF, 'iyy="0.003"', "<inertia> of link 'a': attribute iyy"),
    (URDF, 'damping="0.01"', "<dynamics> of joint 's': attribute damping"),
    (URDF, 'friction="0.02"', "<dynamics> of joint 's': attribute friction"),
    (URDF, 'lower="-3"', "<limit> of joint 's': attribute lower"),
    (URDF, 'xyz="0 0 -0.3"', "<origin> of joint 'e': attribute xyz"),
    (SDF, "<mass>0.3</mass>", "<inertial> of link 'a': element <mass>"),
    (SDF, "<iyy>0.003</iyy>", "<inertia> of link 'a': element <iyy>"),
    (SDF, "<damping>0.01</damping>", "<dynamics> of joint 's': element <damping>"),
    (SDF, "<friction>0.02</friction>", "<dynamics> of joint 's': element <friction>"),
    (SDF, "<spring_stiffness>0.3</spring_stiffness>", "<dynamics> of joint 's': element <spring_stiffness>"),
    (SDF, "<spring_reference>0.05</spring_reference>", "<dynamics> of joint 's': element <spring_reference>"),
    (SDF, "<upper>3</upper>", "<limit> of joint 's': element <upper>"),
    (SDF, "<gravity>0 0 -9.81</gravity>", "<world> 'x': element <gravity>"),
    (SDF, "<xyz>0 1 0</xyz>", "<axis> of joint 's': element <xyz>"),
]
"""File, a number in it, and the place that the message names."""


def read(folder: Path, text: str):
    (folder / "model.xml").write_text(text, encoding="utf-8")
    (folder / "rig.toml").unlink(missing_ok=True)
    if text.startswith("<sdf"):
        pytest.importorskip("pydrake", reason="Drake has no wheel for this computer")
    return rig_from_model(folder / "model.xml", folder / "rig.toml")


@pytest.mark.parametrize("bad", ["nan", "1,5", "", "heavy", "1_0", "1e999"])
@pytest.mark.parametrize(("text", "number", "place"), PLACES, ids=[place for *_, place in PLACES])
def test_an_invalid_number_is_refused_with_its_place(
    tmp_path: Path, text: str, number: str, place: str, bad: str
) -> None:
    assert text.count(number) >= 1
    wrong = re.sub(r'(?<=[">])[^"<>]+(?=["<])', bad, number, count=1)
    with pytest.raises(ConfigError) as refused:
        read(tmp_path, text.replace(number, wrong, 1))
    message = str(refused.value)
    assert message.startswith(f"{tmp_path / 'model.xml'}: {place}: ")
    assert ("is empty" if not bad else f"'{bad}' is not a finite number") in message
    assert not (tmp_path / "rig.toml").exists()


@pytest.mark.parametrize("text", [MJCF, URDF, SDF], ids=["MJCF", "URDF", "SDFormat"])
def test_the_numbers_of_a_joint_are_read(tmp_path: Path, text: str) -> None:
    imported = read(tmp_path, text)
    assert load_rig(tmp_path / "rig.toml").parameters["c1"].nominal == pytest.approx(0.01)
    wanted = {"Coulomb friction": 0.02}
    if text != URDF:  # which has no springs
        wanted |= {"spring stiffness": 0.3, "joint angle with the spring relaxed": 0.05}
    if text == MJCF:
        wanted |= {"rotor inertia (armature)": 0.001}
    assert {term.quantity: term.value for term in imported.terms} == pytest.approx(wanted)
    assert {term.joint for term in imported.terms} == {"s"}


def test_a_joint_of_sdformat_may_have_no_stop_and_a_pose_may_be_empty(tmp_path: Path) -> None:
    text = SDF.replace("<lower>-3</lower><upper>3</upper>", "<lower>-inf</lower><upper>inf</upper>")
    imported = read(tmp_path, text.replace("<parent>world", "<pose/><parent>world"))
    assert not any("stops at" in note for note in imported.notes)


def test_a_file_that_crashes_drake_is_refused_with_a_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"the library of SDFormat cannot read it: .*stiffness"):
        read(tmp_path, SDF.replace("<spring_stiffness>0.3", "<spring_stiffness>-1"))


def test_masses_from_shapes_are_read_and_masses_from_meshes_are_not(tmp_path: Path) -> None:
    pytest.importorskip("pydrake")
    box = "<box><size>.1 .1 .2</size></box>"
    shape = f"<collision name='c'><pose>0 0 -.1 0 0 0</pose><geometry>{box}</geometry></collision>"
    text = f"""<sdf version="1.11"><model name="m"><link name="a"><inertial auto="true"/>{shape}</link>
      <joint name="s" type="revolute"><parent>world</parent><child>a</child><axis><xyz>0 1 0</xyz></axis></joint>
    </model></sdf>"""
    file = tmp_path / "model.sdf"
    file.write_text(text, encoding="utf-8")
    part = read_model(file).parts[0]
    assert part.mass == pytest.approx(2.0)  # of water
    assert part.centroid == pytest.approx([0, 0, -0.1])
    file.write_text(text.replace(box, "<mesh><uri>a.dae</uri></mesh>"), encoding="utf-8")
    with pytest.raises(ConfigError, match="mass of link 'a' is defined by a mesh"):
        read_model(file)
