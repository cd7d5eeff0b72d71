"""The corrected model as SDFormat 1.10: inertia, viscous and Coulomb friction, linear springs, gravity.

Source: http://sdformat.org/spec (world, link, joint/axis/dynamics).
"""

import json
import math
from collections.abc import Mapping
from xml.etree.ElementTree import Element

from dpr_lab.effects.effect import Words
from dpr_lab.exports.bodies import AnyModel, bodies, in_words
from dpr_lab.exports.rigid_bodies import THIN, Rod
from dpr_lab.exports.xml import comment, element, text_of
from dpr_lab.rig import Rig

WORDS = frozenset({"friction", "stiffness", "rest_angle", "offset", "added_length", "tilt"})
"""Elements of effects that SDFormat supports."""


def sdf(model: AnyModel, rig: Rig, lost: Mapping[str, str]) -> str:
    """SDFormat text: a world with gravity, and one model with the links `arm` (if it moves), `inner` and `outer`.

    The joints are 0 when upright.
    """
    expressed = in_words(model, rig, WORDS)
    made = bodies(model, rig, expressed)
    root = element(None, "sdf", version="1.10")
    comment(root, model.scale_sentence)
    if lost:
        comment(root, f"omitted: {json.dumps(dict(lost), ensure_ascii=False)}")
    world = element(root, "world", name="lab")
    pull = made.gravity * math.sin(made.tilt), 0.0, -made.gravity * math.cos(made.tilt)
    _text(world, "gravity", " ".join(map(repr, pull)))
    body = element(world, "model", name=model.rig.name)
    parent, pose = "world", "0 0 0 0 0 0"
    if arm := made.arm:
        if arm.input:
            comment(root, f"joint0: torque = {arm.gain!r} N m per unit of {arm.input}")
        _mass(_link(body, "arm", parent, pose), "0 0 0", 1e-9, arm.inertia, arm.inertia)
        _joint(body, 0, (parent, "arm"), arm.damping, arm.words)
        parent, pose = "arm", f"0 {-arm.length!r} 0 0 0 0"
    for j, rod in enumerate(made.rods, 1):
        name = ("inner", "outer")[j - 1]
        _inertial(_link(body, name, parent, pose), rod, made.tip_mass if j == 1 else 0.0)
        _joint(body, j, (parent, name), rod.damping, rod.words)
        parent, pose = name, f"0 0 {rod.length!r} 0 0 0"
    return text_of(root)


def _link(body: Element, name: str, parent: str, pose: str) -> Element:
    link = element(body, "link", name=name)
    relative = {} if parent == "world" else {"relative_to": parent}
    element(link, "pose", **relative).text = pose
    return link


def _joint(body: Element, j: int, ends: tuple[str, str], damping: float, words: Words) -> None:
    joint = element(body, "joint", name=f"joint{j}", type="revolute")
    _text(joint, "parent", ends[0])
    _text(joint, "child", ends[1])
    axis = element(joint, "axis")
    _text(axis, "xyz", "0 1 0" if j else "0 0 1")
    limit = element(axis, "limit")
    _text(limit, "lower", "-inf")
    _text(limit, "upper", "inf")
    dynamics = element(axis, "dynamics")
    _text(dynamics, "damping", repr(damping))
    _text(dynamics, "friction", repr(words.get("friction", 0.0)))
    hanging = math.pi if j == 1 else 0.0
    _text(dynamics, "spring_reference", repr(hanging + words.get("rest_angle", 0.0)))
    _text(dynamics, "spring_stiffness", repr(words.get("stiffness", 0.0)))


def _inertial(link: Element, rod: Rod, tip_mass: float) -> None:
    """Add the inertia of a rod and of the parts fixed to its end."""
    mass = rod.mass + tip_mass
    offset, centroid = rod.mass * rod.offset / mass, (rod.mass * rod.centroid + tip_mass * rod.length) / mass
    masses = [(rod.mass, rod.offset, rod.centroid), (tip_mass, 0.0, rod.length)]
    inertia = rod.inertia + sum(m * ((x - offset) ** 2 + (z - centroid) ** 2) for m, x, z in masses)
    _mass(link, f"{offset!r} 0 {centroid!r}", mass, inertia, THIN)


def _mass(link: Element, position: str, mass: float, inertia: float, distance: float) -> None:
    inertial = element(link, "inertial")
    _text(inertial, "pose", f"{position} 0 0 0")
    _text(inertial, "mass", repr(mass))
    tensor = element(inertial, "inertia")
    for name, value in (
        ("ixx", inertia),
        ("iyy", inertia),
        ("izz", distance),
        ("ixy", 0.0),
        ("ixz", 0.0),
        ("iyz", 0.0),
    ):
        _text(tensor, name, repr(value))


def _text(parent: Element, tag: str, text: str) -> None:
    element(parent, tag).text = text
