"""Choose the hinges of inner rod, outer rod and arm in a model."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from dpr_lab.errors import ConfigError
from dpr_lab.simulator_models.chain import CHAIN
from dpr_lab.simulator_models.tree import ModelJoint, SimulatorModel, Vector

CHOOSE = (
    "name the joints to use, --joints INNER,OUTER or INNER,OUTER,ARM or ROD,ARM; the other joints are fixed at zero"
)
"""Advice for a model with more hinges than those of a double pendulum on an arm."""


class Hinges(NamedTuple):
    """Indices of the parts that the joints of rods and arm move."""

    rods: tuple[int, ...]
    """Index for the inner rod and, if there are two rods, for the outer rod; a single rod is always on an arm."""
    arm: int | None

    @property
    def all(self) -> list[int]:
        """Indices for the rods, then the index for the arm."""
        return [*self.rods, *(() if self.arm is None else (self.arm,))]


def joint_of(model: SimulatorModel, index: int) -> ModelJoint:
    """Return the joint that moves part `index`, which must have a joint."""
    joint = model.parts[index].joint
    assert joint is not None
    return joint


def _hinges(model: SimulatorModel) -> list[int]:
    return [i for i, part in enumerate(model.parts) if part.joint is not None and part.joint.kind == "hinge"]


def carrier(model: SimulatorModel, index: int, among: set[int]) -> int:
    """Return the nearest ancestor of a part in `among`, or -1."""
    above = model.parts[index].parent
    while above >= 0 and above not in among:
        above = model.parts[above].parent
    return above


def _names(model: SimulatorModel, indices: Sequence[int]) -> str:
    return ", ".join(repr(joint_of(model, index).name) for index in indices) or "none"


def named(model: SimulatorModel, names: Sequence[str]) -> Hinges:
    """Find the rods and the arm of a model by the names of their joints.

    Raises:
        ConfigError: a joint is unknown, there are not two or three joints, or the joints are not in a chain.
    """
    hinges = _hinges(model)
    by_name = {joint_of(model, index).name: index for index in hinges}
    if len(names) not in (2, 3) or len(set(names)) != len(names):
        raise ConfigError(
            "--joints takes two or three joint names: inner rod, outer rod and optionally the arm. For a single rod on"
            " an arm, it takes the rod and the arm."
        )
    if unknown := [name for name in names if name not in by_name]:
        raise ConfigError(f"no hinge is named {unknown[0]!r}; hinges of the model: {_names(model, hinges)}")
    if common := [name for name in names if sum(joint_of(model, index).name == name for index in hinges) > 1]:
        raise ConfigError(f"several hinges are named {common[0]!r}: rename them, or keep one model in the file")
    indices = [by_name[name] for name in names]
    shoulder, elbow, *arm = indices
    chain = set(indices)
    if not arm and carrier(model, shoulder, chain) == elbow and _across(model, shoulder, elbow):
        return Hinges((shoulder,), elbow)
    if carrier(model, elbow, chain) != shoulder:
        raise ConfigError(f"joint {names[1]!r} is not on the rod of {names[0]!r}: give the inner joint first")
    if arm and carrier(model, shoulder, chain) != arm[0]:
        raise ConfigError(f"joint {names[0]!r} is not on the arm of {names[2]!r}")
    return Hinges((shoulder, elbow), arm[0] if arm else None)


def only_choice(model: SimulatorModel) -> Hinges:
    """Find the rods and the arm of a model that has no other hinges.

    Raises:
        ConfigError: the number of hinges is not 2 or 3, the hinges do not form a chain, or the axes of the rods are not
            parallel.
    """
    hinges = _hinges(model)
    if len(hinges) < 2:
        have = f"only one hinge, {_names(model, hinges)}" if hinges else "no hinge"
        kinds = sorted({part.joint.kind for part in model.parts if part.joint is not None} - {"hinge"})
        others = f" (joints of other kinds: {', '.join(kinds)})" if kinds else ""
        raise ConfigError(
            f"the model has {have}{others}; but a double pendulum, or a rod on an arm, has two hinges in a chain"
        )
    if len(hinges) > 3:
        raise ConfigError(f"the model has {len(hinges)} hinges, {_names(model, hinges)}: {CHOOSE}")
    chain = set(hinges)
    ordered = sorted(hinges, key=lambda index: _depth(model, index))
    if any(carrier(model, outer, chain) != inner for inner, outer in pairwise(ordered)):
        raise ConfigError(f"the hinges {_names(model, hinges)} are not in a chain: not a double pendulum")
    if len(ordered) == 2:
        first, second = ordered
        return Hinges((second,), first) if _across(model, first, second) else Hinges((first, second), None)
    arm, shoulder, elbow = ordered
    if _between(joint_of(model, arm).axis, joint_of(model, shoulder).axis) < math.pi / 4:
        raise ConfigError(
            f"the model has three hinges, {_names(model, ordered)}, and the first has the same axis as the"
            f" second: {CHOOSE}"
        )
    return Hinges((shoulder, elbow), arm)


def _across(model: SimulatorModel, first: int, second: int) -> bool:
    """Check whether two joint axes are perpendicular, like the axes of arm and rod."""
    return _between(joint_of(model, first).axis, joint_of(model, second).axis) > math.pi / 2 - CHAIN.parallel


def _depth(model: SimulatorModel, index: int) -> int:
    depth = 0
    while index >= 0:
        index, depth = model.parts[index].parent, depth + 1
    return depth


def _between(first: Vector, second: Vector) -> float:
    """Compute the angle between two axes regardless of their direction, rad."""
    return math.atan2(float(np.linalg.norm(np.cross(first, second))), abs(float(first @ second)))


def refuse_tilted(joint: ModelJoint, axis: Vector, what: str, notes: list[str]) -> None:
    """Check that the axis of a joint is parallel to `axis`.

    If there is a small angle between the axes, a note is added. `what` describes `axis` in the message.

    Raises:
        ConfigError: the axes are not parallel.
    """
    angle = _between(joint.axis, axis)
    if angle > CHAIN.parallel:
        raise ConfigError(
            f"the axis of {joint.name!r} is {math.degrees(angle):.3g} degrees away from {what}: dpr-lab models parallel"
            " rod axes, and an arm about the vertical"
        )
    if angle > CHAIN.noticed:
        notes.append(
            f"the axis of {joint.name!r} is {math.degrees(angle):.3g} degrees away from {what}: treated as parallel"
        )
