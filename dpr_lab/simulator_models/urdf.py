"""Read URDF files with `urdf_parser_py`, to which only links and joints are passed.

Source: https://wiki.ros.org/urdf/XML.
"""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import numpy as np

from dpr_lab.errors import ConfigError
from dpr_lab.simulator_models.numbers import refuse_bad_attributes
from dpr_lab.simulator_models.tree import ModelActuator, ModelJoint, Part, SimulatorModel, Vector, follows, frame
from dpr_lab.simulator_models.xml_file import read_xml

KINDS = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide", "floating": "free", "fixed": "fixed"}
"""Kinds of motion by the type of the joint in URDF."""

NUMBERS = frozenset("xyz rpy value ixx ixy ixz iyy iyz izz damping friction lower upper multiplier offset".split())
"""Attributes that contain numbers, in any element of a joint or of a link's inertial."""


def read_urdf(path: Path, text: bytes | None = None) -> SimulatorModel:
    """Read a URDF file; if `text` is given, it replaces the content of the file.

    Raises:
        ConfigError: the library is not installed, or the file is not valid.
    """
    try:
        from urdf_parser_py import urdf
    except ModuleNotFoundError as missing:
        raise ConfigError("reading URDF needs urdf-parser-py: pip install 'dpr-lab[exports]'") from missing
    root = read_xml(path, text)
    _refuse_macros(root, path)
    _without_namespaces(root)
    shapes = {link.get("name", ""): _ends(link) for link in root.iter("link")}
    ignored = Counter(child.tag for child in root if child.tag not in ("link", "joint", "transmission", "material"))
    meshes, plugins = sum(1 for _ in root.iter("mesh")), sum(1 for _ in root.iter("plugin"))
    actuators, rotors = tuple(_actuators(root)), _rotors(root, path)
    for child in list(root):
        if child.tag not in ("link", "joint"):
            root.remove(child)
        for shape in [part for part in child if part.tag not in _READ[child.tag]] if child.tag in _READ else ():
            child.remove(shape)
    refuse_bad_attributes(root, NUMBERS, path)
    _complete(root, path)
    try:
        robot = urdf.URDF.from_xml_string(tostring(root))
        parts = tuple(_parts(robot, shapes, rotors, path))
    except ConfigError:
        raise
    except Exception as error:  # the library passes on exceptions of any class
        reason = " ".join(str(error).split()) or type(error).__name__
        raise ConfigError(f"{path}: is not valid URDF: {reason}") from error
    notes = [f"<{tag}> elements, not read: {count}" for tag, count in ignored.items()]
    notes += [f"meshes, not loaded: {meshes}"] if meshes else []
    notes += [f"plugins, not loaded: {plugins}"] if plugins else []
    return SimulatorModel(robot.name or path.stem, "URDF", None, parts, actuators, tuple(notes))


_READ = {
    "link": {"inertial"},
    "joint": {"origin", "parent", "child", "axis", "dynamics", "limit", "mimic"},
}
"""For each element, its children that are read."""


WORLD = "world"
"""Name of the link that a file may use as a parent without declaring it (convention of Drake)."""


def _refuse_macros(root: Element, path: Path) -> None:
    read = [
        part for child in root if child.tag in _READ for part in child.iter() if part.tag not in ("mesh", "texture")
    ]
    texts = [text for part in read for text in part.attrib.values()]
    if any("xacro" in part.tag for part in root.iter()) or any("${" in text or "$(" in text for text in texts):
        raise ConfigError(f"{path}: contains macros of xacro: expand them first (xacro FILE > model.urdf)")


def _without_namespaces(root: Element) -> None:
    """Remove declarations of prefixes and attributes with prefixes, because they are not part of URDF."""
    for element in root.iter():
        for key in [key for key in element.attrib if ":" in key or key == "xmlns"]:
            del element.attrib[key]


def _complete(root: Element, path: Path) -> None:
    """Add the link `world` if a joint names it but the file lacks it.

    Raises:
        ConfigError: two links have the same name, or a joint names a link that does not exist.
    """
    links = Counter(link.get("name", "") for link in root.iter("link"))
    if twice := [name for name, count in links.items() if count > 1]:
        raise ConfigError(f"{path}: {links[twice[0]]} links are named {twice[0]!r}")
    for joint in root.findall("joint"):
        for end in ("parent", "child"):
            name = getattr(joint.find(end), "attrib", {}).get("link")
            if name == WORLD and end == "parent" and name not in links:
                SubElement(root, "link", name=WORLD)
                links[WORLD] = 1
            elif name is not None and name not in links:
                raise ConfigError(f"{path}: joint {joint.get('name', '')!r}: its {end} {name!r} is no link of the file")


def _numbers(text: str | None, default: str) -> Vector:
    values = np.array((text or default).split(), dtype=np.float64)
    if values.shape != (3,) or not np.all(np.isfinite(values)):
        raise ValueError(f"{text!r} is not 3 finite numbers")
    return values


def _pose(origin: Any) -> tuple[Vector, Vector]:
    """Return rotation and position of an origin element."""
    if origin is None:
        return np.eye(3), np.zeros(3)
    return frame(*(origin.rpy or (0.0, 0.0, 0.0))), np.array(origin.xyz or (0.0, 0.0, 0.0), dtype=np.float64)


def _parts(robot: Any, shapes: Mapping[str, tuple[Vector, ...]], rotors: Mapping[str, float], path: Path) -> list[Part]:
    """Convert links to parts, each after its parent."""
    children: dict[str, list[Any]] = {}
    for joint in robot.joints:
        children.setdefault(joint.parent, []).append(joint)
    below = {joint.child for joint in robot.joints}
    roots = [link.name for link in robot.links if link.name not in below]
    if not roots:
        raise ConfigError(f"{path}: joints form a loop: no link is without a parent")
    if len(roots) != 1:
        raise ConfigError(f"{path}: has {len(roots)} links without a parent; a robot has one")
    if len(below) != len(robot.joints):
        raise ConfigError(f"{path}: a link has two parent joints, but URDF does not support closed chains")
    parts: list[Part] = []
    waiting: list[tuple[str, int, Any, Vector, Vector]] = [(roots[0], -1, None, np.eye(3), np.zeros(3))]
    while waiting:
        name, above, joint, turned, position = waiting.pop()
        if joint is not None:
            rotation, offset = _pose(joint.origin)
            position, turned = position + turned @ offset, turned @ rotation
        inertial = robot.link_map[name].inertial
        rotation, offset = _pose(inertial.origin if inertial else None)
        tensor = np.zeros((3, 3)) if inertial is None else np.array(inertial.inertia.to_matrix(), dtype=np.float64)
        axes, ends = turned @ rotation, tuple(position + turned @ end for end in shapes.get(name, ()))
        mass = float(inertial.mass) if inertial else 0.0
        moving = None
        if joint is not None and joint.type != "fixed":
            moving = _joint(joint, turned, position, rotors.get(joint.name, 0.0))
        parts.append(Part(name, above, moving, mass, position + turned @ offset, axes @ tensor @ axes.T, ends))
        waiting += [(child.child, len(parts) - 1, child, turned, position) for child in children.get(name, [])]
    if len(parts) != len(robot.links):
        raise ConfigError(f"{path}: joints form a loop: {len(robot.links) - len(parts)} links are not reached")
    return parts


def _joint(joint: Any, turned: Vector, position: Vector, rotor_inertia: float) -> ModelJoint:
    axis = turned @ np.array(joint.axis or (1.0, 0.0, 0.0), dtype=np.float64)
    if not np.linalg.norm(axis) > 0:
        raise ValueError(f"joint {joint.name} has an axis without a direction")
    dynamics, limit = joint.dynamics, joint.limit
    limits = (float(limit.lower or 0), float(limit.upper or 0)) if limit and joint.type == "revolute" else None
    mimic = joint.mimic
    return ModelJoint(
        joint.name,
        KINDS.get(joint.type, joint.type),
        axis / np.linalg.norm(axis),
        position,
        float((dynamics and dynamics.damping) or 0.0),
        float((dynamics and dynamics.friction) or 0.0),
        rotor_inertia,
        limits=limits,
        other=follows(mimic.joint, float(mimic.multiplier or 1), float(mimic.offset or 0)) if mimic else {},
    )


def _ends(link: Element) -> tuple[Vector, ...]:
    """Return the end points of a link's boxes and cylinders, in its frame."""
    points: list[Vector] = []
    for shape in (*link.findall("visual"), *link.findall("collision")):
        try:
            origin = shape.find("origin")
            attributes = {} if origin is None else origin.attrib
            position, axes = _numbers(attributes.get("xyz"), "0 0 0"), frame(*_numbers(attributes.get("rpy"), "0 0 0"))
            for solid in shape.iterfind("geometry/cylinder"):
                points += [position + sign * axes[:, 2] * float(solid.get("length", "nan")) / 2 for sign in (1, -1)]
            for solid in shape.iterfind("geometry/box"):
                reach = _numbers(solid.get("size"), "") / 2
                points += [
                    position + sign * axis * size for axis, size in zip(axes.T, reach, strict=True) for sign in (1, -1)
                ]
        except ValueError:  # an invalid shape is ignored, because shapes do not influence the motion
            continue
    return tuple(point for point in points if np.all(np.isfinite(point)))


def _actuators(root: Element) -> list[ModelActuator]:
    actuators = []
    for transmission in root.findall("transmission"):
        reduction = transmission.findtext("actuator/mechanicalReduction") or "1"
        joint, name = transmission.find("joint"), transmission.get("name", "")
        try:
            gear = float(reduction)
        except ValueError:
            gear = float("nan")
        actuators.append(ModelActuator(name, "" if joint is None else joint.get("name", ""), "transmission", gear))
    return actuators


def _rotors(root: Element, path: Path) -> dict[str, float]:
    """Compute the rotor inertia times the squared gear ratio, kg m^2, for each joint name.

    The values are from extensions of the format by Drake.
    """
    rotors = {}
    for transmission in root.findall("transmission"):
        refuse_bad_attributes(transmission, frozenset({"value"}), path)
        inertia, gear = (
            next((float(part.get("value", "nan")) for part in transmission.iter(f"drake:{key}")), default)
            for key, default in (("rotor_inertia", 0.0), ("gear_ratio", 1.0))
        )
        joint = transmission.find("joint")
        if joint is not None and inertia > 0:
            rotors[joint.get("name", "")] = inertia * gear**2
    return rotors
