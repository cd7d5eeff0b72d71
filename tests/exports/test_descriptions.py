"""Corrected model as URDF and SDFormat: read by the parsers of the formats, and simulated by engines that read them."""

import json
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from urdf_parser_py.urdf import URDF

from dpr_lab.exports import FORMATS
from dpr_lab.exports.sdf import sdf
from dpr_lab.exports.urdf import urdf
from dpr_lab.rig import Rig
from tests.exports.models import X0, lab_states, model_of, typical

EFFECT_VALUES = {name: values for effect in ("coulomb_joint1", "base_tilt") for name, values in typical(effect).items()}


@pytest.fixture(scope="module")
def bent() -> dict:
    return EFFECT_VALUES | typical("com_offset_link2") | typical("stribeck_joint2") | typical("latency_joint2")


def test_urdf_is_read_by_its_parser(paper: Rig, bent: dict):
    robot = URDF.from_xml_string(urdf(model_of(paper, bent), paper, {}).encode("utf-8"))
    assert [joint.name for joint in robot.joints] == ["stand", "joint1", "joint2", "encoder2"]
    first, second = robot.joint_map["joint1"], robot.joint_map["joint2"]
    assert (first.type, first.axis, first.dynamics.friction) == ("continuous", [0.0, 1.0, 0.0], 1e-3)
    assert second.dynamics.damping == pytest.approx(paper.nominal[6])
    assert robot.link_map["outer"].inertial.origin.xyz == pytest.approx([2e-3, 0.0, paper.nominal[1]])
    assert robot.joint_map["stand"].origin.rpy == pytest.approx([0.0, 5e-3, 0.0])


def test_urdf_agrees_with_dpr_lab(paper: Rig, tmp_path: Path):
    """MuJoCo reads URDF too; gravity, dry friction and viscous friction are the simulator's to apply."""
    t = np.linspace(0, 2.0, 41)
    engine = mujoco.MjModel.from_xml_string(urdf(model_of(paper, typical("base_tilt")), paper, {}))
    engine.opt.integrator, engine.opt.timestep = mujoco.mjtIntegrator.mjINT_RK4, 5e-4
    data = mujoco.MjData(engine)
    data.qpos[:], states = [X0[0], X0[1] - X0[0]], []
    for _ in t:
        states.append([data.qpos[0], data.qpos.sum()])
        mujoco.mj_step(engine, data, 100)
    assert np.array(states) == pytest.approx(lab_states(paper, typical("base_tilt"), t, 2.5e-4)[:, :2], abs=1e-6)


def test_sdf_has_the_elements_of_its_specification(paper: Rig, bent: dict):
    """Names and places are those of the specification of 1.10."""
    bent = bent | {"spring_joint2": {"stiffness_Nm_per_rad": 2e-3, "constant_Nm": 1e-3}}
    root = ElementTree.fromstring(sdf(model_of(paper, bent), paper, {}))
    assert (root.tag, root.attrib) == ("sdf", {"version": "1.10"})
    world = root.find("world")
    pull = [float(number) for number in world.find("gravity").text.split()]
    assert pull == pytest.approx([9.81 * np.sin(5e-3), 0.0, -9.81 * np.cos(5e-3)])
    model = world.find("model")
    assert [part.tag for part in model] == ["link", "joint", "link", "joint"]
    first, second = model.findall("joint")
    assert (first.find("parent").text, first.find("child").text) == ("world", "inner")
    assert (second.find("parent").text, second.find("child").text) == ("inner", "outer")
    dynamics = {part.tag: float(part.text) for part in second.find("axis/dynamics")}
    assert dynamics == pytest.approx(
        {"damping": paper.nominal[6], "friction": 0.0, "spring_reference": 0.5, "spring_stiffness": 2e-3}
    )
    inertia = model.find("link/inertial")
    mass, up = float(inertia.find("mass").text), float(inertia.find("pose").text.split()[2])
    z = dict(zip(("l1", "l2", "m1", "m2", "mb", "c1", "c2", "J1", "J2"), paper.nominal, strict=True))
    assert mass == pytest.approx(z["m1"] + z["mb"])
    about = float(inertia.find("inertia/iyy").text) + mass * up**2
    assert about == pytest.approx(z["J1"] + z["m1"] * z["l1"] ** 2 + z["mb"] * paper.rig.L1**2)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["tilted", "bent and wound"])
def test_sdf_in_drake_agrees_with_dpr_lab(paper: Rig, case: str):
    """Drake reads SDFormat with the format's own library; gravity of the world and dry friction it leaves to others."""
    # Imported by name, or the type checker would read all of Drake's stubs.
    parsing, plants, analysis = (
        pytest.importorskip(f"pydrake.{module}", reason="Drake has no wheel for this computer")
        for module in ("multibody.parsing", "multibody.plant", "systems.analysis")
    )
    wound = {"spring_joint2": {"stiffness_Nm_per_rad": 2e-3, "constant_Nm": 1e-3}}
    effects = typical("base_tilt") if case == "tilted" else typical("com_offset_link2") | wound
    file, t = sdf(model_of(paper, effects), paper, {}), np.linspace(0, 2.0, 41)
    plant = plants.MultibodyPlant(0.0)
    parsing.Parser(plant).AddModelsFromString(file, "sdf")
    pull = ElementTree.fromstring(file).findtext("world/gravity")
    plant.mutable_gravity_field().set_gravity_vector([float(part) for part in pull.split()])
    plant.Finalize()
    engine = analysis.Simulator(plant)
    engine.get_mutable_integrator().set_target_accuracy(1e-9)
    context = plant.GetMyContextFromRoot(engine.get_mutable_context())
    plant.SetPositions(context, [X0[0], X0[1] - X0[0]])
    states = []
    for instant in t:
        engine.AdvanceTo(instant)
        angles = plant.GetPositions(context)
        states.append([angles[0], angles.sum()])
    assert np.array(states) == pytest.approx(lab_states(paper, effects, t, 2.5e-4)[:, :2], abs=1e-6)


@pytest.mark.parametrize("name", ["urdf", "sdf"])
def test_each_loss_is_listed_with_its_reason(paper: Rig, bent: dict, name: str):
    bent = bent | {"unheard_of --> <x/>": {"size": 1.0}}
    files = FORMATS[name].written(model_of(paper, bent), paper)
    lost = json.loads(files[f"{FORMATS[name].main}.lost.json"])["lost"]
    assert set(lost) == {"stribeck_joint2", "latency_joint2", "unheard_of --> <x/>"}
    assert "not encoder readings" in lost["latency_joint2"]
    root = ElementTree.fromstring(files[FORMATS[name].main])
    assert root.find("x") is None
    whole = FORMATS[name].written(model_of(paper, EFFECT_VALUES), paper)
    assert list(whole) == [FORMATS[name].main]
