"""Export of the corrected model as MJCF of MuJoCo, with a passive force (`mjcb_passive`) for other effects.

MuJoCo softens Coulomb friction (a constraint of finite stiffness) and integrates presliding to first order: with either
effect its motion converges to that of dpr-lab for small time steps. Otherwise both agree to the accuracy of the
integrator.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import partial
from xml.etree.ElementTree import Element

import numpy as np

from dpr_lab.dynamics.arm import reduced_rods
from dpr_lab.dynamics.dry_friction import held
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.step import joint_forces, motion_of, under_load
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.effects.effect import Words
from dpr_lab.effects.effect_kernels import active_effects, dry_limits, effect_torques
from dpr_lab.effects.quantities import plus
from dpr_lab.exports.bodies import THIN, Bodies, Effects, Rod, bodies, in_words
from dpr_lab.exports.python_module import known_effects, module_text, of_effects
from dpr_lab.exports.xml import element, text_of
from dpr_lab.identification.model import Model
from dpr_lab.rig import Rig

WORDS = frozenset(
    {"friction", "stiffness", "rest_angle", "armature", "cogging", "presliding", "offset", "added_length", "tilt"}
    | {"arm", "encoder_offset", "encoder_scale"}
)
"""Elements of effects that MJCF supports."""

XML, CALLBACK = "corrected_model.xml", "passive.py"

_CALLBACK = '''
import mujoco

FRICTION = {friction!r}  # of the effects called here, what the engine gives the joints already, N m
JOINTS = {joints!r}
UPRIGHT = {upright!r}  # theta1 and theta2 - theta1 where these joints are at zero, rad
SIGN = {sign!r}  # -1 for a joint that turns against theta
GRAVITY = {gravity!r}  # of a file that says none


def coordinates(data):
    """theta1, theta2 - theta1 and their speeds in the engine."""
    first, second = (data.joint(name) for name in JOINTS)
    turns = (UPRIGHT[0] + SIGN[0] * float(first.qpos[0]), UPRIGHT[1] + SIGN[1] * float(second.qpos[0]))
    return *turns, SIGN[0] * float(first.qvel[0]), SIGN[1] * float(second.qvel[0])


def passive(model, data):
    """Torques of the effects that the file cannot contain; for mujoco.set_mjcb_passive, once the model is loaded."""
    theta1, turn2, omega1, turning2 = coordinates(data)
    directions = math.copysign(1.0, omega1) if omega1 else 0.0, math.copysign(1.0, turning2) if turning2 else 0.0
    angles, speeds = (0.0, theta1, theta1 + turn2), (0.0, omega1, omega1 + turning2)
    motion = motion_of(data.time, angles, speeds, (0.0, 0.0), (0.0, 0.0), directions)
    terms = called_torques(motion, MODEL.base, MODEL.constants, START, None, None)
    if MODEL.required.load:
        everything = effect_torques(motion, MODEL.base, MODEL.constants, START, (0.0, 0.0), None)
        rods = reduced_rods(motion, MODEL.base, everything, MODEL.arm, 0, 0.0)
        forces = joint_forces(motion, held(rods, *directions), MODEL.base, MODEL.constants)
        motion = under_load(motion, *forces)
        terms = plus(terms, load_torques(motion, MODEL.base, MODEL.constants, START, None, None))
    data.joint(JOINTS[0]).qfrc_passive[0] += SIGN[0] * (terms.torque1 + terms.torque2 + directions[0] * FRICTION[0])
    data.joint(JOINTS[1]).qfrc_passive[0] += SIGN[1] * (terms.torque2 + directions[1] * FRICTION[1])


class EngineSwing(Swing):
    """The rig in MuJoCo; for `simulate(..., kind=EngineSwing)` and `readings(..., kind=EngineSwing)`."""

    file = {file!r}
    compiled = None  # a model to use instead of the file

    def __init__(self, x0, t=0.0, run=0):
        super().__init__(x0, t, run)
        mujoco.set_mjcb_passive(None)
        self.model = self.compiled or mujoco.MjModel.from_xml_path(self.file)
        self.data = mujoco.MjData(self.model)
        turns, speeds = (self.x.theta1, self.x.theta2 - self.x.theta1), (self.x.omega1, self.x.omega2 - self.x.omega1)
        for name, turn, speed, upright, sign in zip(JOINTS, turns, speeds, UPRIGHT, SIGN):
            self.data.joint(name).qpos[0], self.data.joint(name).qvel[0] = sign * (turn - upright), sign * speed
        self.model.opt.integrator, self.longest = mujoco.mjtIntegrator.mjINT_RK4, min(self.model.opt.timestep, 5e-4)
        if GRAVITY is not None:
            self.model.opt.gravity[:] = 0.0, 0.0, -GRAVITY

    def after(self, h, torque1, torque2):
        count = max(1, math.ceil(h / self.longest - 1e-9))
        self.model.opt.timestep, self.data.time = h / count, self.t
        self.model.dof_solref[:, 0] = 2.0 * h / count  # dry friction as hard as the step allows
        for name, sign, torque in zip(JOINTS, SIGN, (torque1, torque2)):
            self.data.joint(name).qfrc_applied[0] = sign * torque
        mujoco.set_mjcb_passive(passive)
        mujoco.mj_step(self.model, self.data, count)
        mujoco.set_mjcb_passive(None)
        theta1, turn2, omega1, turning2 = coordinates(self.data)
        return self.x._replace(theta1=theta1, theta2=theta1 + turn2, omega1=omega1, omega2=omega1 + turning2)
'''


@dataclass(frozen=True, slots=True)
class EngineFile:
    """The file whose joints a module of passive forces acts on; by default that of `mjcf`."""

    name: str = XML
    joints: tuple[str, str] = ("joint1", "joint2")
    upright: tuple[float, float] = (0.0, 0.0)
    """theta1 and theta2 - theta1 where its joints are at zero, rad."""
    sign: tuple[float, float] = (1.0, 1.0)
    """-1 for a joint that turns against theta."""
    gravity: float | None = None
    """Gravity, m/s^2, of a file that contains none."""


def mjcf(model: Model, rig: Rig) -> str:
    """The corrected model as MJCF: two hinges, 0 = upright, joint 2 relative to the inner rod.

    Effects without an MJCF element are listed in the custom text `left_out`, and are in the passive force (`passive`).
    """
    expressed = in_words(model, rig, WORDS)
    made = bodies(model, rig, expressed)
    root = element(None, "mujoco", model=model.rig.name)
    element(root, "compiler", angle="radian")
    pull = f"{made.gravity * math.sin(made.tilt)!r} 0 {-made.gravity * math.cos(made.tilt)!r}"
    element(root, "option", gravity=pull, timestep="0.0005", integrator="RK4")
    custom = element(root, "custom")
    left = [name for name in model.effects if name not in expressed]  # in the passive force, if known
    text = f"Not expressed here: {', '.join(left)}." if left else "All named effects are expressed."
    element(custom, "text", name="left_out", data=text)
    element(custom, "text", name="scale", data=model.scale_sentence)
    friction, world = rest_friction(model.effects, rig), element(root, "worldbody")
    parent = _arm(world, made) if made.arm else world
    inner = _rod(parent, made.rods[0], 1, f"0 {-made.arm.length!r} 0" if made.arm else "", friction[0])
    tip = f"0 0 {made.rods[0].length!r}"
    if made.tip_mass > 0.0:
        _inertia(element(inner, "body", name="encoder2", pos=tip), "0 0 0", made.tip_mass, THIN)
    _rod(inner, made.rods[1], 2, tip, friction[1])
    _motors(root, made)
    sensors = element(root, "sensor")
    for j, rod in enumerate(made.rods, 1):
        element(sensors, "jointpos", name=f"encoder{j}", joint=f"joint{j}")
        errors = f"{rod.words.get('encoder_offset', 0.0)!r} {rod.words.get('encoder_scale', 0.0)!r}"
        element(custom, "numeric", name=f"encoder{j}_offset_scale", data=errors)
    return text_of(root)


def passive(
    model: Model, rig: Rig, expressed: Collection[str] | None = None, engine_file: EngineFile | None = None
) -> str:
    """Module with the passive force of the effects that a file cannot contain, and the encoder readings.

    Args:
        model: the corrected model
        rig: its rig
        expressed: effects that the file contains; None: those of `mjcf`
        engine_file: the file; None: that of `mjcf`
    """
    expressed = in_words(model, rig, WORDS) if expressed is None else expressed
    place = EngineFile() if engine_file is None else engine_file
    called = [name for name in model.effects if name in EFFECTS and name not in expressed]
    more = {"motion_of": motion_of, "under_load": under_load, "joint_forces": joint_forces, "held": held, "plus": plus}
    more |= {"reduced_rods": reduced_rods, "called_torques": effect_torques}
    text = module_text(model, rig, more, {"called_torques": partial(of_effects, effects=called)})
    friction = rest_friction({name: model.effects[name] for name in called}, rig)
    return text + _CALLBACK.format(
        friction=friction,
        joints=place.joints,
        upright=place.upright,
        sign=place.sign,
        gravity=place.gravity,
        file=place.name,
    )


def rest_friction(effects: Effects, rig: Rig) -> tuple[float, float]:
    """Coulomb friction of both hanging joints at rest, N m; the smaller value if the two directions differ."""
    constants = rig_constants(rig)
    params = effect_params(known_effects(effects))
    hanging = motion_of(0.0, (0.0, math.pi, math.pi), (0.0, 0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
    weights = (constants.m1 + constants.m2 + constants.mb) * constants.g, constants.m2 * constants.g
    hanging = under_load(hanging, *weights)
    both = [dry_limits(hanging, push, push, params, active_effects(params)) for push in (1.0, -1.0)]
    joint1, joint2 = np.min(both, axis=0).tolist()
    return joint1, joint2


def _arm(world: Element, made: Bodies) -> Element:
    assert made.arm is not None
    body = element(world, "body", name="arm")
    held_by = {"damping": repr(made.arm.damping), "stiffness": repr(made.arm.stiffness)}
    element(body, "joint", name="joint0", type="hinge", axis="0 0 1", **held_by)
    inertia = repr(made.arm.inertia)
    element(body, "inertial", pos="0 0 0", mass="1e-9", diaginertia=f"{inertia} {inertia} {inertia}")
    return body


def _rod(parent: Element, rod: Rod, joint: int, at: str, friction: float) -> Element:
    """A thin rod on its hinge."""
    body = element(parent, "body", name=("inner", "outer")[joint - 1], **({"pos": at} if at else {}))
    element(body, "joint", name=f"joint{joint}", type="hinge", axis="0 1 0", **_hinge(rod, joint, friction))
    _inertia(body, f"{rod.offset!r} 0 {rod.centroid!r}", rod.mass, rod.inertia)
    end = f"0 0 0 0 0 {rod.length!r}"
    element(body, "geom", type="capsule", fromto=end, size="0.006", contype="0", conaffinity="0")
    return body


def _hinge(rod: Rod, joint: int, friction: float) -> dict[str, str]:
    hanging = math.pi if joint == 1 else 0.0
    attributes = {"damping": repr(rod.damping)}
    if "stiffness" in rod.words:
        attributes |= {"stiffness": repr(rod.words["stiffness"]), "springref": repr(hanging + rod.words["rest_angle"])}
    if "armature" in rod.words:
        attributes |= {"armature": repr(rod.words["armature"])}
    if friction:
        hard = {"solreffriction": "0.001 1", "solimpfriction": "0.9999 0.9999 0.001 0.5 2"}
        attributes |= {"frictionloss": repr(friction), **hard}
    return attributes


def _motors(root: Element, made: Bodies) -> None:
    """Cogging and presliding as motors without a winding."""
    passive_parts = [(f"joint{j}", _parts(rod.words, math.pi if j == 1 else 0.0)) for j, rod in enumerate(made.rods, 1)]
    actuators = element(root, "actuator") if any(parts for _, parts in passive_parts) else root
    for joint, parts in passive_parts:
        for kind, numbers in parts:
            attributes = {kind: " ".join(map(repr, numbers))}
            element(actuators, "dcmotor", joint=joint, input="none", resistance="1", motorconst="0 0", **attributes)


def _parts(words: Words, hanging: float) -> list[tuple[str, tuple[float, ...]]]:
    waves = [("cogging", (size, N, phase - N * hanging)) for size, N, phase in words.get("cogging", ())]
    if "presliding" not in words:
        return waves
    torque, length = words["presliding"]
    return [*waves, ("lugre", (torque / length, 0.0, torque, torque, 1.0))]


def _inertia(body: Element, at: str, mass: float, inertia: float) -> None:
    element(body, "inertial", pos=at, mass=repr(mass), diaginertia=f"{inertia!r} {inertia!r} {THIN!r}")
