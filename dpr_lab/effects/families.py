"""Families of effects with a common cause, such as a geared drive at a joint."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Family:
    """Component of the rig that causes several effects."""

    name: str
    words: str
    joint: int
    """Joint of the component, 1 or 2."""
    parts: tuple[str, ...]
    """Effects that the component can cause."""
    marks: tuple[str, ...]
    """Effects that are specific to the component."""
    expected: tuple[str, ...]
    """Effects that the component always causes to some degree and that a free swing can show."""

    def among(self, effects: Collection[str]) -> tuple[str, ...]:
        """Return the given effects that belong to this family.

        The result is empty unless there are two or more, of which at least one is specific to the family.
        """
        parts = tuple(name for name in effects if name in self.parts)
        return parts if len(parts) > 1 and set(parts) & set(self.marks) else ()


def _drive(j: int) -> Family:
    marks = [f"rotor_inertia_joint{j}", f"load_friction_joint{j}", f"detent_joint{j}", f"backlash_joint{j}"]
    friction = (f"{law}_joint{j}" for law in ("coulomb", "stribeck", "friction_curve", "hysteresis"))
    expected = [f"coulomb_joint{j}", f"load_friction_joint{j}"]
    expected += (
        ["rotor_inertia_joint2"] if j == 2 else []
    )  # the parameter a contains the inertia of the rotor of joint 1
    return Family(f"drive_joint{j}", f"geared drive, joint {j}", j, (*marks, *friction), tuple(marks), tuple(expected))


FAMILIES = (_drive(1), _drive(2))
"""Geared drives of joints 1 and 2: rotor, friction of bearing and gear, load-dependent friction, cogging, backlash.

Source: Spong, Hutchinson & Vidyasagar (2006), Robot Modeling and Control, ch. 7.
"""


def expected_of(geared: Iterable[int]) -> tuple[str, ...]:
    """Return the effects that are always present if the given joints (1 or 2) have geared drives."""
    return tuple(name for joint in geared for name in FAMILIES[joint - 1].expected)
