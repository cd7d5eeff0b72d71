"""Export of the corrected model as URDF: inertia, viscous and Coulomb friction.

URDF contains no gravity: it is a setting of the simulator. A tilt is a fixed joint below the base. Source:
https://wiki.ros.org/urdf/XML (link, joint).
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

WORDS = frozenset({"friction", "offset", "added_length", "tilt"})
"""Elements of effects that URDF supports."""


def urdf(model: AnyModel, rig: Rig, lost: Mapping[str, str]) -> str:
    """URDF text with links `world`, `base`, `arm` (if it moves), `inner`, `encoder2` and `outer`.

    The joints are 0 when upright; joint 2 is relative to the inner rod.
    """
    expressed = in_words(model, rig, WORDS)
    made = bodies(model, rig, expressed)
    root = element(None, "robot", name=model.rig.name)
    comment(root, model.scale_sentence)
    if lost:
        comment(root, f"omitted: {json.dumps(dict(lost), ensure_ascii=False)}")
    element(root, "link", name="world")
    element(root, "link", name="base")
    _joint(root, "stand", "fixed", ("world", "base"), "0 0 0", f"0 {made.tilt!r} 0")
    parent, position = "base", "0 0 0"
    if arm := made.arm:
        if arm.input:
            comment(root, f"joint0: torque = {arm.gain!r} N m per unit of {arm.input}")
        link = element(root, "link", name="arm")
        _inertial(link, "0 0 0", 1e-9, arm.inertia, arm.inertia)
        _drawn(link, f"0 {-arm.length / 2!r} 0", f"{math.pi / 2!r} 0 0", arm.length)
        _hinge(root, "joint0", (parent, "arm"), position, "0 0 1", (arm.damping, arm.words))
        parent, position = "arm", f"0 {-arm.length!r} 0"
    for j, rod in enumerate(made.rods):
        name = ("inner", "outer")[j]
        _link(root, name, rod)
        _hinge(root, f"joint{j + 1}", (parent, name), position, "0 1 0", (rod.damping, rod.words))
        parent, position = name, f"0 0 {rod.length!r}"
    if made.tip_mass > 0.0:
        _inertial(element(root, "link", name="encoder2"), "0 0 0", made.tip_mass, THIN)
        _joint(root, "encoder2", "fixed", ("inner", "encoder2"), f"0 0 {made.rods[0].length!r}", "0 0 0")
    return text_of(root)


def _joint(root: Element, name: str, kind: str, ends: tuple[str, str], position: str, turned: str) -> Element:
    joint = element(root, "joint", name=name, type=kind)
    element(joint, "parent", link=ends[0])
    element(joint, "child", link=ends[1])
    element(joint, "origin", xyz=position, rpy=turned)
    return joint


def _hinge(
    root: Element, name: str, ends: tuple[str, str], position: str, axis: str, losses: tuple[float, Words]
) -> None:
    joint = _joint(root, name, "continuous", ends, position, "0 0 0")
    element(joint, "axis", xyz=axis)
    damping, words = losses
    element(joint, "dynamics", damping=repr(damping), friction=repr(words.get("friction", 0.0)))


def _link(root: Element, name: str, rod: Rod) -> None:
    link = element(root, "link", name=name)
    _inertial(link, f"{rod.offset!r} 0 {rod.centroid!r}", rod.mass, rod.inertia)
    _drawn(link, f"0 0 {rod.length / 2!r}", "0 0 0", rod.length)


def _drawn(link: Element, middle: str, turned: str, length: float) -> None:
    """Add a visible cylinder without collisions."""
    visual = element(link, "visual")
    element(visual, "origin", xyz=middle, rpy=turned)
    element(element(visual, "geometry"), "cylinder", radius="0.006", length=repr(length))


def _inertial(link: Element, position: str, mass: float, inertia: float, distance: float = THIN) -> None:
    inertial = element(link, "inertial")
    element(inertial, "origin", xyz=position, rpy="0 0 0")
    element(inertial, "mass", value=repr(mass))
    products = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    element(inertial, "inertia", ixx=repr(inertia), iyy=repr(inertia), izz=repr(distance), **products)
