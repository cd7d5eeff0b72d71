"""Find the double pendulum, or the single rod on an arm, in a model.

Notes describe the parts that a rig file cannot contain.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dpr_lab.errors import ConfigError
from dpr_lab.simulator_models.chain import CHAIN, ChainRod, JointTerm, ModelChain
from dpr_lab.simulator_models.chain_bodies import arm_of, fixed_to, inner_rod, last_rod, parts_at_elbow, sum_of
from dpr_lab.simulator_models.joint_choice import carrier, joint_of, named, only_choice, refuse_tilted
from dpr_lab.simulator_models.tree import ModelJoint, Part, SimulatorModel, Vector


def double_pendulum(model: SimulatorModel, names: Sequence[str] = (), gravity: float | None = None) -> ModelChain:
    """Find the rods and the arm of a model, and compute their values.

    Args:
        model: the model
        names: joints of the inner rod, the outer rod and optionally the arm, or of one rod and its arm; empty if there
            is only one choice
        gravity: gravity downwards along z, m/s^2; None: the value of the model

    Raises:
        ConfigError: joints are unknown or ambiguous, or axes are not parallel.
    """
    notes = list(model.notes)
    hinges = named(model, names) if names else only_choice(model)
    indices, count = hinges.all, len(hinges.rods)
    pull = _pull(model, gravity, notes)
    joints = [joint_of(model, index) for index in indices]
    _others(model, indices, notes)
    groups = [fixed_to(model, index, set(indices)) for index in indices]
    inner = joints[0]
    for outer in joints[1:count]:
        refuse_tilted(outer, inner.axis, f"the axis of {inner.name!r}", notes)
    e, arm = inner.axis, None
    if hinges.arm is not None:
        of_rods = groups[:count]
        arm = arm_of((joints[-1], inner), groups[-1], of_rods, -pull / np.linalg.norm(pull), e, notes)
        if (joints[-1].anchor - sum_of([part for rod in of_rods for part in rod])[1]) @ e < 0:
            e = -e  # the positive axis of the rods points from the rods to the axis of the arm
    down = pull - (pull @ e) * e
    g = float(np.linalg.norm(down))
    if not g > 0.1:
        along, towards = (", ".join(f"{value + 0.0:.3g}" for value in vector) for vector in (e, pull))
        raise ConfigError(
            f"gravity across the axis of {inner.name!r} is {g:.3g} m/s^2, but a pendulum needs at least 0.1: the axis"
            f" is ({along}), and gravity ({towards}) m/s^2"
        )
    inclination = math.asin(min(1.0, abs(pull @ e) / float(np.linalg.norm(pull))))
    if inclination > CHAIN.noticed:
        notes.append(
            f"the axis of {inner.name!r} is inclined by {math.degrees(inclination):.3g} degrees from the"
            " horizontal: g is the component of gravity in the plane of the swing"
        )
    up = -down / g
    plane = np.array([up, np.cross(e, up)])
    terms = [
        *(term for joint in joints[:count] for term in _terms(joint)),
        *(_spring_rest(joint) for joint in joints[count:] if joint.stiffness and joint.rest),
    ]
    if count == 1:
        rods, elbow_mass = (last_rod(groups[0], inner, plane, e, "rod"),), 0.0
    else:
        rods, elbow_mass = _two_rods(groups, joints, plane, e)
    if abs(rods[0].offset) > CHAIN.offset:
        offset = rods[0].offset
        quantity = "distance of the centre of mass from the axis of the inner rod"
        terms.append(JointTerm(inner.name, quantity, offset, "m"))
    _driven(model, joints, notes)
    rods = tuple(replace(rod, gear=_gear(model, rod.joint)) for rod in rods)
    arm = arm and replace(arm, gear=_gear(model, arm.joint))
    return ModelChain(rods, elbow_mass, g, e, arm, tuple(terms), tuple(notes))


def _two_rods(
    groups: Sequence[list[Part]], joints: Sequence[ModelJoint], plane: Vector, e: Vector
) -> tuple[tuple[ChainRod, ChainRod], float]:
    """Build the inner and the outer rod; compute the mass on the axis between the rods."""
    inner, outer = joints[:2]
    at_elbow = parts_at_elbow(groups[0], inner, outer, plane)
    inner_parts = [part for part in groups[0] if part not in at_elbow]
    first, angle = inner_rod(inner_parts, at_elbow, (inner, outer), plane, e)
    return (first, last_rod(groups[1], outer, plane, e, "outer rod", angle)), float(sum(p.mass for p in at_elbow))


def _pull(model: SimulatorModel, gravity: float | None, notes: list[str]) -> Vector:
    if gravity is not None:
        return np.array([0.0, 0.0, -gravity])
    if model.gravity is None:
        notes.append(
            f"{model.format} contains no gravity: g = {CHAIN.gravity} m/s^2 downwards along z (--g changes it)"
        )
        return np.array([0.0, 0.0, -CHAIN.gravity])
    if model.gravity.shape != (3,) or not np.linalg.norm(model.gravity) > 0:
        raise ConfigError("the model has no gravity, but a pendulum needs gravity: give --g 9.81")
    return model.gravity


def _others(model: SimulatorModel, indices: Sequence[int], notes: list[str]) -> None:
    """Add notes on joints that are fixed at zero."""
    for index, part in enumerate(model.parts):
        if part.joint is not None and index not in indices:
            below = carrier(model, index, set(indices)) >= 0
            location = f"; its body of {part.mass:.6g} kg moves with the rods" if below and part.mass else ""
            notes.append(f"joint {part.joint.name!r} ({part.joint.kind}) is treated as fixed at zero{location}")


def _terms(joint: ModelJoint) -> list[JointTerm]:
    values = (
        ("Coulomb friction", joint.friction, "N m"),
        ("rotor inertia (armature)", joint.armature, "kg m^2"),
        ("spring stiffness", joint.stiffness, "N m/rad"),
    )
    terms = [JointTerm(joint.name, quantity, value, unit) for quantity, value, unit in values if value]
    return [*terms, _spring_rest(joint)] if joint.stiffness else terms


def _spring_rest(joint: ModelJoint) -> JointTerm:
    return JointTerm(joint.name, "joint angle with the spring relaxed", joint.rest, "rad")


def _driven(model: SimulatorModel, joints: Sequence[ModelJoint], notes: list[str], unlimited: float = 1e4) -> None:
    """Add notes on actuators and on stops of the joints, except on stops beyond `unlimited` rad."""
    names = {joint.name for joint in joints}
    for actuator in model.actuators:
        if actuator.joint in names:
            gear = f", gear {actuator.gear:.6g}" if actuator.gear != 1.0 else ""
            notes.append(f"actuator {actuator.name!r} on joint {actuator.joint!r}: {actuator.kind}{gear}")
    for joint in joints:
        notes += [f"joint {joint.name!r}: {text} {numbers}" for text, numbers in joint.other.items()]
        if joint.limits is not None and min(map(abs, joint.limits)) < unlimited:
            lower, upper = joint.limits
            notes.append(f"joint {joint.name!r}: the stops at {lower:.6g} and {upper:.6g} rad are not in the rig file")


def _gear(model: SimulatorModel, joint: ModelJoint) -> float | None:
    actuators = [actuator for actuator in model.actuators if actuator.joint == joint.name]
    motor = len(actuators) == 1 and actuators[0].kind == "motor"
    return actuators[0].gear if motor and actuators[0].gear and math.isfinite(actuators[0].gear) else None
