"""A rig with a moving arm as MJCF, URDF and SDFormat: hinges `joint0` (arm, vertical), `joint1`, `joint2`.

0 = upright for the rods; joint 2 is relative to the inner rod. Damping, Coulomb friction and stiffness of the arm are
those of its hinge; `c0` holds the back-EMF of a voltage drive too.
"""

from xml.etree.ElementTree import Element

from dpr_lab.exports.bodies import THIN, Rod
from dpr_lab.exports.moving_arm.bodies import ArmBodies
from dpr_lab.exports.xml import comment, element, text_of

RODS = ("inner", "outer")


def mjcf(made: ArmBodies, name: str, drive: str, scale_sentence: str) -> str:
    """MJCF, with a motor at `joint0` whose control is the input of the drive in its own unit."""
    root = element(None, "mujoco", model=name)
    element(root, "compiler", angle="radian")
    element(root, "option", gravity=f"0 0 {-made.gravity!r}", timestep="0.0005", integrator="RK4")
    element(element(root, "custom"), "text", name="scale", data=scale_sentence)
    parent = element(element(root, "worldbody"), "body", name="arm")
    hinge = {"damping": repr(made.damping), "stiffness": repr(made.stiffness), "frictionloss": repr(made.friction)}
    element(parent, "joint", name="joint0", type="hinge", axis="0 0 1", **hinge)
    inertia = repr(made.inertia)
    element(parent, "inertial", pos="0 0 0", mass="1e-9", diaginertia=f"{inertia} {inertia} {inertia}")
    at = f"0 {-made.length!r} 0"
    for j, rod in enumerate(made.rods):
        parent = element(parent, "body", name=RODS[j], pos=at)
        element(parent, "joint", name=f"joint{j + 1}", type="hinge", axis="0 1 0", damping=repr(rod.damping))
        thin = f"{rod.inertia!r} {rod.inertia!r} {THIN!r}"
        element(parent, "inertial", pos=f"0 0 {rod.centroid!r}", mass=repr(rod.mass), diaginertia=thin)
        end = f"0 0 0 0 0 {rod.length!r}"
        element(parent, "geom", type="capsule", fromto=end, size="0.006", contype="0", conaffinity="0")
        at = f"0 0 {rod.length!r}"
    if drive:
        motor = element(root, "actuator")
        element(motor, "motor", name=f"arm_{drive}", joint="joint0", gear=repr(made.gain))
    sensors = element(root, "sensor")
    for j in range(len(made.rods) + 1):
        element(sensors, "jointpos", name=f"encoder{j}", joint=f"joint{j}")
    return text_of(root)


def urdf(made: ArmBodies, name: str, drive: str, scale_sentence: str) -> str:
    """URDF; gravity is a setting of the simulator, and the torque per input a comment."""
    root = element(None, "robot", name=name)
    comment(root, scale_sentence)
    if drive:
        comment(root, f"joint0: torque = {made.gain!r} N m per unit of {drive}")
    if made.stiffness:
        comment(root, f"joint0: URDF has no element for its stiffness of {made.stiffness!r} N m/rad")
    element(root, "link", name="world")
    _urdf_link(root, "arm", made.inertia, made.inertia, 1e-9, 0.0)
    _urdf_joint(root, 0, ("world", "arm"), "0 0 0", "0 0 1", (made.damping, made.friction))
    parent, at = "arm", f"0 {-made.length!r} 0"
    for j, rod in enumerate(made.rods):
        _urdf_link(root, RODS[j], rod.inertia, THIN, rod.mass, rod.centroid)
        _urdf_joint(root, j + 1, (parent, RODS[j]), at, "0 1 0", (rod.damping, 0.0))
        parent, at = RODS[j], f"0 0 {rod.length!r}"
    return text_of(root)


def _urdf_link(root: Element, name: str, across: float, along: float, mass: float, centroid: float) -> None:
    inertial = element(element(root, "link", name=name), "inertial")
    element(inertial, "origin", xyz=f"0 0 {centroid!r}", rpy="0 0 0")
    element(inertial, "mass", value=repr(mass))
    none = dict.fromkeys(("ixy", "ixz", "iyz"), "0")
    element(inertial, "inertia", ixx=repr(across), iyy=repr(across), izz=repr(along), **none)


def _urdf_joint(
    root: Element, number: int, ends: tuple[str, str], at: str, axis: str, losses: tuple[float, float]
) -> None:
    joint = element(root, "joint", name=f"joint{number}", type="continuous")
    element(joint, "parent", link=ends[0])
    element(joint, "child", link=ends[1])
    element(joint, "origin", xyz=at, rpy="0 0 0")
    element(joint, "axis", xyz=axis)
    element(joint, "dynamics", damping=repr(losses[0]), friction=repr(losses[1]))


def sdf(made: ArmBodies, name: str, drive: str, scale_sentence: str) -> str:
    """SDFormat 1.10: a world with its gravity and one model; the torque per input is a comment."""
    root = element(None, "sdf", version="1.10")
    comment(root, scale_sentence)
    if drive:
        comment(root, f"joint0: torque = {made.gain!r} N m per unit of {drive}")
    world = element(root, "world", name="lab")
    _text(world, "gravity", f"0 0 {-made.gravity!r}")
    body = element(world, "model", name=name)
    _sdf_link(body, "arm", "", "0 0 0", made.inertia, made.inertia, 1e-9, 0.0)
    _sdf_joint(body, 0, ("world", "arm"), "0 0 1", (made.damping, made.friction, made.stiffness))
    parent, at = "arm", f"0 {-made.length!r} 0"
    for j, rod in enumerate(made.rods):
        _sdf_rod(body, j, parent, at, rod)
        parent, at = RODS[j], f"0 0 {rod.length!r}"
    return text_of(root)


def _sdf_rod(body: Element, j: int, parent: str, at: str, rod: Rod) -> None:
    _sdf_link(body, RODS[j], parent, at, rod.inertia, THIN, rod.mass, rod.centroid)
    _sdf_joint(body, j + 1, (parent, RODS[j]), "0 1 0", (rod.damping, 0.0, 0.0))


def _sdf_link(
    body: Element, name: str, parent: str, at: str, across: float, along: float, mass: float, centroid: float
) -> None:
    link = element(body, "link", name=name)
    relative = {"relative_to": parent} if parent else {}
    element(link, "pose", **relative).text = f"{at} 0 0 0"
    inertial = element(link, "inertial")
    _text(inertial, "pose", f"0 0 {centroid!r} 0 0 0")
    _text(inertial, "mass", repr(mass))
    tensor = element(inertial, "inertia")
    for key, value in (("ixx", across), ("iyy", across), ("izz", along), ("ixy", 0.0), ("ixz", 0.0), ("iyz", 0.0)):
        _text(tensor, key, repr(value))


def _sdf_joint(
    body: Element, number: int, ends: tuple[str, str], axis: str, passive: tuple[float, float, float]
) -> None:
    joint = element(body, "joint", name=f"joint{number}", type="revolute")
    _text(joint, "parent", ends[0])
    _text(joint, "child", ends[1])
    hinge = element(joint, "axis")
    _text(hinge, "xyz", axis)
    limit = element(hinge, "limit")
    _text(limit, "lower", "-inf")
    _text(limit, "upper", "inf")
    dynamics = element(hinge, "dynamics")
    for key, value in zip(("damping", "friction", "spring_stiffness"), passive, strict=True):
        _text(dynamics, key, repr(value))
    _text(dynamics, "spring_reference", "0")


def _text(parent: Element, tag: str, text: str) -> None:
    element(parent, tag).text = text
