"""What several effects together are: the parts of a geared drive that was left on a joint."""

from collections.abc import Collection, Iterable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Family:
    """One thing on the rig that does several things to a swing."""

    name: str
    words: str
    parts: tuple[str, ...]
    """The effects that it may show."""
    marks: tuple[str, ...]
    """Those that hardly anything else has."""
    expected: tuple[str, ...]
    """Those that it has for certain, large or small, and that a swing can show."""

    def among(self, effects: Collection[str]) -> tuple[str, ...]:
        """Its parts among some effects; none unless they are two or more, with one of its marks."""
        found = tuple(name for name in effects if name in self.parts)
        return found if len(found) > 1 and set(found) & set(self.marks) else ()


def _drive(j: int) -> Family:
    marks = [f"rotor_inertia_joint{j}", f"load_friction_joint{j}", f"detent_joint{j}"]
    marks += [f"backlash_joint{j}"] if j == 2 else []  # that of joint 1 is not known to the library
    friction = (f"{law}_joint{j}" for law in ("coulomb", "stribeck", "friction_curve", "hysteresis"))
    expected = [f"coulomb_joint{j}", f"load_friction_joint{j}"]
    expected += ["rotor_inertia_joint2"] if j == 2 else []  # that of joint 1 is part of a
    return Family(f"drive_joint{j}", f"geared drive, joint {j}", (*marks, *friction), tuple(marks), tuple(expected))


FAMILIES = (_drive(1), _drive(2))
"""Rotor, friction of bearing and gear, friction that follows the load, cogging, play.

Source: Spong, Hutchinson & Vidyasagar (2006), Robot Modeling and Control, ch. 7.
"""


def expected_of(geared: Iterable[int]) -> tuple[str, ...]:
    """What geared drives on joints, 1 or 2, have for certain."""
    return tuple(name for joint in geared for name in FAMILIES[joint - 1].expected)
