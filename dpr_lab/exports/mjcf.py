"""Export the corrected model as MJCF for MuJoCo.

A passive-force callback (`mjcb_passive`) adds effects that MJCF cannot express. MuJoCo represents Coulomb friction by a
constraint of finite stiffness, and integrates presliding to first order. With these two effects, the motion in MuJoCo
converges to the motion in dpr-lab as the time step decreases. Without these effects, both motions agree to the accuracy
of the integrator.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass
from functools import partial

import numpy as np

from dpr_lab.dynamics.arm import CLAMPED, FREE, reduced_rods
from dpr_lab.dynamics.dry_friction import held
from dpr_lab.dynamics.rig_constants import rig_constants
from dpr_lab.dynamics.step import joint_forces, motion_of, under_load, with_arm
from dpr_lab.effects import EFFECTS, effect_params
from dpr_lab.effects.effect_kernels import (
    active_effects,
    arm_drives,
    arm_torques,
    dry_limit0,
    dry_limits,
    effect_torques,
    whole_torques,
)
from dpr_lab.effects.quantities import plus
from dpr_lab.exports.bodies import Effects, bodies, in_words
from dpr_lab.exports.module_parts import known_effects, of_effects
from dpr_lab.exports.python_module import python_module
from dpr_lab.exports.rigid_bodies import THIN, Link
from dpr_lab.exports.xml import rendered
from dpr_lab.identification.moving_arm.model import AnyModel, MovingArmModel
from dpr_lab.rig import Rig

WORDS = frozenset(
    {"friction", "stiffness", "rest_angle", "armature", "cogging", "presliding", "offset", "added_length", "tilt"}
    | {"arm", "encoder_offset", "encoder_scale"}
)
"""Elements of effects that MJCF supports."""

XML, CALLBACK = "corrected_model.xml", "passive.py"

_CALLBACK = '''
import mujoco

FRICTION = {friction!r}  # Coulomb friction at rest of joints 0, 1, 2 that the engine already applies, N m
# number of a joint -> its name in the file, theta1 or theta2 - theta1 at its zero, sign of its direction
JOINTS = {joints!r}
GRAVITY = {gravity!r}  # for a file that contains none


def coordinates(data):
    """Angles of joints 0, 1, 2 and their speeds in the engine; zero for joints that are not in the file."""
    turns, speeds = [0.0] * 3, [0.0] * 3
    for number, (name, upright, sign) in JOINTS.items():
        joint = data.joint(name)
        turns[number], speeds[number] = upright + sign * float(joint.qpos[0]), sign * float(joint.qvel[0])
    return turns, speeds


def direction(speed):
    return math.copysign(1.0, speed) if speed else 0.0


def passive(model, data):
    """Torques of the effects that the file cannot contain; for mujoco.set_mjcb_passive, after the model is loaded."""
    turns, speeds = coordinates(data)
    along = [direction(speed) for speed in speeds]
    angles, omegas = (turns[0], turns[1], turns[1] + turns[2]), (speeds[0], speeds[1], speeds[1] + speeds[2])
    motion = motion_of(data.time, angles, omegas, (0.0, 0.0), (0.0, 0.0), (along[1], along[2]))
    terms = called_torques(motion, MODEL.base, MODEL.constants, START, None, None)
    if MODEL.required.load:
        everything = effect_torques(motion, MODEL.base, MODEL.constants, START, (0.0, 0.0), None)
        rods = reduced_rods(motion, MODEL.base, everything, MODEL.arm, {mode}, 0.0)
        forces = joint_forces(motion, held(rods, along[1], along[2]), MODEL.base, MODEL.constants)
        motion = under_load(motion, *forces)
        terms = plus(terms, load_torques(motion, MODEL.base, MODEL.constants, START, None, None))
    torque0, torque1, torque2 = arm_torques(data, with_arm(motion, 0.0, along[0]))
    torques = [torque0, terms.torque1 + terms.torque2 + torque1 + torque2, terms.torque2 + torque2]
    for number, (name, _, sign) in JOINTS.items():
        data.joint(name).qfrc_passive[0] += sign * (torques[number] + along[number] * FRICTION[number])


class EngineSwing({kind}):
    """Simulation of the rig in MuJoCo, for `simulate(..., kind=EngineSwing)` and `readings(..., kind=EngineSwing)`."""

    file = {file!r}
    compiled = None  # a model to use instead of the file

    def __init__(self, x0, t=0.0, run=0):
        super().__init__(x0, t, run)
        mujoco.set_mjcb_passive(None)
        self.model = self.compiled or mujoco.MjModel.from_xml_path(self.file)
        self.data, x = mujoco.MjData(self.model), self.x
        turns, speeds = (x.theta0, x.theta1, x.theta2 - x.theta1), (x.omega0, x.omega1, x.omega2 - x.omega1)
        for number, (name, upright, sign) in JOINTS.items():
            joint = self.data.joint(name)
            joint.qpos[0], joint.qvel[0] = sign * (turns[number] - upright), sign * speeds[number]
        self.model.opt.integrator, self.longest = mujoco.mjtIntegrator.mjINT_RK4, min(self.model.opt.timestep, 5e-4)
        if GRAVITY is not None:
            self.model.opt.gravity[:] = 0.0, 0.0, -GRAVITY

    def arm(self, x):
        """Angle and speed of the arm; MuJoCo does not simulate a motor behind the backlash of a gear."""
        return x.theta0, x.omega0

    def after(self, h, torque1, torque2):
        count = max(1, math.ceil(h / self.longest - 1e-9))
        self.model.opt.timestep, self.data.time = h / count, self.t
        self.model.dof_solref[:, 0] = 2.0 * h / count  # Coulomb friction as stiff as the step allows
        self.push(torque1, torque2)
        mujoco.set_mjcb_passive(passive)
        mujoco.mj_step(self.model, self.data, count)
        mujoco.set_mjcb_passive(None)
        turns, speeds = coordinates(self.data)
        theta2, omega2 = (turns[1] + turns[2], speeds[1] + speeds[2]) if 2 in JOINTS else (0.0, 0.0)
        return self.x._replace(
            theta0=turns[0], theta1=turns[1], theta2=theta2, omega0=speeds[0], omega1=speeds[1], omega2=omega2
        )

{push}
'''

_PUSH = '''
    def push(self, torque1, torque2):
        """Apply the torques of joints 1 and 2, N m."""
        for number, (name, _, sign) in JOINTS.items():
            self.data.joint(name).qfrc_applied[0] = sign * (torque1, torque2)[number - 1]


def arm_torques(data, motion):
    """Return zero torques, because no effects act on a clamped arm."""
    return 0.0, 0.0, 0.0
'''

_ARM_PUSH = '''
    def push(self, u, _):
        """Apply the input of the arm: to the actuator, or as a torque if the file has no actuator."""
        self.data.qfrc_applied[0] = 0.0 if self.model.nu else GAIN * u
        if self.model.nu:
            self.data.ctrl[0] = u  # the arm's motor comes first


def arm_torques(data, motion):
    """Torques on theta0, theta1, theta2 of the effects at the arm, in its drive and of the whole rig, N m."""
    known = GAIN * float(data.ctrl[0]) if len(data.ctrl) else float(data.qfrc_applied[0])
    driven = called_arm_drives(motion, known, None, None) - known
    torque0 = called_arm_torques(motion, driven, START, None, None)
    return called_whole(motion, MODEL.base, MODEL.constants, torque0, None, None)
'''


@dataclass(frozen=True, slots=True)
class EngineFile:
    """Properties of a file for which a module of passive forces is written; by default of the file of `mjcf`."""

    name: str = XML
    joints: tuple[str, str] = ("joint1", "joint2")
    upright: tuple[float, float] = (0.0, 0.0)
    """theta1 and theta2 - theta1 at the zero of the joints of the file, rad."""
    sign: tuple[float, float] = (1.0, 1.0)
    """Sign of each joint: -1 if its angle decreases while theta increases."""
    gravity: float | None = None
    """Gravity for a file that contains none, m/s^2; None otherwise."""


def mjcf(model: AnyModel, rig: Rig) -> str:
    """Generate MJCF text of the corrected model.

    Each mounted rod has a hinge, whose angle is 0 with the rods upright; joint 2 is relative to the inner rod. An arm
    that moves has a further hinge. The motor of a driven arm is controlled by the input in its own unit. The custom
    text `left_out` lists the effects without an MJCF element; the module of `passive` applies these effects.

    Raises:
        ConfigError: no rigid bodies can represent the model with a moving arm.
    """
    expressed = in_words(model, rig, WORDS)
    corrected = bodies(model, rig, expressed)
    # the passive force represents the effects that this version knows
    omitted = [name for name in model.effects if name not in expressed]
    read = [link for link in corrected.links if link.joint or isinstance(model, MovingArmModel)]
    return rendered(
        "mjcf.xml",
        name=model.rig.name,
        scale=model.scale_sentence,
        left_out=f"Effects not in this file: {', '.join(omitted)}."
        if omitted
        else "This file contains all named effects.",
        corrected=corrected,
        read=read,
        frictions=rest_friction(model.effects, rig),
        passive=[(link.joint, *part) for link in read for part in _passive_parts(link)],
        thin=THIN,
    )


def passive(
    model: AnyModel, rig: Rig, expressed: Collection[str] | None = None, engine_file: EngineFile | None = None
) -> str:
    """Generate a Python module with passive forces and encoder readings.

    The passive forces represent the effects that a file of MuJoCo cannot contain.

    Args:
        model: the corrected model
        rig: rig of the model
        expressed: effects that the file contains; None: the effects that `mjcf` writes
        engine_file: properties of the file; None: those of the file that `mjcf` writes
    """
    expressed = in_words(model, rig, WORDS) if expressed is None else expressed
    place = EngineFile() if engine_file is None else engine_file
    moving = isinstance(model, MovingArmModel)
    outer = model.mounted == "both" if isinstance(model, MovingArmModel) else not model.fitted
    called = [name for name in model.effects if name in EFFECTS and name not in expressed]
    more = {"motion_of": motion_of, "under_load": under_load, "joint_forces": joint_forces, "held": held, "plus": plus}
    more |= {"reduced_rods": reduced_rods, "with_arm": with_arm, "called_torques": effect_torques}
    if moving:
        more |= {"called_arm_torques": arm_torques, "called_arm_drives": arm_drives, "called_whole": whole_torques}
    effects_of = partial(of_effects, effects=called)
    text = python_module(model, rig, more, {name: effects_of for name in more if name.startswith("called_")})
    joints = {number: terms for number, *terms in zip((1, 2), place.joints, place.upright, place.sign, strict=True)}
    joints = ({0: ["joint0", 0.0, 1.0]} if moving else {}) | (joints if outer else {1: joints[1]})
    return text + _CALLBACK.format(
        friction=rest_friction({name: model.effects[name] for name in called}, rig),
        joints={number: tuple(terms) for number, terms in joints.items()},
        gravity=place.gravity,
        file=place.name,
        mode=FREE if moving else CLAMPED,
        kind="ArmSwing" if moving else "Swing",
        push=(_ARM_PUSH if moving else _PUSH).strip("\n"),
    )


def rest_friction(effects: Effects, rig: Rig) -> tuple[float, float, float]:
    """Return the (3,) Coulomb friction of arm and hanging joints at rest, N m.

    Each value is the smaller of the frictions in both directions of motion.
    """
    constants = rig_constants(rig)
    params = effect_params(known_effects(effects))
    active = active_effects(params)
    hanging = motion_of(0.0, (0.0, math.pi, math.pi), (0.0, 0.0, 0.0), (0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
    weights = (constants.m1 + constants.m2 + constants.mb) * constants.g, constants.m2 * constants.g
    hanging = under_load(hanging, *weights)
    lines = [
        (dry_limit0(hanging, push, params, active), *dry_limits(hanging, push, push, params, active))
        for push in (1.0, -1.0)
    ]
    arm, joint1, joint2 = np.min(lines, axis=0).tolist()
    return arm, joint1, joint2


def _passive_parts(link: Link) -> list[tuple[str, tuple[float, ...]]]:
    """Return names and parameters of the DC motor properties that represent cogging and presliding friction."""
    words = link.body.words
    waves = [("cogging", (size, N, phase - N * link.hanging)) for size, N, phase in words.get("cogging", ())]
    if "presliding" not in words:
        return waves
    torque, length = words["presliding"]
    return [*waves, ("lugre", (torque / length, 0.0, torque, torque, 1.0))]
