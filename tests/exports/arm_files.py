"""A driven arm with one or two rods in three formats, and the model that a perfect identification of it gives."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters
from dpr_lab.dynamics.moving_arm.swing import SWING_PARAMETERS
from dpr_lab.identification.model import EstimatedValue, RigFacts
from dpr_lab.identification.moving_arm.model import MovingArmModel
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from dpr_lab.workflows.rig_from import rig_from_model

mujoco = pytest.importorskip("mujoco")

NUMBERS = {
    "arm_damping": "0.02", "arm_inertia": "0.008", "arm_length": "0.2", "rod_damping": "0.002", "rod_centroid": "0.12",
    "rod_inertia": "0.0021", "elbow_damping": "0.001", "tip_centroid": "0.125", "tip_inertia": "0.0008",
    "arm_more": "",
    "gear": "2",
}  # fmt: skip
"""Values in the file, SI units."""

MJCF_ROD = """<body name="lower" pos="0 0 -0.3"><joint name="elbow" axis="0 -1 0" damping="{elbow_damping}"/>
      <inertial pos="0 0 -{tip_centroid}" mass="0.15" diaginertia="{tip_inertia} {tip_inertia} 1e-9"/></body>
      <body name="encoder" pos="0 0 -0.3"><inertial pos="0 0 0" mass="0.08" diaginertia="1e-9 1e-9 1e-9"/></body>"""
MJCF = """<mujoco model="own">
  <!-- drawn > weighed: "keep" me -->
  <option gravity="0 0 -9.81" timestep="0.00025" integrator="RK4"/>
  <worldbody><body name="carrier" pos="0 0 1">
    <joint name="yaw" axis="0 0 -1" damping="{arm_damping}" {arm_more}/>
    <inertial pos="0 0 0" mass="0.5" diaginertia="0.007 0.007 {arm_inertia}"/>
    <body name="upper" pos="0 {arm_length} 0"><joint name="shoulder" axis="0 1 0" damping="{rod_damping}"/>
      <inertial pos="0 0 -{rod_centroid}" mass="0.3" diaginertia="{rod_inertia} {rod_inertia} 1e-9"/>{second}</body>
  </body></worldbody>
  <actuator><motor name="servo" joint="yaw" gear="{gear}"/></actuator>
</mujoco>
"""

_LINK = """
  <link name="{name}"><inertial><origin xyz="{place}"/><mass value="{mass}"/>
    <inertia ixx="{across}" ixy="0" ixz="0" iyy="{across}" iyz="0" izz="{along}"/></inertial></link>"""
_JOINT = """
  <joint name="{name}" type="continuous"><parent link="{parent}"/><child link="{child}"/><origin xyz="{place}"/>
    <axis xyz="{axis}"/><dynamics damping="{damping}"/></joint>"""
URDF_ROD = (
    _LINK.format(name="lower", place="0 0 -{tip_centroid}", mass="0.15", across="{tip_inertia}", along="1e-9")
    + _JOINT.format(
        name="elbow", parent="upper", child="lower", place="0 0 -0.3", axis="0 -1 0", damping="{elbow_damping}"
    )
    + _LINK.format(name="encoder", place="0 0 0", mass="0.08", across="1e-9", along="1e-9")
    + """
  <joint name="carries" type="fixed"><parent link="upper"/><child link="encoder"/><origin xyz="0 0 -0.3"/></joint>"""
)
URDF = (
    '<?xml version="1.0"?>\n<!-- drawn > weighed: "keep" me -->\n<robot name="own"><link name="base"/>'
    + _LINK.format(name="carrier", place="0 0 0", mass="0.5", across="0.007", along="{arm_inertia}")
    + _LINK.format(name="upper", place="0 0 -{rod_centroid}", mass="0.3", across="{rod_inertia}", along="1e-9")
    + _JOINT.format(name="yaw", parent="base", child="carrier", place="0 0 1", axis="0 0 -1", damping="{arm_damping}")
    + _JOINT.format(
        name="shoulder",
        parent="carrier",
        child="upper",
        place="0 {arm_length} 0",
        axis="0 1 0",
        damping="{rod_damping}",
    )
    + "{second}\n</robot>\n"
)

_SDF_PART = """
    <link name="{child}"><pose relative_to="{parent}">{place} 0 0 0</pose>
      <inertial><pose>{centroid} 0 0 0</pose><mass>{mass}</mass>
        <inertia><ixx>{across}</ixx><iyy>{across}</iyy><izz>{along}</izz></inertia></inertial></link>
    <joint name="{name}" type="revolute"><parent>{parent}</parent><child>{child}</child>
      <axis><xyz>{axis}</xyz><dynamics><damping>{damping}</damping></dynamics></axis></joint>"""
SDF_ROD = (
    _SDF_PART.format(
        name="elbow", parent="upper", child="lower", place="0 0 -0.3", centroid="0 0 -{tip_centroid}", mass="0.15",
        across="{tip_inertia}", along="1e-9", axis="0 -1 0", damping="{elbow_damping}",
    )
    + """
    <link name="encoder"><pose relative_to="upper">0 0 -0.3 0 0 0</pose><inertial><mass>0.08</mass>
      <inertia><ixx>1e-9</ixx><iyy>1e-9</iyy><izz>1e-9</izz></inertia></inertial></link>
    <joint name="carries" type="fixed"><parent>upper</parent><child>encoder</child></joint>"""
)  # fmt: skip
SDF = (
    '<?xml version="1.0"?>\n<sdf version="1.10"><!-- drawn > weighed: "keep" me -->\n  <world name="lab">'
    '<gravity>0 0 -9.81</gravity><model name="own">\n    <link name="base"/>'
    '<joint name="fixed" type="fixed"><parent>world</parent><child>base</child></joint>'
    + _SDF_PART.format(
        name="yaw", parent="base", child="carrier", place="0 0 1", centroid="0 0 0", mass="0.5", across="0.007",
        along="{arm_inertia}", axis="0 0 -1", damping="{arm_damping}",
    )
    + _SDF_PART.format(
        name="shoulder", parent="carrier", child="upper", place="0 {arm_length} 0", centroid="0 0 -{rod_centroid}",
        mass="0.3", across="{rod_inertia}", along="1e-9", axis="0 1 0", damping="{rod_damping}",
    )
    + "{second}\n  </model></world></sdf>\n"
)  # fmt: skip
FORMATS = {"xml": (MJCF, MJCF_ROD), "urdf": (URDF, URDF_ROD), "sdf": (SDF, SDF_ROD)}
"""File with an arm and one rod, and its second rod, for each suffix."""


def text_of(suffix: str, rods: int, **other: str) -> str:
    """Text of the file with one or two rods and other numbers."""
    whole, second = FORMATS[suffix]
    numbers = NUMBERS | other
    return whole.format(**numbers, second=second.format(**numbers) if rods == 2 else "")


def imported(folder: Path, suffix: str, text: str) -> tuple[Path, Rig]:
    """Write a file into a separate folder, and create its rig file with the torque as input of the arm."""
    folder.mkdir()
    file = folder / f"robot.{suffix}"
    file.write_text(text, encoding="utf-8")
    rig_from_model(file, folder / "rig.toml")
    written = (folder / "rig.toml").read_text(encoding="utf-8")
    if "[motor]" not in written:
        written = written.replace('mode = "free"', 'mode = "driven"')
        written = written.replace("[poses", '[motor]\ninput = "torque"\n[poses', 1)
        (folder / "rig.toml").write_text(written, encoding="utf-8")
    return file, load_rig(folder / "rig.toml")


def recorded(truth: str, rig: Rig, number: int = 0, seconds: float = 3.0, gear: float = 1.0) -> Run:
    """Simulate a swing of the true rig in MuJoCo under a torque on its arm, multiplied by `gear`."""
    engine = mujoco.MjModel.from_xml_string(truth)
    data, t, count = mujoco.MjData(engine), np.arange(0, seconds, 0.005), 2 * np.pi / 16384
    rods = engine.nv - 1
    torque = 0.4 * np.sin(4 * t + number) + 0.3 * np.sin((7.3 - number) * t + 1)
    data.qpos[:] = count * np.array(rig.positions([0.0, 2.3 - 0.4 * number, 2.3 + 0.6 * number]))[: engine.nv]
    angles = []
    for value in torque:
        angles.append(rig.theta([*(data.qpos / count), *((2 - rods) * [0.0])]))
        data.qfrc_applied[0] = rig.encoders.direction[0] * gear * value
        mujoco.mj_step(engine, data, 20)
    theta = np.array(angles) + np.random.default_rng(number).normal(0, 3e-4, (len(t), 3))
    if rods == 1:
        theta[:, 2] = theta[:, 1]
    return Run(
        f"r{number}", t, theta, None, None, rig.name, "", 200.0, mounting=rig.rods.mounting, arm_mode="driven",
        arm_input=torque,
    )  # fmt: skip


def model_like(true: Rig, rig: Rig) -> MovingArmModel:
    """Model that a perfect identification of the true rig gives.

    Fields that no export reads are left at their defaults.
    """
    assert true.arm.A is not None
    assert true.arm.c0 is not None
    z = {name: parameter.nominal for name, parameter in true.parameters.items()}
    if true.rods.mounted == "both":
        letter, rods = "b", base_parameters(true.nominal, true.L1, true.g)
    else:
        a = z["J1"] + z["m1"] * z["l1"] ** 2
        letter, rods = "a", (a, a, 0.0, z["m1"] * z["l1"] * true.g, z["c1"], 0.0)
    scale = float(rods[1])
    values = (*rods, true.arm.A.nominal, true.arm.c0.nominal, 0.0, 0.0, 1.0, true.L0)
    swing = [v if n == "L0" else v / scale for n, v in zip(SWING_PARAMETERS, values, strict=True)]
    one = EstimatedValue(value=scale, std=1e-5, interval90=(scale, scale), fixed_by="data")
    mounted = "both" if letter == "b" else "inner"
    return MovingArmModel.model_construct(
        rig=RigFacts.model_construct(name=rig.name, sha256="", L1=rig.L1, g=rig.g), mounted=mounted, input="torque",
        scale=letter, ratios={f"A/{letter}": one}, absolute={letter: one}, swing=swing, effects={}, scale_sentence="",
    )  # fmt: skip
