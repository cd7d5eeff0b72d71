"""Read SDFormat files with Drake, which contains the library of the format.

Friction and springs of joints are read from the file itself, because Drake omits them or converts them to other
elements.
"""

import logging
from collections import Counter
from importlib import import_module
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, tostring

import numpy as np

from dpr_lab.errors import ConfigError
from dpr_lab.simulator_models.numbers import refuse_bad_texts
from dpr_lab.simulator_models.tree import ModelJoint, Part, SimulatorModel, follows
from dpr_lab.simulator_models.xml_file import read_xml

IGNORED = {"visual", "collision", "plugin", "sensor", "light", "include", "actor", "gui", "scene", "particle_emitter"}
"""Elements that are removed: they do not influence the motion of rods, or they refer to other files."""

EARTH = "0 0 -9.8"
"""Default gravity of a world, m/s^2 (specification of `world`)."""

KINDS = {"revolute": "hinge", "prismatic": "slide", "ball": "ball", "quaternion_floating": "free"}
"""Kinds of motion by the type of the joint in Drake."""

NUMBERS = {
    "inertial": frozenset({"mass", "pose"}),
    "inertia": frozenset({"ixx", "ixy", "ixz", "iyy", "iyz", "izz"}),
    "axis": frozenset({"xyz"}),
    "dynamics": frozenset({"damping", "friction", "spring_stiffness", "spring_reference"}),
    "limit": frozenset({"lower", "upper"}),
    "world": frozenset({"gravity"}),
    **dict.fromkeys(("model", "link", "joint", "frame"), frozenset({"pose"})),
}
"""For each element, its children that contain numbers."""

UNBOUNDED = frozenset({"lower", "upper"})
"""Children that may be infinite, because a joint may have no limits."""


def read_sdf(path: Path, text: bytes | None = None) -> SimulatorModel:
    """Read an SDFormat file; if `text` is given, it replaces the content of the file.

    Raises:
        ConfigError: Drake is not installed or refuses the file.
    """
    try:  # imported by name, because the type checker would otherwise read all stubs of Drake
        parsing, plants = (import_module(f"pydrake.multibody.{module}") for module in ("parsing", "plant"))
    except ModuleNotFoundError as missing:
        raise ConfigError("reading SDFormat needs Drake: pip install drake (Linux and macOS)") from missing
    logging.getLogger("drake").setLevel(logging.ERROR)
    root = read_xml(path, text)
    counts: Counter[str] = Counter()
    _refuse_masses_of_meshes(root, path)
    _strip(root, counts)
    refuse_bad_texts(root, NUMBERS, UNBOUNDED, path)
    plant = plants.MultibodyPlant(0.0)
    try:
        parsing.Parser(plant).AddModelsFromString(tostring(root, encoding="unicode"), "sdf")
        plant.Finalize()
        context = plant.CreateDefaultContext()
        for index in plant.GetJointIndices():
            joint = plant.get_joint(index)
            if joint.type_name() == "revolute":
                joint.set_angle(context, 0.0)
        parts = tuple(_parts(plant, context, {j.get("name", ""): j for j in root.iter("joint")}))
        pull = root.findtext("world/gravity") or EARTH
        gravity = np.array(pull.split(), dtype=np.float64)
    except (RuntimeError, ValueError, SystemExit) as error:  # Drake exits if one of its own conditions fails
        sentence = " ".join(str(error).replace("<literal-string>.sdf:", "").split())
        if counts["include"]:
            sentence += " (<include> is not followed: a model that is needed must be copied into the file)"
        raise ConfigError(f"{path}: the library of SDFormat cannot read it: {sentence}") from error
    model = next((element.get("name") for element in root.iter("model")), None)
    notes = [f"<{tag}> elements, not read: {count}" for tag, count in sorted(counts.items())]
    return SimulatorModel(model or path.stem, "SDFormat", gravity, parts, (), tuple(notes))


def _refuse_masses_of_meshes(root: Element, path: Path) -> None:
    for link in root.iter("link"):
        if _from_shapes(link) and link.find("collision/geometry/mesh") is not None:
            raise ConfigError(
                f"{path}: the mass of link {link.get('name', '')!r} is defined by a mesh, which is not loaded: give its"
                " <inertial> a mass and an inertia instead of auto"
            )


def _from_shapes(element: Element) -> bool:
    """Check whether mass and inertia of a link are computed from its collision shapes."""
    return any(inertial.get("auto") in ("true", "1") for inertial in element.findall("inertial"))


def _strip(parent: Element, counts: Counter[str]) -> None:
    for child in list(parent):
        if child.tag in IGNORED and not (child.tag == "collision" and _from_shapes(parent)):
            counts[child.tag] += 1
            parent.remove(child)
        else:
            _strip(child, counts)


def _parts(plant: Any, context: Any, elements: dict[str, Element]) -> list[Part]:
    """List the bodies of the plant, each after its parent."""
    world = plant.world_body().index()
    by_child = {}
    for index in plant.GetJointIndices():
        joint = plant.get_joint(index)
        by_child[joint.child_body().index()] = joint
    place, rotors = {world: -1}, _rotors(plant)
    parts: list[Part] = []
    waiting = [plant.get_body(index) for index in plant.GetBodyIndices(plant.world_body().model_instance())][1:]
    for instance in range(plant.num_model_instances()):
        model = type(plant.world_body().model_instance())(instance)
        waiting += [plant.get_body(i) for i in plant.GetBodyIndices(model) if i != world]
    while waiting:
        ready = [body for body in waiting if _above(by_child, body, world) in place]
        if not ready:
            raise ValueError("its joints form a loop")
        for body in ready:
            joint = by_child.get(body.index())
            pose = plant.EvalBodyPoseInWorld(context, body)
            turned, position = pose.rotation().matrix(), pose.translation()
            inertia = body.default_spatial_inertia()
            mass, centre = inertia.get_mass(), inertia.get_com()
            about_centre = inertia.Shift(centre).CalcRotationalInertia().CopyToFullMatrix3()
            tensor = turned @ about_centre @ turned.T if mass > 0 else np.zeros((3, 3))
            moving = None
            if joint is not None and joint.type_name() != "weld":
                rotor_inertia = rotors.get(joint.index(), 0.0)
                moving = _joint(plant, context, joint, elements.get(joint.name()), rotor_inertia)
            above = place[_above(by_child, body, world)]
            parts.append(Part(body.name(), above, moving, float(mass), position + turned @ centre, tensor))
            place[body.index()] = len(parts) - 1
        waiting = [body for body in waiting if body.index() not in place]
    return parts


def _above(by_child: dict[Any, Any], body: Any, world: Any) -> Any:
    joint = by_child.get(body.index())
    return world if joint is None else joint.parent_body().index()


def _rotors(plant: Any) -> dict[Any, float]:
    """Compute the rotor inertia times the squared gear ratio, kg m^2, for each joint index.

    The values are from extensions of the format by Drake.
    """
    actuators = [plant.get_joint_actuator(index) for index in plant.GetJointActuatorIndices()]
    return {a.joint().index(): float(a.default_rotor_inertia() * a.default_gear_ratio() ** 2) for a in actuators}


def _joint(plant: Any, context: Any, joint: Any, element: Element | None, rotor_inertia: float) -> ModelJoint:
    pose = joint.frame_on_parent().CalcPoseInWorld(context)
    kind = KINDS.get(joint.type_name()) or str(joint.type_name())
    axis = pose.rotation().matrix() @ joint.revolute_axis() if kind == "hinge" else np.array([0.0, 0.0, 1.0])

    def number(key: str) -> float:
        return float((element is not None and element.findtext(f"axis/dynamics/{key}")) or 0.0)

    damping = float(joint.default_damping()) if kind == "hinge" else 0.0
    limits = None
    if kind == "hinge" and np.all(np.isfinite([*joint.position_lower_limits(), *joint.position_upper_limits()])):
        limits = float(joint.position_lower_limits()[0]), float(joint.position_upper_limits()[0])
    return ModelJoint(
        joint.name(),
        kind,
        axis,
        pose.translation(),
        damping,
        number("friction"),
        rotor_inertia,
        stiffness=number("spring_stiffness"),
        rest=number("spring_reference"),
        limits=limits,
        other=_mimic(element),
    )


def _mimic(element: Element | None) -> dict[str, str]:
    """Describe the joint that a joint mimics (`<mimic>` of its axis or `<drake:mimic>`); empty without one."""
    if element is None:
        return {}
    if (mimic := element.find("axis/mimic")) is not None:
        factor, offset = (mimic.findtext(key) for key in ("multiplier", "offset"))
    elif (mimic := next((child for child in element if child.tag == "drake:mimic"), None)) is not None:
        factor, offset = (mimic.get(key) for key in ("multiplier", "offset"))
    else:
        return {}
    return follows(mimic.get("joint", ""), float(factor or 1), float(offset or 0))
