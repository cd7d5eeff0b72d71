"""Blind trials of MJCF, URDF and SDFormat models with one planted error of random size.

    python benchmarks/simulator_models.py [--trials 40] [--first 0] [--quick] [--json]

Each trial has two results: whether the first cause is the planted error, and the error of free runs of the corrected
file from poses that were not recorded. The number of a trial determines kind, size and format of its error; the
diagnosis sees only the file and the recordings. MJCF and URDF models run in MuJoCo, SDFormat models in Drake, which has
no Coulomb friction. A wrong gear is visible only in driven rods. In these trials, the motors follow known inputs, and
the torques of the recordings are computed with the gears of the file.
"""

import sys
import tempfile
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import TreeBuilder, XMLParser, fromstring

import numpy as np
from _bars import at_least, options, show

sys.path.insert(0, str(Path(__file__).parents[1]))
from dpr_lab.exports.corrected import corrected_model
from dpr_lab.exports.into import WORDS, into_file
from dpr_lab.exports.into.least_change import least_change
from dpr_lab.exports.refit import fitted_in_words
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.identification.model import Model
from dpr_lab.rig import load_rig
from dpr_lab.shown import percent
from dpr_lab.simulator_models import read_model
from dpr_lab.simulator_models.double_pendulum import double_pendulum
from dpr_lab.workflows.rig_from import rig_from_model
from tests.exports.planted_errors import controls, recordings, swing

RIGHT = {
    "friction1": 0.0, "friction2": 0.0, "armature2": 0.0, "damping1": 0.002, "damping2": 0.001, "stiffness1": 0.0,
    "stiffness2": 0.0, "centroid1": 0.12, "centroid2": 0.125, "length": 0.3, "gear1": 10.0, "gear2": 5.0,
}  # fmt: skip
"""Parameters of the robot before an error is planted, SI units."""

PLANTED = {
    "friction1": ("Coulomb friction", "shoulder", (0.004, 0.008)),
    "friction2": ("Coulomb friction", "elbow", (0.002, 0.006)),
    "armature2": ("rotor inertia (armature)", "elbow", (2e-4, 6e-4)),
    "damping1": ("damping", "shoulder", (0.003, 0.008)),
    "damping2": ("damping", "elbow", (2e-4, 6e-4)),
    "stiffness1": ("spring stiffness", "shoulder", (0.04, 0.12)),
    "stiffness2": ("spring stiffness", "elbow", (0.03, 0.08)),
    "centroid1": ("centre of mass of the body along the rod", "shoulder", (0.128, 0.14)),
    "centroid2": ("centre of mass of the body along the rod", "elbow", (0.132, 0.145)),
    "length": ("error of length L1 or gravity", "shoulder", (0.308, 0.325)),
    "gear1": ("gear of the motor", "shoulder", (10.6, 13.0)),
    "gear2": ("gear of the motor", "elbow", (3.8, 4.7)),
}
"""Expected quantity and joint of the first cause, and range of the true value, by planted parameter."""

JOINTS = (1, "shoulder"), (2, "elbow")
KINDS = {
    "xml": tuple(PLANTED),
    "urdf": ("friction1", "friction2", "damping1", "damping2", "centroid1", "centroid2", "length"),
    "sdf": ("stiffness1", "stiffness2", "damping1", "damping2", "centroid1", "centroid2", "length"),
}
"""Planted errors that each format can contain and its engine simulates."""
STARTS = ((np.pi - 1.5, np.pi - 0.4), (2.3, 3.6))
"""Absolute angles of held-out releases, rad."""


def mjcf(n: dict[str, float], driven: bool = False) -> str:
    """MJCF model of the robot, with motors only if it is driven."""
    motors = "".join(f'<motor joint="{name}" gear="{n[f"gear{j}"]}"/>' for j, name in JOINTS)
    joints = [
        f'axis="0 1 0" damping="{n[f"damping{j}"]}" frictionloss="{n[f"friction{j}"]}"'
        f' stiffness="{n[f"stiffness{j}"]}" armature="{n["armature2"] if j == 2 else 0}"'
        for j in (1, 2)
    ]
    return f"""<mujoco model="own">
  <!-- drawn > weighed: "keep" me -->
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81" timestep="0.0005" integrator="RK4"/>
  <worldbody>
    <body name="upper" pos="0 0 1">
      <joint name="shoulder" {joints[0]}/>
      <inertial pos="0 0 {-n["centroid1"]}" mass="0.3" diaginertia="0.002 0.0021 0.0005"/>
      <body name="lower" pos="0 0 {-n["length"]}">
        <joint name="elbow" {joints[1]}/>
        <inertial pos="0 0 {-n["centroid2"]}" mass="0.15" diaginertia="0.0008 0.0008 0.00002"/>
      </body>
    </body>
  </worldbody>{f"<actuator>{motors}</actuator>" if driven else ""}
</mujoco>
"""


def urdf(n: dict[str, float]) -> str:
    """URDF model of the robot."""
    none = 'ixy="0" ixz="0" iyz="0"'
    return f"""<robot name="own">
  <!-- drawn > weighed: "keep" me -->
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0 0 {-n["centroid1"]}"/><mass value="0.3"/>
    <inertia ixx="0.002" iyy="0.0021" izz="0.0005" {none}/></inertial></link>
  <link name="lower"><inertial><origin xyz="0 0 {-n["centroid2"]}"/><mass value="0.15"/>
    <inertia ixx="0.0008" iyy="0.0008" izz="0.00002" {none}/></inertial></link>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><origin xyz="0 0 1"/>
    <axis xyz="0 1 0"/><dynamics damping="{n["damping1"]}" friction="{n["friction1"]}"/></joint>
  <joint name="elbow" type="continuous"><parent link="upper"/><child link="lower"/>
    <origin xyz="0 0 {-n["length"]}"/><axis xyz="0 1 0"/>
    <dynamics damping="{n["damping2"]}" friction="{n["friction2"]}"/></joint>
</robot>
"""


def sdf(n: dict[str, float]) -> str:
    """SDFormat model of the robot."""

    def rod(j: int, link: str, above: str, pose: str, mass: float, inertia: tuple[float, float, float]) -> str:
        tensor = "".join(f"<{key}>{value}</{key}>" for key, value in zip(("ixx", "iyy", "izz"), inertia, strict=True))
        spring = f"<spring_reference>0</spring_reference><spring_stiffness>{n[f'stiffness{j}']}</spring_stiffness>"
        return f"""
  <link name="{link}">{pose}
    <inertial><pose>0 0 {-n[f"centroid{j}"]} 0 0 0</pose><mass>{mass}</mass>
      <inertia>{tensor}</inertia></inertial></link>
  <joint name="{JOINTS[j - 1][1]}" type="revolute"><parent>{above}</parent><child>{link}</child>
    <axis><xyz>0 1 0</xyz><dynamics><damping>{n[f"damping{j}"]}</damping>{spring}</dynamics></axis></joint>"""

    upper = rod(1, "upper", "world", "<pose>0 0 1 0 0 0</pose>", 0.3, (0.002, 0.0021, 0.0005))
    elbow = f"<pose relative_to='upper'>0 0 {-n['length']} 0 0 0</pose>"
    lower = rod(2, "lower", "upper", elbow, 0.15, (0.0008, 0.0008, 0.00002))
    return f"""<sdf version="1.9"><world name="lab"><gravity>0 0 -9.81</gravity><model name="own">
  <!-- drawn > weighed: "keep" me -->{upper}{lower}
</model></world></sdf>
"""


NUMBERS = {
    "friction": {"joint frictionloss", "dynamics friction"},
    "armature": {"joint armature"},
    "damping": {"joint damping", "dynamics damping", "damping"},
    "stiffness": {"joint stiffness", "spring_stiffness"},
    "centroid": {"inertial pos", "origin xyz", "pose"},
    "length": {"body pos", "origin xyz", "pose"},
    "gear": {"motor gear"},
}
"""Tags and attributes, or tags of texts, that a correction may change, by kind of the planted error."""


@dataclass(frozen=True, slots=True)
class Result:
    """Result of one trial."""

    planted: str
    size: float
    form: str
    first: str
    right: bool
    before_mrad: float
    after_mrad: float
    changed: str
    outside: tuple[str, ...]
    """Differences of the XML trees, without the correction of the planted error."""

    @property
    def reduction(self) -> float:
        """Share of the error that the correction of the file removes."""
        return 1 - self.after_mrad / self.before_mrad


def differences(before: str, after: str) -> list[str]:
    """List the differences between two XML trees: tag and attribute, or tag of a text or comment.

    Raises:
        ValueError: the trees have different numbers of elements.
    """
    trees = [fromstring(text, XMLParser(target=TreeBuilder(insert_comments=True))) for text in (before, after)]
    pairs = list(zip(*(tree.iter() for tree in trees), strict=True))
    result = [
        f"{old.tag} {key}"
        for old, new in pairs
        for key in sorted({*old.attrib, *new.attrib})
        if old.get(key) != new.get(key)
    ]
    return result + [
        f"{old.tag}" for old, new in pairs if (old.tag, old.text, old.tail) != (new.tag, new.text, new.tail)
    ]


def trial(number: int) -> Result:
    """Plant an error, record, diagnose and correct the model, and simulate free runs."""
    rng = np.random.default_rng([29, number])
    form = ("xml", "xml", "urdf", "sdf")[number % 4]
    kind = str(rng.choice(KINDS[form]))
    quantity, joint, (low, high) = PLANTED[kind]
    size = float(rng.uniform(low, high))
    gears = (RIGHT["gear1"], RIGHT["gear2"]) if kind.startswith("gear") else None
    write = {"xml": partial(mjcf, driven=gears is not None), "urdf": urdf, "sdf": sdf}[form]
    text, truth = write(RIGHT), write(RIGHT | {kind: size})
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / f"robot.{form}"
        file.write_text(text, encoding="utf-8")
        rig_from_model(file, Path(folder) / "rig.toml", g=9.81)
        rig = load_rig(Path(folder) / "rig.toml")
        runs = recordings(truth, rig, gears=gears)
        diagnosis = diagnose(runs, rig)
        read = read_model(file)
        chain = double_pendulum(read, (), rig.g if read.gravity is None else None)
        corrected = corrected_model(diagnosis, runs, rig)
        assert isinstance(corrected, Model)
        model = fitted_in_words(corrected, WORDS[read.format], runs, rig)
        assert isinstance(model, Model)
        least = least_change(diagnosis, model, rig, chain, runs)
        patched = into_file(least.model, rig, file)
    first = least.causes[0] if least.causes else None
    t = np.arange(0, 3, 0.005)
    inputs = None if gears is None else controls(len(runs), t)
    true, *errors = (
        np.array([swing(own, rig, start, t, controls=inputs) for start in STARTS])
        for own in (truth, text, patched.text.decode())
    )
    before, after = (1e3 * float(np.sqrt(np.mean((own - true) ** 2))) for own in errors)
    right = first is not None and (first.quantity, first.joint) == (quantity, joint)
    named = f"{first.quantity}, {first.joint}" if first else "none"
    changed = ", ".join(f"{change.element} {change.attribute}" for change in patched.changes)
    differ = differences(text, patched.text.decode())
    planted = [each for each in differ if each in NUMBERS[kind.rstrip("12")]]
    outside = (*(each for each in differ if each not in planted), *planted[1:])
    return Result(kind, size, form, named, right, before, after, changed, outside)


def main() -> None:
    """Print a table of all trials, then the results."""
    parser = options(__doc__)
    parser.add_argument("--trials", type=int, default=40)
    parser.add_argument("--first", type=int, default=0)
    chosen = parser.parse_args()
    count, results = 6 if chosen.quick else chosen.trials, []
    print(
        "| trial | planted | format | first cause | held-out error before, mrad | after, mrad | reduction | changed |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for number in range(chosen.first, chosen.first + count):
        r = trial(number)
        results.append(r)
        errors = f"{r.before_mrad:.3g} | {r.after_mrad:.2g} | {percent(r.reduction, 1)}"
        print(f"| {number} | {r.planted} {r.size:.3g} | {r.form} | {r.first} | {errors} | {r.changed} |", flush=True)
    closed = sum(r.reduction >= 0.9 for r in results)
    bars = [
        at_least(f"correct first cause, of {count}", sum(r.right for r in results), round(0.925 * count)),
        at_least(f"held-out error reduced by 90 %, of {count}", closed, count),
        at_least(f"only the planted number changed, of {count}", sum(not r.outside for r in results), count),
    ]
    show("planted errors in simulator models", bars, chosen.json)


if __name__ == "__main__":
    main()
