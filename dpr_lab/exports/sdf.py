"""The corrected model as SDFormat 1.10: inertia, viscous and Coulomb friction, linear springs, gravity.

Source: http://sdformat.org/spec (world, link, joint/axis/dynamics).
"""

import json
import math
from collections.abc import Mapping
from xml.etree.ElementTree import Element

from dpr_lab.exports.bodies import THIN, Rod, bodies, in_words
from dpr_lab.exports.xml import comment, element, text_of
from dpr_lab.identification.model import Model
from dpr_lab.rig import Rig

WORDS = frozenset({"friction", "stiffness", "rest_angle", "offset", "added_length", "tilt"})
"""Elements of effects that SDFormat supports."""


def sdf(model: Model, rig: Rig, lost: Mapping[str, str]) -> str:
    """A world with its gravity and one model: links `inner`, `outer`; joints 0 = upright, joint 2 relative."""
    expressed = in_words(model, rig, WORDS)
    made = bodies(model, rig, expressed)
    root = element(None, "sdf", version="1.10")
    comment(root, model.scale_sentence)
    comment(root, f"omitted: {json.dumps(dict(lost), ensure_ascii=False)}")
    world = element(root, "world", name="lab")
    pull = made.gravity * math.sin(made.tilt), 0.0, -made.gravity * math.cos(made.tilt)
    _text(world, "gravity", " ".join(map(repr, pull)))
    body = element(world, "model", name=model.rig.name)
    parents, names, at = ("world", "inner"), ("inner", "outer"), "0 0 0 0 0 0"
    for j, rod in enumerate(made.rods):
        link = element(body, "link", name=names[j])
        relative = {"relative_to": parents[j]} if j else {}
        element(link, "pose", **relative).text = at
        _inertial(link, rod, made.tip_mass if j == 0 else 0.0)
        _joint(body, j, (parents[j], names[j]), rod)
        at = f"0 0 {rod.length!r} 0 0 0"
    return text_of(root)


def _joint(body: Element, j: int, ends: tuple[str, str], rod: Rod) -> None:
    joint = element(body, "joint", name=f"joint{j + 1}", type="revolute")
    _text(joint, "parent", ends[0])
    _text(joint, "child", ends[1])
    axis = element(joint, "axis")
    _text(axis, "xyz", "0 1 0")
    limit = element(axis, "limit")
    _text(limit, "lower", "-inf")
    _text(limit, "upper", "inf")
    dynamics = element(axis, "dynamics")
    _text(dynamics, "damping", repr(rod.damping))
    _text(dynamics, "friction", repr(rod.words.get("friction", 0.0)))
    hanging = math.pi if j == 0 else 0.0
    _text(dynamics, "spring_reference", repr(hanging + rod.words.get("rest_angle", 0.0)))
    _text(dynamics, "spring_stiffness", repr(rod.words.get("stiffness", 0.0)))


def _inertial(link: Element, rod: Rod, tip_mass: float) -> None:
    """A rod, and the parts fixed to its end."""
    mass = rod.mass + tip_mass
    offset, centroid = rod.mass * rod.offset / mass, (rod.mass * rod.centroid + tip_mass * rod.length) / mass
    apart = [(rod.mass, rod.offset, rod.centroid), (tip_mass, 0.0, rod.length)]
    inertia = rod.inertia + sum(m * ((x - offset) ** 2 + (z - centroid) ** 2) for m, x, z in apart)
    inertial = element(link, "inertial")
    _text(inertial, "pose", f"{offset!r} 0 {centroid!r} 0 0 0")
    _text(inertial, "mass", repr(mass))
    tensor = element(inertial, "inertia")
    for name, value in (("ixx", inertia), ("iyy", inertia), ("izz", THIN), ("ixy", 0.0), ("ixz", 0.0), ("iyz", 0.0)):
        _text(tensor, name, repr(value))


def _text(parent: Element, tag: str, text: str) -> None:
    element(parent, tag).text = text
